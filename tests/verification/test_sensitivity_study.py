"""Sensitivity studies of a coarse cell: small loads against M and Q, resuming, refusals."""

import io
import sys
from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cli.entry import main
from porocore.commands.sensitivity import figures
from porocore.commands.sensitivity import study as module
from porocore.commands.sensitivity.plan import StudyPlan, Sweep
from porocore.commands.sensitivity.study import run_study
from porocore.core.console import Console
from porocore.core.parallel.calls import ProcessEnded
from porocore.errors import DataError
from porocore.states import Status
from porocore.study.config.config import FemSettings

pytest.importorskip("porocore_fem_skfem")

CELL = Cell(mesh=MeshSettings(size=0.25, fluid_size=0.2, element="linear"))
FEM = FemSettings(backend="skfem")
PLAN = StudyPlan(
    {
        "uniaxial": Sweep(-0.002, 0.002, 0.001),
        "volumetric": Sweep(-0.6, 0.0, 0.2),
        "shear": Sweep(0.0, 0.001, 0.001),
        "pressure": Sweep(0.0, 0.001, 0.001),
    },
    tolerance=0.08,
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return run_study(CELL, FEM, folder, PLAN), folder


def test_small_loads_give_the_tangents_at_rest(finished):
    """The slopes of <∇u¹> along each load are those that M and Q say, and cubic symmetry holds."""
    study, _ = finished
    assert study.complete
    M, Q = study.rest.tangent.mean_grad_grad_u[0], study.rest.tangent.mean_grad_p[0]
    for load, slopes in {
        "uniaxial": M[:, :, 0, 0],
        "volumetric": np.einsum("ijkk->ij", M),
        "shear": M[:, :, 0, 1],
        "pressure": Q,
    }.items():
        along = study.loads[load]
        if load == "volumetric":
            continue  # its steps are large
        rest, value = int(np.flatnonzero(along.values == 0)[0]), along.values[-1]
        grad = np.array([[along.quantities[f"mean_grad_{i}{j}"] for j in "123"] for i in "123"])
        np.testing.assert_allclose(grad[:, :, -1] / value, slopes, atol=2e-3 * np.abs(slopes).max())
        assert along.quantities["Kt_11"][rest] == pytest.approx(1)
        assert along.quantities["J_hat"][rest] == 1
    uniaxial = study.loads["uniaxial"].quantities
    np.testing.assert_allclose(uniaxial["mean_grad_22"], uniaxial["mean_grad_33"], atol=1e-12)


def test_a_line_goes_as_far_as_the_cell_can_be_solved(finished):
    study, _ = finished
    line = study.lines["volumetric-"]
    assert line.end is Status(int(line.response.status[-1]))
    assert not line.end.has_values
    assert 0 < line.values[-2] - line.values[-1] <= 0.08
    assert line.values[-1] > -0.6
    assert list(line.values[1:-1]) == sorted(line.values[1:-1], reverse=True)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_rest_of_a_study_is_what_it_is_without_an_interruption(finished, tmp_path, workers):
    """A line whose process has ended is solved again, too."""
    study, folder = finished
    path = tmp_path / module.FILE
    path.write_bytes((folder / module.FILE).read_bytes())
    kept, series = module.load(path), module.SensitivitySeries(study, path, (), None)
    case = next(case for case in series.cases() if case.key == "uniaxial+")
    lost = series.lost(case, ProcessEnded("a process ended without a message"))
    assert (lost.end, list(lost.values)) == (Status.lost, [0.0, 0.001])
    lines = {"shear+": kept.lines["shear+"], "uniaxial+": lost}
    module.save(path, replace(kept, lines=lines))
    console = Console(io.StringIO())
    resumed = run_study(CELL, FEM, tmp_path, PLAN, workers=workers, console=console)
    assert "sensitivity: 1 of 9 states are there already" in console.stream.getvalue()
    for name, along in study.loads.items():
        np.testing.assert_array_equal(resumed.loads[name].values, along.values)
        np.testing.assert_array_equal(resumed.loads[name].status, along.status)
        for quantity, values in along.quantities.items():
            np.testing.assert_allclose(resumed.loads[name].quantities[quantity], values, rtol=1e-6, atol=1e-8)


def test_another_study_does_not_go_on(finished):
    _, folder = finished
    with pytest.raises(DataError, match="another cell, backend or plan"):
        run_study(CELL, FEM, folder, StudyPlan({"shear": Sweep(0.0, 0.1, 0.1)}))


def command(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["porocore", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, *capsys.readouterr()


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "my.yaml"
    from porocore.study.config.loading import benchmark_path

    text = benchmark_path().read_text(encoding="utf-8")
    text = text.replace("    size: 0.2 ", "    size: 0.25 ").replace("quadratic-curved", "linear")
    path.write_text(text.replace("fluid_size: 0.07", "fluid_size: 0.2"), encoding="utf-8")
    return path


def test_the_command_writes_data_table_and_figures(monkeypatch, capsys, config, tmp_path):
    out = tmp_path / "out"
    words = ("sensitivity", config, "--loads", "uniaxial=-0.01:0.01:0.01", "--workers", "1", "--out", out)
    monkeypatch.setattr(figures, "FIGURES", {"K11": figures.FIGURES["K11"]})  # the others take their time
    status, text, _ = command(monkeypatch, capsys, *words)
    assert status in (0, None)
    assert (out / "K11.png").read_bytes().startswith(b"\x89PNG")
    assert text.splitlines()[1].split() == ["uniaxial", "+", "–", "–", "0.01", "goal", "reached"]
    assert str(out / "sensitivity.csv") in text
    table = (out / "sensitivity.csv").read_bytes()
    status, _, error = command(monkeypatch, capsys, *words)
    assert status == 2
    assert "add --resume" in error
    status, _, error = command(monkeypatch, capsys, *words, "--resume")
    assert status in (0, None)
    assert (out / "sensitivity.csv").read_bytes() == table


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--loads", "torsion"), "expected some of uniaxial, volumetric, shear, pressure, got 'torsion'"),
        (("--loads", "shear,shear"), "'shear' is there twice"),
        (("--loads", "shear=0.1"), "expected goals and a step such as shear=-0.5:0.5:0.1"),
        (("--loads", "shear=x:1"), "expected goals and a step"),
        (("--loads", "shear=0.1:1"), "shear: expected goals with lower ≤ 0 ≤ upper"),
        (("--tolerance", "0"), "--tolerance: expected a tolerance of at least"),
        (("--workers", "0"), "--workers: expected 1 to 512"),
    ],
    ids=str,
)
def test_what_the_command_refuses(monkeypatch, capsys, tmp_path, words, message):
    status, _, error = command(monkeypatch, capsys, "sensitivity", *words, "--out", tmp_path / "out")
    assert status == 2
    assert message in " ".join(error.split())
    assert not (tmp_path / "out").exists()
