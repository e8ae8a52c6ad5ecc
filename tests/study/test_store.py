"""The keys of the user's store change with all that a result depends on."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.core.inputs import InputSpace
from porocore.interfaces.surrogate import TrainingSet
from porocore.plugins.registry import registry
from porocore.states import MacroState
from porocore.study import store
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.cell import respond

COARSE = {"mesh": {"size": 0.5, "fluid_size": 0.5}}
INPUTS = InputSpace.from_ranges({"H22": (-0.2, 0.05), "p": (0.0, 0.1)})


def test_the_place_is_the_users_cache_or_that_of_the_environment(monkeypatch, tmp_path):
    monkeypatch.delenv(store.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found = store.user_store()
    assert found is not None
    assert found.folder == tmp_path / "cache/porocore/store"
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "own"))
    assert store.user_store().folder == tmp_path / "own"
    monkeypatch.setenv(store.VARIABLE, "none")
    assert store.user_store() is None


def test_no_test_reads_the_store_of_the_user():
    assert store.user_store() is None


def test_a_cell_has_another_key_with_every_change(monkeypatch):
    pytest.importorskip("porocore_fem_skfem")

    def key(options=None, conductivity="piola", **cell):
        return store.cell_key("skfem", options or {}, Cell.model_validate(COARSE | cell), conductivity)

    first = key()
    assert key() == first
    others = [
        key(viscosity=2.0),
        key(material={"poisson_ratio": 0.3}),
        key(mesh={"size": 0.45, "fluid_size": 0.5}),
        key({"solver": "superlu"}),
        key(conductivity="deformed"),
    ]
    monkeypatch.setattr(store, "PHYSICS", store.PHYSICS + 1)
    others.append(key())
    assert len({first, *others}) == 1 + len(others)


def test_an_edited_plugin_under_the_same_version_has_another_key(monkeypatch, tmp_path):
    package = tmp_path / "porocore_cell_mine"
    package.mkdir()
    (package / "__init__.py").write_text("class Mine:\n    pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import porocore_cell_mine  # type: ignore[import-not-found]

    monkeypatch.setitem(sys.modules, "porocore_cell_mine", porocore_cell_mine)
    before = store.code_of(porocore_cell_mine.Mine)
    assert before == store.code_of(porocore_cell_mine.Mine)
    (package / "formulas.py").write_text("two = 2\n")
    assert store.code_of(porocore_cell_mine.Mine) != before


def training_set(scale=1.0, tolerance=0.01):
    x = np.random.default_rng(0).uniform([-0.2, 0.0], [0.05, 0.1], (12, 2)) * scale
    states = INPUTS.scatter(x)
    rest = respond(MacroState.zeros(1))
    return TrainingSet(states, respond(states), INPUTS, rest, "made-up", {}, tolerance=tolerance)


def test_a_surrogate_has_another_key_with_every_change():
    assert registry().get("surrogate", "polynomial") is PolynomialSurrogate

    def key(options=None, seed=0, **changes):
        return store.training_key("polynomial", options or {}, seed, training_set(**changes))

    first = key()
    assert key() == first
    others = [key({"degree": 3}), key(seed=1), key(scale=0.5), key(tolerance=0.02)]
    assert len({first, *others}) == 1 + len(others)


def test_corrected_numbers_come_with_another_version_of_the_physics():
    """Stored results of an older porocore are used as long as PHYSICS stands.

    If these numbers change on purpose, raise ``porocore.study.store.PHYSICS`` and put the new numbers here.
    """
    pytest.importorskip("porocore_fem_skfem")
    import porocore

    cell = porocore.CellProblem(COARSE)
    found = cell.response([[0.0, 0.05, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.02]], p=0.03)
    numbers = [cell.conductivity[0, 0], found.potential[0], found.stress[0, 1, 1], found.fluid_volume[0]]
    assert store.PHYSICS == 2
    assert numbers == pytest.approx([1.9734102, -0.0082828034, -0.069604406, 0.35706115], rel=1e-7)


def test_single_states_from_python_are_solved_once(monkeypatch, tmp_path):
    pytest.importorskip("porocore_fem_skfem")
    import porocore
    from porocore.cell.equilibrium.solver import EquilibriumCellSolver

    solved = []
    solve = EquilibriumCellSolver.solve
    monkeypatch.setattr(
        EquilibriumCellSolver, "solve", lambda *a, **how: solved.append(len(a[2])) or solve(*a, **how)
    )
    H = np.zeros((3, 3, 3))
    H[:, 1, 1] = [-0.02, -0.04, -0.06]
    cell = porocore.CellProblem(COARSE, store=tmp_path)
    two = cell.response(H[:2], p=0.01)
    three = porocore.CellProblem(COARSE, store=tmp_path).response(H, p=0.01)
    assert solved == [2, 1]
    np.testing.assert_array_equal(three.stress[:2], two.stress)
    np.testing.assert_array_equal(three.tangent.stress_grad_u[:2], two.tangent.stress_grad_u)
    assert cell.response(H[:2], p=0.01, tangent=False).tangent is None
    assert solved == [2, 1, 2]
    porocore.CellProblem(COARSE, store=False).response(H[0])
    assert solved[-1] == 1
