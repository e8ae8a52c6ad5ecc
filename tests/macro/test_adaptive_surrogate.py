"""A macro run that leaves the sampled range and learns on the way, against the cell's own law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.law import CellLaw
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.direct import AdaptiveSurrogate
from porocore.macro.laws.macro_law import AdaptiveLaw, ClosedLaw
from porocore.macro.problem import TimePlan
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.states import MacroState, Status
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.cell import IDENTITY, SOLID_FRACTION, respond
from porocore.testing.synthetic.response import CONDUCTIVITY, confined_column
from porocore_fem_skfem.macro import SkfemMacroSolver

#: Far less than the column below needs.
INPUTS = InputSpace(("H22", "p"), (-0.06, -0.01), (0.02, 0.06))
CLOSURE = PotentialClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
PROBLEM = confined_column(
    2, -0.12, time=TimePlan(end=20, step=5, ramp_increments=2, ramp_step=1, profiles=(4,))
)


class Cell(CellLaw):
    """The cell's own law, without range."""

    identity = IDENTITY

    def predict(self, states, *, tangent=True):
        return respond(states)


class ClosedFormSolver(CellSolver):
    """Solves the made-up cell down to an edge."""

    edge = -1.0

    def prepare(self, cell):
        return None

    def conductivity(self, prepared):
        return CONDUCTIVITY

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        response = respond(states)
        if states.grad_u[0, 1, 1] < self.edge:
            response.status[0] = int(Status.unstable)
        field = CellField(states.grad_u[0].copy(), float(states.p[0]), "eighth", np.zeros((2, 3)))
        return CellSolution(response, [field])


def make():
    return ClosedFormSolver(), None


def base():
    rng = np.random.default_rng(0)
    x = np.array(INPUTS.lower) + rng.random((24, 2)) * (np.array(INPUTS.upper) - np.array(INPUTS.lower))
    corners = [[a, b] for a in (-0.06, 0.02) for b in (-0.01, 0.06)]
    states = INPUTS.scatter(np.concatenate([corners, x]))
    return TrainingSet(states, respond(states), INPUTS, respond(MacroState.zeros(1)), IDENTITY, {})


def fresh():
    return PolynomialSurrogate(model="potential")


@pytest.fixture
def dataset(tmp_path):
    return Dataset.create(tmp_path / "fallback.h5", inputs=INPUTS, identity="x")


@pytest.fixture
def fallback(dataset):
    with CellPool(make) as pool:
        yield AdaptiveSurrogate(pool, dataset, base(), fresh, 0)


def law_of(fallback, closure=CLOSURE):
    return AdaptiveLaw(fallback.known(fresh().fit(base(), seed=0)), closure, fallback, name="learning")


def solve(law):
    solver = SkfemMacroSolver()
    return solver.solve(solver.prepare(PROBLEM), law).history


def test_the_column_settles_as_with_the_cell_itself(fallback, dataset):
    exact = solve(ClosedLaw(Cell(), CLOSURE))
    plain = solve(ClosedLaw(fresh().fit(base(), seed=0), CLOSURE))
    assert plain.flagged.max() == pytest.approx(1)
    learned = solve(law_of(fallback))
    assert learned.flagged.max() == 0
    assert np.abs(learned.settlement[1:] / exact.settlement[1:] - 1).max() < 5e-3
    assert np.abs(learned.pressure_max - exact.pressure_max).max() < 5e-3 * exact.pressure_max.max()
    work = fallback.work
    assert work.solves == len(dataset) > 0
    assert work.numbers()["learned"] == work.solves
    # A cell for each quadrature point outside, in each iteration, would be thousands.
    assert work.solves < 40


def test_cells_are_solved_until_the_estimated_errors_are_within_the_tolerance(dataset):
    """With few cells, and none beside one that is known."""
    data = replace(base(), tolerance=0.01)
    with CellPool(make) as pool:
        refine = AdaptiveSurrogate(pool, dataset, data, fresh, 0)
        law = AdaptiveLaw(fresh().fit(data, seed=0), CLOSURE, refine, name="learning")
        learned = solve(law)
        assert law.refine(data.states[:3]) is None
    exact = solve(ClosedLaw(Cell(), CLOSURE))
    assert learned.flagged.max() == 0
    assert np.abs(learned.settlement[1:] / exact.settlement[1:] - 1).max() < 5e-3
    assert 0 < refine.work.solves < 40


@pytest.mark.slow
def test_the_paper_closure_learns_as_well(fallback):
    closure = MeanGradientClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    exact = solve(ClosedLaw(Cell(), closure))
    learned = solve(law_of(fallback, closure))
    assert learned.flagged.max() == 0
    assert np.abs(learned.settlement[1:] / exact.settlement[1:] - 1).max() < 5e-3


@pytest.mark.slow
def test_what_was_solved_is_known_the_next_time(fallback, dataset):
    solve(law_of(fallback))
    solved = len(dataset)
    with CellPool(make) as pool:
        again = AdaptiveSurrogate(pool, Dataset.open(dataset.path), base(), fresh, 0)
        repeated = solve(law_of(again))
    assert repeated.flagged.max() == 0
    assert again.work.reused == solved
    assert again.work.solves < solved / 4


def test_cells_that_are_no_stable_equilibrium_are_kept_and_not_learned_from(fallback, dataset, monkeypatch):
    monkeypatch.setattr(ClosedFormSolver, "edge", -0.1)
    history = solve(law_of(fallback))
    numbers = fallback.work.numbers()
    assert numbers["learned"] < numbers["solves"] == len(dataset)
    assert history.flagged[-1] > 0  # flagged: nothing could be learned there
    assert numbers["solves"] - numbers["learned"] < 12  # and it does not try again and again


def test_states_that_move_what_was_not_sampled_cannot_be_learned(fallback, dataset):
    H = np.zeros((2, 3, 3))
    H[:, 0, 1] = 0.1
    assert fallback(MacroState(H, np.zeros(2))) is None
    assert len(dataset) == 0


def test_a_law_that_changes_moves_no_fluid(fallback):
    """After an exchange, the stored fluid of the last accepted time is what the new cell law says of it."""
    law = law_of(fallback)
    states = INPUTS.scatter(np.array([[-0.1, 0.05]]))
    memory = law.initial(1)
    response = law.respond(states, np.zeros((1, 3)), memory)
    assert response.flagged.all()
    memory = law.before_accept(response, response.memory)
    assert memory is not None
    still = law.respond(states, np.zeros((1, 3)), memory)
    assert still.storage == pytest.approx(0, abs=1e-15)
    assert not still.flagged.any()
