"""Starts of held-out states from the fields of solved samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.interfaces.cell import CellSolution
from porocore.sampling.campaign import OF_SAMPLES, ONSET, WarmStarts, run_campaign
from porocore.sampling.datasets.check import check_file
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.designs import RandomStates
from porocore.states import MacroState, Status
from tests.helpers.campaigns import sample
from tests.helpers.fake_cell import IDENTITY, INPUTS, Fake, FakeCellSolver, make, response

#: Every state of this cell is solvable.
OPEN = Fake(edge=-10.0)


def held_out(path: Path, starts: WarmStarts, factory: Any = make) -> Dataset:
    dataset = Dataset.create_or_open(path, inputs=INPUTS, identity=IDENTITY)
    with CellPool(factory, (OPEN,)) as pool:
        run_campaign(RandomStates(INPUTS, count=12, seed=5), pool, dataset, starts=starts)
    return dataset


class ColdOnly(FakeCellSolver):
    """Fails from every start other than the undeformed cell."""

    def solve(self, prepared: Any, states: MacroState, *, start: Any = None, **how: Any) -> CellSolution:
        if start and start[0] is not None:
            return CellSolution(response(np.full((3, 3), np.nan), np.nan, Status.not_converged), [None])
        return super().solve(prepared, states, start=start, **how)


def cold(fake: Fake) -> Any:
    return ColdOnly(fake), fake


def test_a_held_out_state_starts_from_the_nearest_sample(tmp_path: Path) -> None:
    samples, _ = sample(tmp_path / "samples.h5", OPEN)
    starts = WarmStarts(samples, 1.0)
    test = held_out(tmp_path / "test.h5", starts)
    known = np.array([samples.inputs_of(key) for key in samples.keys])
    for key, start in zip(test.keys, test.starts(), strict=True):
        x = np.array(test.inputs_of(key))
        distance = np.abs(known - x).max(axis=1)
        assert start is not None
        assert start.startswith(OF_SAMPLES)
        from_there = np.abs(np.array(samples.inputs_of(start.removeprefix(OF_SAMPLES))) - x).max()
        assert from_there == distance.min() < np.abs(x).max()
    again = held_out(tmp_path / "again.h5", WarmStarts(Dataset.open(tmp_path / "samples.h5"), 1.0))
    assert test.digest() == again.digest()
    findings = check_file(tmp_path / "test.h5")
    assert [finding.holds for finding in findings if finding.name == "starts kept"] == [True]


def test_near_rest_a_state_starts_from_rest(tmp_path: Path) -> None:
    samples, _ = sample(tmp_path / "samples.h5", OPEN)
    starts = WarmStarts(samples, 1.0)
    grad_u = np.zeros((1, 3, 3))
    grad_u[0, 1, 1] = -1e-3
    key, _ = starts.near(MacroState(grad_u, np.zeros(1))) or ("rest", None)
    assert key == "rest" or set(samples.inputs_of(key.removeprefix(OF_SAMPLES))) == {0.0}
    grad_u[0, 0, 1] = 0.1
    assert starts.near(MacroState(grad_u, np.zeros(1))) is None  # no sample has shear


def test_a_start_in_vain_is_made_from_rest(tmp_path: Path) -> None:
    samples, _ = sample(tmp_path / "samples.h5", OPEN)
    test = held_out(tmp_path / "test.h5", WarmStarts(samples, 1.0), cold)
    assert len(test) == 12
    assert test.starts() == [None] * 12
    assert test.responses().valid.all()


def test_where_walls_begin_to_touch_the_path_is_that_from_rest(tmp_path: Path) -> None:
    samples, _ = sample(tmp_path / "samples.h5", OPEN)
    responses = samples.responses()
    responses.status[:] = Status.contact
    assert responses.extrema is not None
    state = MacroState(np.diag([0.0, -0.31, 0.0])[None], np.zeros(1))
    found = []
    for share in (0.5 * ONSET, 2 * ONSET):
        responses.extrema.contact_share[:] = share
        samples.responses = lambda: responses  # type: ignore[method-assign]
        found.append(WarmStarts(samples, 1.0).near(state))
    assert found[0] is None
    assert found[1] is not None
