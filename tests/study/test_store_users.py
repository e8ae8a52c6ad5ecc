"""Studies of one cell take from the store what another one has solved, and say so; the numbers are the same."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import porocore
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.stability.map import LineSettings, MapPlan
from porocore.commands.sensitivity.plan import StudyPlan, Sweep
from porocore.core.files.store import ResultStore
from porocore.sampling.execution.solved_store import STATES, SolvedStore
from porocore.study.run.reference import solve_cell, undeformed
from porocore.study.store import told

pytest.importorskip("porocore_fem_skfem")

COARSE = {"mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"}}
CONFIG = porocore.Study("crosscheck", cell=COARSE, sampling={"workers": 1}).config
Study = Callable[[Path, Path | bool], list[Any]]


def _sensitivity(folder: Path, store: Path | bool) -> list[Any]:
    plan = StudyPlan({"uniaxial": Sweep(-0.02, 0.0, 0.01)})
    found = porocore.study_sensitivity(CONFIG, folder, plan, store=store, progress=True).study
    line = found.lines["uniaxial-"]
    at_rest = found.rest.extrema
    assert at_rest is not None
    assert (line.seconds[1:] > 1e-3).all()
    extrema = [at_rest.min_jacobian, line.response.extrema.grad, line.response.extrema.energy]
    return [line.values, line.response.stress, line.response.tangent.stress_grad_u, *extrema]


def _stability(folder: Path, store: Path | bool) -> list[Any]:
    plan = MapPlan({"H22": -0.02}, "p", (0.01,), LineSettings(steps=2))
    (line,) = porocore.map_stability(CONFIG, folder, plan, store=store, progress=True).lines
    return [line.stress, line.pivots, line.acoustic]


def _fields(folder: Path, store: Path | bool) -> list[Any]:
    state, how = {"H22": -0.02}, {"store": store, "tell": _tell}
    found = porocore.write_local_fields(CONFIG, folder, state, pictures=False, **how)
    return [found.nodal.displacement, found.response.extrema.energy]


def _state(folder: Path, store: Path | bool) -> list[Any]:
    known = ResultStore(Path(store)) if store else None
    found = solve_cell(CONFIG, np.diag([0.0, -0.02, 0.0]), 0.01, store=known, tell=_tell)
    return [found["stress"], found["tangent"]["stress_grad_u"]]


def _tell(text: str) -> None:
    print(text, file=sys.stderr)


@pytest.mark.parametrize(("study", "states"), [(_sensitivity, 2), (_stability, 3), (_fields, 1), (_state, 1)])
def test_a_second_study_solves_nothing(
    study: Study,
    states: int,
    tmp_path: Path,
    undrawn: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def said() -> list[str]:
        return [line for line in capsys.readouterr().err.splitlines() if "store" in line]

    first = study(tmp_path / "first", tmp_path / "store")
    assert said() == []
    asked = _counted(monkeypatch)
    again = study(tmp_path / "again", tmp_path / "store")
    assert asked == []
    several = "states" if states > 1 else "state"
    (line,) = said()
    assert re.fullmatch(rf"\w+: {states} {several} came from the store, which saved .+", line)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
    asked.clear()
    study(tmp_path / "without", False)
    assert asked
    assert said() == []


def _counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that grows by the number of states of each solve from now on."""
    asked: list[int] = []
    solve = EquilibriumCellSolver.solve

    def counting(self: Any, prepared: Any, states: Any, **how: Any) -> Any:
        asked.append(len(states))
        return solve(self, prepared, states, **how)

    monkeypatch.setattr(EquilibriumCellSolver, "solve", counting)
    return asked


def test_check_study_and_sensitivity_share_the_undeformed_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ResultStore(tmp_path)
    first = undeformed(CONFIG.cell, CONFIG.fem, "piola", store)
    asked = _counted(monkeypatch)
    again = undeformed(CONFIG.cell, CONFIG.fem, "piola-unrotated", store)
    assert asked == []
    np.testing.assert_array_equal(again.conductivity, first.conductivity)
    assert again.porosity == first.porosity


def test_nothing_is_said_of_an_empty_store(tmp_path: Path) -> None:
    known, said, saved = SolvedStore(ResultStore(tmp_path), "cell"), list[str](), list[float]()
    with told(known, "direct", said.append, saved.append):
        pass
    with told(None, "direct", said.append, saved.append):
        pass
    assert (said, saved) == ([], [])
    known.found, known.saved = 3, 1.0

    def interrupted() -> None:
        with told(known, "direct", said.append, saved.append):
            known.found, known.saved = 5, 61.0
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert saved == [60.0]
    assert said[0].startswith("direct: 2 states came from the store, which saved about 1")
    assert STATES == "states"
