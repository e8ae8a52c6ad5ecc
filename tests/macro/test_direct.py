"""Direct FE² as a cell law: which states are solved, from where, and what becomes of cells without solution."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.files.store import ResultStore
from porocore.errors import PorocoreError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.law import CellLaw
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.composed import TurnedLaw
from porocore.macro.laws.direct import GRID, DirectCellLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import MemberSolver
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import BodyPlace, CellResponse, MacroState, Status
from porocore.testing.synthetic import family
from porocore.testing.synthetic.cell import SOLID_FRACTION, respond
from porocore.testing.synthetic.response import CONDUCTIVITY

REST = respond(MacroState.zeros(1))
CLOSURE = PotentialClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)


@dataclass
class Diary:
    """Of every solve: H22, p, and the H22 that it started from."""

    solves: list[tuple[float, float, float | None]] = field(default_factory=list)
    #: Below this H22 there is no solution, and just above it an unstable one.
    edge: float = -0.5
    raise_at: float | None = None


class ClosedFormSolver(CellSolver):
    """Solves the made-up cell; its field knows the state that it belongs to."""

    def __init__(self, diary):
        self.diary = diary

    def prepare(self, cell):
        return None

    def conductivity(self, prepared):
        return CONDUCTIVITY

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        before = start[0]
        strain, p = float(states.grad_u[0, 1, 1]), float(states.p[0])
        self.diary.solves.append((strain, p, None if before is None else float(before.grad_u[1, 1])))
        if self.diary.raise_at is not None and strain < self.diary.raise_at:
            raise ArithmeticError("a pivot vanished")
        if strain < self.diary.edge:
            response = respond(states)
            tangent_parts = {
                name: value * np.nan for name, value in vars(response.tangent).items() if value is not None
            }
            empty = CellResponse(
                response.mean_grad * np.nan,
                np.array([int(Status.overlap)]),
                response.potential * np.nan,
                response.stress * np.nan,
                response.fluid_volume * np.nan,
                type(response.tangent)(**tangent_parts),
            )
            return CellSolution(empty, [None])
        response = respond(states)
        if strain < self.diary.edge + 0.05:
            response.status[0] = int(Status.unstable)
        return CellSolution(
            response, [CellField(states.grad_u[0].copy(), p, "eighth", strain * np.ones((2, 3)))]
        )


def make(diary):
    """In this process, so that the diary is shared."""
    return ClosedFormSolver(diary), None


@pytest.fixture
def diary():
    return Diary()


@pytest.fixture
def law(diary):
    with CellPool(make, (diary,)) as pool:
        yield DirectCellLaw(pool, REST, "cell")


def along(*H22, p=0.01):
    H = np.zeros((len(H22), 3, 3))
    H[:, 1, 1] = H22
    return MacroState(H, np.full(len(H22), p))


def test_the_responses_are_those_of_the_cell(law):
    rng = np.random.default_rng(0)
    states = MacroState(0.1 * rng.standard_normal((5, 3, 3)), 0.1 * rng.standard_normal(5))
    got, exact = law.predict(states), respond(states)
    for name in ("mean_grad", "potential", "stress", "fluid_volume"):
        np.testing.assert_allclose(getattr(got, name), getattr(exact, name), rtol=0, atol=1e-15)
    for name, value in vars(exact.tangent).items():
        if value is None:
            continue
        np.testing.assert_allclose(getattr(got.tangent, name), value, rtol=0, atol=100 * GRID)
    assert law.predict(states, tangent=False).tangent is None
    assert isinstance(law, CellLaw)


def test_equal_states_are_solved_once_and_given_to_every_point(law, diary):
    states = along(-0.1, -0.2, -0.1 + 1e-14, -0.2, -0.1)
    states.grad_u[:, 0, 1] = 1e-15 * np.arange(5)  # round-off across the section
    got = law.predict(states)
    assert sorted(H for H, *_ in diary.solves) == pytest.approx([-0.2, -0.1])
    exact = respond(states)
    np.testing.assert_allclose(got.stress, exact.stress, rtol=0, atol=1e-15)
    np.testing.assert_allclose(got.fluid_volume, exact.fluid_volume, rtol=0, atol=1e-15)
    assert (law.work.points, law.work.solves, law.work.failed) == (5, 2, 0)


def test_round_off_does_not_turn_an_eighth_of_the_cell_into_a_whole_one(law):
    """What reaches the solver has exact zeros, by which it knows that the symmetries are kept."""
    seen = []
    submit = law.pool.submit
    law.pool.submit = lambda key, state, start: (seen.append(state), submit(key, state, start))
    states = along(-0.1)
    states.grad_u[0] += 1e-15 * (1 - np.eye(3))
    law.predict(states)
    H = seen[0].grad_u[0]
    assert (H[~np.eye(3, dtype=bool)] == 0).all()


def test_the_undeformed_cell_is_known(law, diary):
    got = law.predict(MacroState.zeros(3))
    assert diary.solves == []
    np.testing.assert_array_equal(got.tangent.stress_grad_u[2], REST.tangent.stress_grad_u[0])


def test_every_solve_starts_from_the_last_accepted_state_of_its_point(law, diary):
    rest, first = MacroState.zeros(2), along(-0.05, -0.1)
    law.predict_from(rest, along(-0.06, -0.11))  # an iteration that is not the last
    law.predict_from(rest, first)
    diary.solves.clear()
    law.predict_from(first, along(-0.3, -0.4))  # a step that is refused
    law.predict_from(first, along(-0.12, -0.17))
    starts = {round(H, 10): start for H, _, start in diary.solves}
    assert starts == pytest.approx({-0.3: -0.05, -0.4: -0.1, -0.12: -0.05, -0.17: -0.1})


def test_accepted_states_are_not_solved_again(law, diary):
    """A step begins by asking for the state at which the last one ended, and the response is the same."""
    first = along(-0.05, -0.1)
    answer = law.predict_from(MacroState.zeros(2), first)
    diary.solves.clear()
    again = law.predict_from(first, first)
    assert diary.solves == []
    np.testing.assert_array_equal(again.tangent.stress_grad_u, answer.tangent.stress_grad_u)
    law.predict_from(first, along(-0.07, -0.12))
    law.predict_from(first, first)  # after a refused step
    assert len(diary.solves) == 2


def test_after_a_restart_the_first_solves_begin_at_the_undeformed_cell(law, diary):
    law.predict_from(along(-0.1), along(-0.1))
    law.predict_from(along(-0.1), along(-0.12))
    assert [start for *_, start in diary.solves] == [None, pytest.approx(-0.1)]


def test_only_what_can_be_a_start_is_kept(law):
    before = MacroState.zeros(1)
    for k in range(1, 40):
        law.predict_from(before, along(-0.005 * k - 0.001))
        states = along(-0.005 * k)
        law.predict_from(before, states)
        before = states
    assert len(law._known) <= 2


def test_a_cell_without_solution_is_nan_in_its_row_and_is_counted(law, diary):
    diary.edge = -0.3
    got = law.predict(along(-0.1, -0.35, -0.28))
    assert got.status.tolist() == [Status.converged, Status.overlap, Status.unstable]
    assert got.flagged.tolist() == [False, False, True]
    assert np.isnan(got.stress[1]).all()
    assert np.isfinite(got.stress[[0, 2]]).all()
    assert law.work.failed == 1
    assert law.work.counts == {Status.converged: 1, Status.overlap: 1, Status.unstable: 1}


@pytest.mark.parametrize("wild", [np.nan, np.inf, -1e9])
def test_a_wild_iterate_is_refused_without_a_solve(law, diary, wild):
    got = law.predict(along(-0.1, wild))
    assert len(diary.solves) == 1
    assert got.status[1] == Status.inverted
    assert np.isnan(got.stress[1]).all()
    assert np.isfinite(got.stress[0]).all()


@pytest.mark.parametrize("closure", [PotentialClosure, MeanGradientClosure])
def test_the_direct_law_closes_like_any_cell_law(law, closure):
    closed = ClosedLaw(law, closure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY), name="direct")
    states, grad_p = along(-0.1, -0.2, p=0.05), np.ones((2, 3))

    class Exact(CellLaw):
        identity = "exact"

        def predict(self, states, *, tangent=True):
            return respond(states)

    other = ClosedLaw(Exact(), closed.closure)
    got, expected = (one.respond(states, grad_p, one.initial(2)) for one in (closed, other))
    np.testing.assert_allclose(got.stress, expected.stress, atol=1e-11)
    np.testing.assert_allclose(got.storage, expected.storage, atol=1e-11)
    np.testing.assert_allclose(got.tangent.flux_grad_u, expected.tangent.flux_grad_u, atol=1e-10)
    assert closed.identity != other.identity


def test_the_batch_tells_how_far_it_is(law):
    told = []
    law.on_work = told.append
    law.predict(along(-0.1, -0.2, -0.3, -0.1))
    assert told == [f"cell {done} of 3 of this iteration" for done in (1, 2, 3)]


def test_an_exception_of_the_solver_is_an_error_that_says_so(law, diary):
    diary.raise_at = -0.2
    with pytest.raises(PorocoreError, match=r"the cell solver raised ArithmeticError .* a pivot vanished"):
        law.predict(along(-0.1, -0.25))


def test_what_another_run_has_solved_comes_from_the_store(diary, tmp_path):
    """With the same bits and counts; a state that was reached from elsewhere is another one."""
    runs, other = [], Diary()
    for each in (diary, other):
        known = SolvedStore(ResultStore(tmp_path), "cell")
        with CellPool(make, (each,), known=known) as pool:
            law = DirectCellLaw(pool, REST, "cell")
            steps = [MacroState.zeros(3), along(-0.1, -0.2, -0.6), along(-0.15, -0.25, -0.3)]
            found = [law.predict_from(*pair) for pair in itertools.pairwise(steps)]
            runs.append((found, law.work.numbers(), known.found))
    (first, counts, none), (again, counts_again, taken) = runs
    assert len(diary.solves) == taken == counts["solves"] == 6
    assert (none, other.solves) == (0, [])
    assert counts_again == counts
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.stress, two.stress)
        np.testing.assert_array_equal(one.tangent.stress_grad_u, two.tangent.stress_grad_u)
    with CellPool(make, (other,), known=SolvedStore(ResultStore(tmp_path), "cell")) as pool:
        DirectCellLaw(pool, REST, "cell").predict_from(along(-0.1), along(-0.15))
    assert len(other.solves) == 1


def make_family():
    solver = MemberSolver(family.SyntheticFamilySolver())
    return solver, solver.prepare(family.SyntheticFamily())


def test_each_point_has_the_cell_of_its_parameters():
    """Points that agree share a solve; the cell at rest is that of the point, too."""
    theta = np.array([[0.4, 1.0], [0.4, 1.0], [0.35, 1.3], [0.35, 1.3], [0.1 + 0.2, 0.7]])
    H = np.zeros((5, 3, 3))
    H[[0, 1, 3], 1, 1] = -0.05
    states = MacroState(H, np.array([0.1, 0.1, 0.0, 0.1, 0.0]), theta)
    rest = family.respond(MacroState.zeros(1).with_parameters([0.45, 1.25]))
    with CellPool(make_family, fields=True, executor="serial") as pool:
        law = DirectCellLaw(pool, rest, "family")
        found = law.predict(states)
        assert law.work.solves == 4
        before = replace(states, grad_u=0.5 * H)
        again = law.predict_from(before, states)
    expected = family.respond(states)
    for name in ("potential", "stress", "fluid_volume", "mean_grad"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    np.testing.assert_array_equal(found.stress[4], family.respond(states[4:]).stress[0])


def test_a_cell_that_turns_starts_from_its_own_last_state(law, diary):
    """Stretched by 0.1 along y; then its axes turn by a right angle, and it is stretched by 0.11 along its own x."""
    turned, still = TurnedLaw(ClosedLaw(law, CLOSURE)), np.zeros((1, 3))
    quarter = np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    region = np.zeros(1, dtype=np.int64)
    first = replace(along(0.1), place=BodyPlace(region, np.eye(3)[None]))
    memory = turned.respond(first, still, turned.initial_at(first)).memory
    turned.respond(replace(along(0.11), place=BodyPlace(region, quarter)), still, memory)
    assert [start for *_, start in diary.solves] == [None, pytest.approx(0.1)]
    assert diary.solves[1][0] == pytest.approx(0.0)
