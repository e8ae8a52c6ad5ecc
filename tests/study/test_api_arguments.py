"""A faulty argument of the Python interface is one message: what was expected, what came, what to do."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import porocore
from porocore.errors import ConfigurationError


@pytest.fixture
def problem() -> porocore.CellProblem:
    """A cell that never comes to be solved."""
    made = porocore.CellProblem.__new__(porocore.CellProblem)
    made._solver, made._prepared = SimpleNamespace(), None  # type: ignore[assignment]
    return made


@pytest.mark.parametrize("source", [5, [1], 0.1, b"my.yaml"])
def test_a_source_is_a_path_a_name_or_settings(source: object) -> None:
    with pytest.raises(ConfigurationError, match=r"^source: expected the path of a configuration, .* got "):
        porocore.Study(source)  # type: ignore[arg-type]


def test_a_name_that_is_nearly_that_of_an_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigurationError, match=r"^dehgani2022: no such file, .*; did you mean 'dehghani2022'\?$"
    ):
        porocore.Study("dehgani2022")
    with pytest.raises(
        ConfigurationError, match=r"^filtre\.yaml: no such file; give the path of a configuration"
    ):
        porocore.Study("filtre.yaml")


def test_a_folder_is_a_path() -> None:
    with pytest.raises(ConfigurationError, match=r"^out: expected the path of a folder, got 5$"):
        porocore.Study("crosscheck", out=5)  # type: ignore[arg-type]


def test_a_kind_of_law_is_known() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^kind: expected 'surrogate' or 'linear', got 'direct'; .*CellProblem"
    ):
        porocore.Study("crosscheck").law("direct")  # type: ignore[arg-type]


def test_a_backend_is_a_name_and_a_cell_a_section() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^fem: expected the name of a backend, such as 'skfem', got 3$"
    ):
        porocore.CellProblem(fem=3)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match=r"^cell: expected a porocore\.Cell, .* got 'my\.yaml'$"):
        porocore.CellProblem("my.yaml")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("grad_u", "p", "said"),
    [
        (np.zeros((3, 3)), [0, 1], "p: expected one number, or one for each of the n = 1 states"),
        (np.zeros((4, 3, 3)), [0, 1], "p: expected one number, or one for each of the n = 4 states"),
        (np.zeros(9), 0, r"grad_u: expected shape \(3, 3\), .* got \(9,\)"),
        (np.full((3, 3), np.nan), 0, "grad_u: expected finite numbers, got nan"),
        (np.zeros((3, 3)), np.inf, "p: expected finite numbers, got inf"),
        ([[1, 2], [3]], 0, "grad_u: expected numbers in rows of equal length"),
        (np.zeros((0, 3, 3)), 0, "grad_u: expected at least one state, got none"),
    ],
)
def test_a_state_is_finite_and_of_its_shape(
    problem: porocore.CellProblem, grad_u: object, p: object, said: str
) -> None:
    with pytest.raises(ConfigurationError, match=f"^{said}"):
        problem.response(grad_u, p)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"mesh": {"size": "x"}}, "mesh.size: expected a number, got 'x'"),
        ({"mash": 3}, "mash: unknown key; remove it"),
        ({"geometry": {"radius": 0.7}}, "geometry.radius: expected less than 0.5, got 0.7"),
        (
            {"geometry": {"kind": "spheres-pores"}},
            "geometry: expected a kind of .*; did you mean 'sphere-pores'",
        ),
        ({"supercell": (1, 2)}, r"supercell.2: missing; got \[1, 2\]"),
        ({"material": {}, "materials": {"a": {}}}, "Cell: expected either material or materials, got both"),
    ],
)
def test_a_faulty_cell_is_told_without_words_of_pydantic(settings: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{said}") as error:
        porocore.Cell(**settings)  # type: ignore[arg-type]
    assert "pydantic" not in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_faulty_material_is_told_likewise() -> None:
    with pytest.raises(ConfigurationError, match=r"^poisson_ratio: expected less than 0.5, got 0.7$"):
        porocore.NeoHookean(poisson_ratio=0.7)
    assert porocore.NeoHookean(poisson_ratio=0.3).poisson_ratio == 0.3
