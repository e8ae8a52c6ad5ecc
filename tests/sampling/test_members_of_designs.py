"""Few members of a family for many states: designs, held-out states, undeformed members."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError, DataError
from porocore.sampling.campaign import run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import UndeformedMemberSolver
from porocore.sampling.samplers.designs import (
    Design,
    LatinHypercube,
    RandomStates,
    SobolDesign,
    UndeformedMembers,
)
from porocore.states import MacroState, Status
from porocore.testing.synthetic.family import INPUTS, PARAMETERS, SyntheticFamily, SyntheticFamilySolver

ONLY = InputSpace.from_ranges({}, PARAMETERS)


def points(sampler: Any) -> np.ndarray:
    return np.array([request.x for request in sampler.ask()])


def make() -> tuple[UndeformedMemberSolver, Any]:
    solver = UndeformedMemberSolver(SyntheticFamilySolver())
    return solver, solver.prepare(SyntheticFamily())


@pytest.mark.parametrize("design", [SobolDesign, LatinHypercube])
def test_each_member_of_a_design_has_some_states(design: type[Design]) -> None:
    sampler = design(INPUTS, 30, seed=2, states_per_member=8)
    x = points(sampler)
    assert (len(x), sampler.members) == (30, 4)
    members, states = np.unique(x[:, 3:], axis=0, return_counts=True)
    assert sorted(states) == [6, 8, 8, 8]
    assert (np.diff(x[:8, 3:], axis=0) == 0).all()
    assert len(np.unique(x[:, :3], axis=0)) == 30
    # One member in each quarter of a range.
    low, high = INPUTS.parameter_ranges.T
    if design is LatinHypercube:
        shares = ((members - low) / (high - low) * 4).astype(int)
        np.testing.assert_array_equal(np.sort(shares, axis=0), np.arange(4)[:, None] * [1, 1])
    np.testing.assert_array_equal(points(design(INPUTS, 30, seed=2, states_per_member=8)), x)


def test_a_longer_sobol_design_begins_with_the_same_states() -> None:
    np.testing.assert_array_equal(
        points(SobolDesign(INPUTS, 40, seed=1))[:10], points(SobolDesign(INPUTS, 10, seed=1))
    )


def test_the_corners_of_a_member_follow_each_other() -> None:
    sampler = SobolDesign(INPUTS, 40, corners=True)
    x = points(sampler)
    assert sampler.members == 4 + 2
    assert len(np.unique(x[:32], axis=0)) == 32
    assert (np.abs(np.diff(x[:32, 3:], axis=0)).any(axis=1)).sum() == 3


def test_members_of_no_use_are_refused() -> None:
    with pytest.raises(
        ConfigurationError, match=r"sampling\.options\.states_per_member: must be a whole number"
    ):
        SobolDesign(INPUTS, 10, states_per_member=0)


def test_held_out_states_share_members() -> None:
    x = points(RandomStates(INPUTS, count=12, seed=4, states_per_member=5))
    assert [len(np.unique(x[i : i + 5, 3:], axis=0)) for i in (0, 5, 10)] == [1, 1, 1]
    assert len(np.unique(x[:, 3:], axis=0)) == 3
    assert len(np.unique(x[:, 0])) == 12


@pytest.mark.parametrize(("m", "count"), [(1, 10), (2, 20), (3, 40), (4, 75), (9, 150)])
def test_undeformed_members_are_denser_towards_the_ends(m: int, count: int) -> None:
    ranges = {f"t{i}": (0.0, 1.0) for i in range(m)}
    unit = points(UndeformedMembers(InputSpace.from_ranges({}, ranges), count))
    assert unit.shape == (count, m)
    assert ((unit > 0) & (unit < 1)).all()
    # A third of the points of the density 1/π√(u(1 − u)) lies within 1/15 of each end.
    outer = np.mean((unit < 0.067) | (unit > 0.933), axis=0)
    np.testing.assert_allclose(outer, 1 / 3, atol=0.11)


def test_undeformed_members_are_kept_with_their_conductivity_and_resumed(tmp_path: Path) -> None:
    path, warned = tmp_path / "undeformed.h5", list[str]()
    dataset = Dataset.create_or_open(path, inputs=ONLY, identity="family")
    with CellPool(make, executor="serial", fields=False, on_warning=warned.append) as pool:
        run_campaign(UndeformedMembers(ONLY, 20), pool, dataset)
    found, states = dataset.responses(), dataset.states()
    assert states.parameters is not None
    porosity, modulus = states.parameters.T
    missing = (porosity >= 0.5) & (modulus >= 1.5)
    np.testing.assert_array_equal(found.status == Status.inverted, missing)
    assert 0 < missing.sum() == len(warned) < len(missing)
    assert found.conductivity is not None
    K = (porosity**3 / (1 - porosity) ** 2)[:, None, None] * np.eye(3)
    np.testing.assert_allclose(found.conductivity[~missing], K[~missing], rtol=1e-12)
    assert np.isnan(found.conductivity[missing]).all()
    assert found.tangent is not None
    assert not states.grad_u.any()
    assert not states.p.any()
    digest = dataset.digest()
    dataset.drop(dataset.keys[::3])
    with CellPool(make, executor="serial", fields=False) as pool:
        summary = run_campaign(UndeformedMembers(ONLY, 20), pool, Dataset.open(path))
        again = run_campaign(UndeformedMembers(ONLY, 20), pool, Dataset.open(path))
    assert (summary.solved, again.solved) == (7, 0)
    assert Dataset.open(path).digest() == digest
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(DataError, match="move it"):
        Dataset.open(path)


def test_only_undeformed_states_have_that_conductivity() -> None:
    solver, family = make()
    with pytest.raises(ValueError, match="undeformed"):
        solver.solve(family, MacroState.single(np.eye(3) * 0.1).with_parameters([0.4, 1.0]))
