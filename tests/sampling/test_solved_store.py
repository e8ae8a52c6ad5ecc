"""A state that the store holds is not solved again, and every answer is the one of an empty store."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from porocore.core.files.store import ResultStore
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.sampling.samplers.density import DensitySweep
from porocore.states import MacroState, Status
from tests.helpers.campaigns import sample, solves
from tests.helpers.fake_cell import INPUTS, Fake, make

COARSE = {"step": {"p": 0.1, "H22": 0.2}, "tolerance": 0.05}


def store(folder: Path, identity: str = "cell-1", **results: bool) -> SolvedStore:
    return SolvedStore(ResultStore(folder), identity, **results)


def sweep(path: Path, log: Path | None = None, **options: object):
    fake = Fake(log="" if log is None else str(log))
    return sample(path, fake, sampler=DensitySweep(INPUTS, **COARSE), **options)


@pytest.fixture
def first(tmp_path):
    """A dataset sampled with an empty store, and the folder of that store."""
    known = store(tmp_path / "store")
    dataset, _ = sweep(tmp_path / "first.h5", known=known)
    assert (known.found, known.saved) == (0, 0)
    return dataset, tmp_path / "store"


def test_a_second_campaign_solves_nothing_and_has_the_same_bits(first, tmp_path):
    dataset, folder = first
    known = store(folder)
    again, summary = sweep(tmp_path / "again.h5", tmp_path / "log", known=known)
    assert solves(tmp_path / "log") == []
    assert known.found == summary.solved == len(dataset)
    assert again.digest() == dataset.digest()
    assert (again.responses().status == Status.overlap).any()
    np.testing.assert_array_equal(again.seconds(), dataset.seconds())
    assert known.saved == pytest.approx(dataset.seconds().sum())


def test_two_workers_take_from_it_too(first, tmp_path):
    dataset, folder = first
    again, _ = sweep(tmp_path / "again.h5", tmp_path / "log", known=store(folder), workers=2)
    assert solves(tmp_path / "log") == []
    assert again.digest() == dataset.digest()


def test_what_is_taken_tells_nothing_about_the_time_left(first, tmp_path):
    """It is there at once: "1 s left" was said when minutes were."""
    _, folder = first
    seen = []
    sweep(tmp_path / "again.h5", known=store(folder), on_progress=seen.append)
    assert {progress.seconds for progress in seen} == {None}
    sweep(tmp_path / "solved.h5", on_progress=seen.append)
    assert seen[-2].seconds is not None


def test_damaged_and_missing_states_are_solved_again_and_change_nothing(first, tmp_path):
    dataset, folder = first
    files = sorted(file.path for file in ResultStore(folder).files())
    files[0].unlink()
    os.truncate(files[1], 200)
    files[2].write_bytes(files[3].read_bytes()[:-1] + b"!")
    again, _ = sweep(tmp_path / "again.h5", tmp_path / "log", known=store(folder))
    assert len(solves(tmp_path / "log")) == 3
    assert again.digest() == dataset.digest()
    assert len(ResultStore(folder).files()) == len(files)


@pytest.mark.parametrize("other", [{"identity": "cell-2"}, {"tangent": False}])
def test_another_cell_or_other_results_are_not_found(first, tmp_path, other):
    _, folder = first
    known = store(folder, **other)
    state = MacroState.zeros(1)
    assert known.find("rest", state, None) is None
    assert store(folder).find("rest", state, None) is not None


def test_the_start_belongs_to_the_state(first):
    dataset, folder = first
    key = next(key for key, start in zip(dataset.keys, dataset.starts(), strict=True) if start)
    start = dict(zip(dataset.keys, dataset.starts(), strict=True))[key]
    state = INPUTS.scatter(dataset.inputs_of(key))
    assert store(folder).find(key, state, dataset.field(start)) is not None
    assert store(folder).find(key, state, None) is None


def test_a_lost_state_is_not_kept(tmp_path):
    known = store(tmp_path / "store")
    dead = Fake(die_at=0.1)
    with CellPool(make, (dead,), workers=1, executor="processes", known=known) as pool:
        for key, p in (("rest", 0.0), ("dead", 0.1)):
            pool.submit(key, MacroState(np.zeros((1, 3, 3)), np.array([p])))
        found = {solve.key: solve.response.status[0] for solve in (pool.wait(), pool.wait())}
    assert found == {"rest": Status.converged, "dead": Status.lost}
    assert len(known.store.files()) == 1


def test_a_store_that_cannot_be_written_costs_nothing_but_the_solves(first, tmp_path):
    dataset, _ = first
    (tmp_path / "file").touch()
    known = store(tmp_path / "file")
    again, _ = sweep(tmp_path / "again.h5", known=known)
    assert again.digest() == dataset.digest()
    assert known.store.fault


def test_what_was_solved_with_fields_serves_who_wants_none_but_not_the_reverse(first, tmp_path):
    _, folder = first
    state = MacroState.zeros(1)
    found = store(folder, fields=False).find("rest", state, None)
    assert found is not None
    assert found.field is None
    lean = store(tmp_path / "lean", fields=False)
    lean.keep(found, state, None)
    assert lean.find("rest", state, None) is not None
    assert store(tmp_path / "lean").find("rest", state, None) is None
