"""Samplings of a family: parameters are inputs, columns of the data set and part of what is solved and kept."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.core.files.store import ResultStore
from porocore.core.inputs import InputSpace
from porocore.core.parallel.calls import CycleCollection
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.records import flatten_response
from porocore.sampling.campaign import run_campaign
from porocore.sampling.datasets.check import check_file, merge, table
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import MemberSolver
from porocore.sampling.execution.pool import PendingState, next_for
from porocore.sampling.execution.solved_store import SolvedStore, StoringSolver
from porocore.sampling.execution.tasks import SerialBackend
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.density import DensitySweep
from porocore.sampling.samplers.designs import RandomStates, SobolDesign
from porocore.states import MacroState, Status
from porocore.testing.synthetic.family import INPUTS, SyntheticFamily, SyntheticFamilySolver, respond


def make() -> tuple[MemberSolver, Any]:
    """A worker's solver and family."""
    solver = MemberSolver(SyntheticFamilySolver())
    return solver, solver.prepare(SyntheticFamily())


def sampled(path: Path, sampler: Any = None, **pool: Any) -> Dataset:
    dataset = Dataset.create_or_open(path, inputs=INPUTS, identity="family")
    with CellPool(make, **pool) as workers:
        run_campaign(sampler or SobolDesign(INPUTS, 16, seed=3, states_per_member=1), workers, dataset)
    return dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Sixteen states, of which some have no cell."""
    return sampled(tmp_path_factory.mktemp("family") / "data.h5", executor="serial")


def test_a_design_fills_the_ranges_of_the_parameters(dataset: Dataset) -> None:
    states = dataset.states()
    assert states.parameters is not None
    np.testing.assert_array_equal(dataset.x()[:, 3:], states.parameters)
    low, high = INPUTS.parameter_ranges.T
    shares = (states.parameters - low) / (high - low)
    # One of 16 points of a Sobol sequence in each sixteenth.
    np.testing.assert_array_equal(np.sort((shares * 16).astype(int), axis=0), np.arange(16)[:, None] * [1, 1])


def test_states_hold_the_responses_of_their_members(dataset: Dataset) -> None:
    found, states = dataset.responses(), dataset.states()
    porosity, modulus = states.parameters.T
    missing = (porosity >= 0.5) & (modulus >= 1.5)
    assert 0 < missing.sum() < 8
    np.testing.assert_array_equal(found.status == Status.inverted, missing)
    expected = flatten_response(respond(states))
    for name, array in flatten_response(found).items():
        assert np.isnan(array[missing]).all(), name
        np.testing.assert_array_equal(array[~missing], expected[name][~missing])
    assert found.slopes.stress.shape == (16, 3, 3, 2)


def test_a_file_is_read_back_with_its_parameters(dataset: Dataset, tmp_path: Path) -> None:
    again = Dataset.open(dataset.path, inputs=INPUTS, identity="family")
    assert again.inputs == INPUTS
    assert again.inputs.parameters == ("porosity", "modulus")
    assert again.digest() == dataset.digest()
    np.testing.assert_array_equal(again.states().parameters, dataset.states().parameters)
    assert all(finding.holds for finding in check_file(dataset.path)), check_file(dataset.path)
    merged = merge(
        [dataset, sampled(tmp_path / "more.h5", SobolDesign(INPUTS, 20, seed=3, states_per_member=1))],
        tmp_path / "all.h5",
    )
    assert len(merged) == 20
    np.testing.assert_array_equal(merged.states().parameters[:16], dataset.states().parameters)
    with pytest.raises(DataError, match="holds states of other inputs"):
        Dataset.open(dataset.path, inputs=InputSpace.from_ranges({"H11": (-0.1, 0.1)}))
    empty = Dataset.create(tmp_path / "empty.h5", inputs=INPUTS, identity="family")
    assert Dataset.open(empty.path).states().parameters.shape == (0, 2)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_interrupted_sampling_ends_with_the_same_states(
    dataset: Dataset, tmp_path: Path, workers: int
) -> None:
    path = tmp_path / "data.h5"
    sampled(path, SobolDesign(INPUTS, 7, seed=3, states_per_member=1))
    again = sampled(path, workers=workers)
    assert again.digest() == dataset.digest()


def test_the_table_has_a_column_for_each_parameter(dataset: Dataset) -> None:
    columns, states = table(dataset), dataset.states()
    np.testing.assert_array_equal(columns["modulus"], states.parameters[:, 1])
    assert not any(name.startswith("slopes") for name in columns)
    columns, slopes = table(dataset, derivatives=True), dataset.responses().slopes
    np.testing.assert_array_equal(columns["slopes_stress_12_modulus"], slopes.stress[:, 0, 1, 1])
    np.testing.assert_array_equal(columns["slopes_porosity_porosity"], slopes.porosity[:, 0])


def test_a_record_without_its_parameters_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    solver, family = make()
    with pytest.raises(ConfigurationError, match="expected the parameters of the cell with every state"):
        solver.solve(family, MacroState.zeros(1))
    other = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity="family")
    with CellPool(make, executor="serial") as pool:
        pool.submit("a", INPUTS.scatter(dataset.x()[:1]))
        record = pool.wait().record(INPUTS, tuple(dataset.x()[0]))
    with pytest.raises(ConfigurationError, match="a value of each parameter"):
        other.append(replace(record, state=record.state.with_parameters(None)))


def test_why_there_is_no_cell_is_told(tmp_path: Path) -> None:
    told: list[str] = []
    impossible = INPUTS.scatter([[0, 0, 0, 0.55, 1.75]])
    with CellPool(make, executor="serial", on_warning=told.append) as pool:
        pool.submit("a", impossible)
        pool.submit("b", impossible)
        assert [pool.wait().response.status[0] for _ in range(2)] == [Status.inverted] * 2
    assert told == ["no cell has a porosity of 0.55 and a modulus of 1.75"]


def test_an_error_of_the_solver_is_no_missing_member() -> None:
    class Choosy(SyntheticFamilySolver):
        def prepare(self, cell: Any) -> SyntheticFamily:
            raise ConfigurationError("fem.options: unknown option 'tolerence'")

    solver, states = MemberSolver(Choosy()), INPUTS.scatter([[0, 0, 0, 0.4, 1.0], [0, 0, 0, 0.55, 1.75]])
    family = solver.prepare(SyntheticFamily())
    with pytest.raises(ConfigurationError, match="tolerence"):
        solver.solve(family, states[:1])
    with pytest.raises(ConfigurationError, match="tolerence"):
        solver.why_missing(family, states[:1])
    assert solver.why_missing(family, states[1:]) == ["no cell has a porosity of 0.55 and a modulus of 1.75"]


def test_states_of_several_members_come_back_in_their_order() -> None:
    rng = np.random.default_rng(0)
    members = np.array([[0.4, 1.0], [0.35, 0.7], [0.55, 1.75], [0.31, 1.9]])
    states = INPUTS.scatter(np.column_stack([0.1 * rng.random((12, 3)), members[rng.integers(0, 4, 12)]]))
    inner = SyntheticFamilySolver()
    solver = MemberSolver(inner)
    found = solver.solve(solver.prepare(SyntheticFamily()), states, fields=True)
    good = states.parameters[:, 0] != 0.55
    assert 0 < good.sum() < 12
    np.testing.assert_array_equal(found.response.valid, good)
    np.testing.assert_array_equal(found.response.stress[good], respond(states).stress[good])
    assert [field is not None for field in found.fields] == good.tolist()
    np.testing.assert_array_equal(
        [field.u[0, :2] for field in found.fields if field is not None], states.parameters[good]
    )


def test_few_members_are_kept_prepared() -> None:
    inner = SyntheticFamilySolver()
    solver = MemberSolver(inner, kept=2)
    family = solver.prepare(SyntheticFamily())
    for modulus in (1.0, 1.1, 1.0, 1.2, 1.0, 1.1):
        solver.solve(family, INPUTS.scatter([[0, 0, 0, 0.4, modulus]]))
    assert [member.values[1] for member in inner.prepared] == [1.0, 1.1, 1.2, 1.1]
    assert len(family.members) == 2


def test_members_that_are_not_kept_give_back_their_memory() -> None:
    """A prepared member and its factors refer to one another, so that nothing is freed by counting references."""
    known: list[weakref.ref[Any]] = []

    class Circular(SyntheticFamilySolver):
        def prepare(self, cell: Any) -> SyntheticFamily:
            member = super().prepare(cell)
            object.__setattr__(member, "itself", member)
            known.append(weakref.ref(member))
            return member

    inner = Circular()
    solver = MemberSolver(
        inner, kept=2, collection=CycleCollection(lambda: 0.0)
    )  # a collection takes no time
    family = solver.prepare(SyntheticFamily())
    for modulus in (1.0, 1.1, 1.2, 1.3):
        solver.solve(family, INPUTS.scatter([[0, 0, 0, 0.4, modulus]]))
        inner.prepared.clear()
    assert [member() is None for member in known] == [True, True, False, False]


def test_a_worker_goes_on_with_the_member_that_it_has() -> None:
    one, other = ([[0, 0, 0, 0.4, modulus]] for modulus in (1.0, 1.1))
    backend = SerialBackend("token")
    (worker,) = backend.workers()
    waiting = deque(
        PendingState(name, INPUTS.scatter(x), None) for name, x in (("a", one), ("b", other), ("c", one))
    )
    assert [next_for(worker, waiting, [worker]).key for _ in range(3)] == ["a", "c", "b"]


def test_the_store_finds_a_state_by_its_member(tmp_path: Path) -> None:
    def identity(values: Any) -> str:
        return f"cell {SyntheticFamily().at(values).values}"

    folder = ResultStore(tmp_path)
    known = SolvedStore(folder, "family", member=identity)
    inner = SyntheticFamilySolver()
    solver = StoringSolver(MemberSolver(inner), known)
    states = INPUTS.scatter([[0.01, 0, 0, 0.4, 1.0], [0.01, 0, 0, 0.4, 1.2], [0.01, 0, 0, 0.55, 1.75]])
    first = solver.solve(solver.prepare(SyntheticFamily()), states, fields=True)
    again = solver.solve(solver.prepare(SyntheticFamily()), states, fields=True)
    assert known.found == 2  # a member that cannot be made is no result
    assert len(inner.prepared) <= 4
    for name, array in flatten_response(first.response).items():
        np.testing.assert_array_equal(array, flatten_response(again.response)[name])
    # A cell of its own with the same numbers is the same member.
    alone = SolvedStore(folder, identity([0.4, 1.2]))
    assert alone.find("", states[1:2].with_parameters(None), None) is not None
    assert SolvedStore(folder, "family").find("", states[:1], None) is None


@pytest.mark.parametrize("sampler", [RandomStates, Active])
def test_other_samplers_draw_over_the_parameters(sampler: Callable[..., Any]) -> None:
    requests = sampler(INPUTS, count=40, seed=1).ask()
    x = np.array([request.x for request in requests])
    assert len(x) >= 6
    shares = INPUTS.to_unit(x)
    assert ((shares >= 0) & (shares <= 1)).all()
    assert (np.ptp(shares, axis=0) > 0.5).all()


def test_sweeps_from_rest_refuse_parameters() -> None:
    with pytest.raises(
        ConfigurationError, match=r"no parameters of the cell \(porosity, modulus\); take another"
    ):
        DensitySweep(INPUTS, step={name: 0.1 for name in INPUTS.names})
