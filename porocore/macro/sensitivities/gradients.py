"""Gradients of sums over the histories (GradientPass): a recursion backwards over the steps of a run.

A step solves R_n(x_n, m_{n−1}, θ) = 0, and the law remembers m_n = M(x_n, m_{n−1}, θ). The adjoint unknowns λ_n solve
J_nᵀ λ_n = −g_n, where g_n are the weights of x_n in a sum, with those by way of m_n and all later steps. Each unknown
then takes its share of λ_n · ∂R_n/∂θ; so a sum costs one linear solve a step, whatever the number of unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.core.units.results import spoken
from porocore.errors import SolveError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.sensitivities import BoundaryChange, HistoryWeights, LoadChange, MacroChange
from porocore.macro.composition.body_fields import BodyFields
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.linearisation import Linearisation, Linearisations
from porocore.macro.sensitivities.adjoint_equations import AdjointEquations
from porocore.macro.sensitivities.directions import Directions
from porocore.macro.sensitivities.history_rows import HistoryRows, RowWeights
from porocore.macro.sensitivities.point_weights import MemoryWeights, PointWeights
from porocore.macro.sensitivities.tape import RunTape, TapedStep
from porocore.macro.sensitivities.unit_changes import UnitChanges, UnitDerivatives
from porocore.states import Array


class GradientPass:
    """Gradients of sums over the histories of one run by its unknowns.

    Parameters
    ----------
    d, body, law
        Of the run.
    changes
        The unknowns.

    Raises
    ------
    ConfigurationError
        An unknown is of what the problem does not have.
    """

    def __init__(
        self, d: Discretisation, body: BodyFields, law: MacroLaw, changes: Sequence[MacroChange]
    ) -> None:
        self._d, self._law = d, law
        self._directions = Directions(d, body, law, changes)
        self._unit = UnitChanges(self._directions.at_first)
        self._loaded = [j for j, each in enumerate(changes) if isinstance(each, LoadChange | BoundaryChange)]
        self._still = d.loads(0.0 * d.boundary.amplitudes(d.problem, 0.0))
        self._linearisations = Linearisations(d, law, varies=body.varies)
        self._transposed: tuple[Linearisation, object] | None = None

    def gradients(self, tape: RunTape, weights: HistoryWeights) -> Array:
        """Return the gradients (f, k) of f sums.

        Raises
        ------
        SolveError
            A linear system has no solution.
        """
        d, f = self._d, weights.count
        rows = HistoryRows(tape.history, weights)
        #: Shares of this process, and of all together.
        self._own = np.zeros((f, len(self._directions)))
        self._shared = np.zeros_like(self._own)
        self._begun = np.zeros(f, bool)
        self._memory = [MemoryWeights.zeros(d.n_points)] * f
        for number in range(len(tape.steps), 0, -1):
            step = tape.steps[number - 1]
            try:
                self._step(step, rows.step(number, step.x, step.dt))
            except StepFailed as failure:
                when = spoken().text(step.time, "time", 6)
                raise SolveError(f"the gradients at t = {when} have no solution: {failure}") from failure
        first = rows.start(tape.start) + (self._at_rest(tape.steps[0]) if tape.steps else 0.0)
        first = first[: d.owned]
        for j, start in enumerate(self._directions.start()):
            if start.any():
                self._own[:, j] += start[: d.owned] @ first
        return np.asarray(self._shared + d.communicator.sum(self._own))

    def _step(self, step: TapedStep, rows: RowWeights) -> None:
        """Go back over one step."""
        d = self._d
        self._begun |= rows.begun
        begun = np.flatnonzero(self._begun)
        if not len(begun):
            return
        found = self._unit.at_step(self._law, step.states, d.states(step.x)[1], step.memory)
        equations, changes = self._equations(step, found), self._directions.points(step.states)
        loads = self._loads(step)
        for i, sum_ in enumerate(begun):
            memory = self._memory[sum_]
            known = equations.of_residual(rows.residual[:, sum_])
            if rows.points is not None:
                known = known.plus(rows.points[sum_])
            tangent = equations.tangent
            states = known.of_states(tangent).plus(memory.of_states(tangent, found.fixed))
            weights = rows.x[:, sum_] + equations.of_unknowns(states)
            weights = weights + equations.following(rows.residual[:, sum_])
            solution, by_solution, total = equations.solved(weights, again=i > 0)
            at_points = known.plus(by_solution)
            self._add_loads(
                sum_, loads, solution + rows.residual[:, sum_], total, rows.outflow[sum_] * step.dt
            )
            shares = found.of_changes(at_points, memory)
            self._own[sum_] += self._unit.of_unknowns(d.weights[:, None] * shares, changes)
            self._memory[sum_] = found.of_memory(at_points)

    def _equations(self, step: TapedStep, found: UnitDerivatives) -> AdjointEquations:
        d, tangent = self._d, found.response.tangent
        assert tangent is not None
        known = self._linearisations
        linear = known.begin(step.dt, step.loads) or known.at(found.response, step.dt, step.x, step.loads)
        if self._transposed is None or self._transposed[0] is not linear:
            self._transposed = linear, d.transposed(linear.system)
        return AdjointEquations(d, self._transposed[1], tangent, step.x, step.dt, step.loads, self._still)

    def _loads(self, step: TapedStep) -> list[tuple[int, Array, Array, float]]:
        """Return for each unknown of the loads its prescribed values, its part of the residual, and its outflow."""
        d, nothing = self._d, PointWeights.zeros(self._d.n_points)
        found = []
        for j in self._loaded:
            own = self._directions.loads_of(j, step.time)
            external = d.residual(nothing, step.dt, own, step.x).values
            found.append((j, own.values, external, d.outflow(own)))
        return found

    def _add_loads(
        self,
        sum_: int,
        loads: list[tuple[int, Array, Array, float]],
        rows: Array,
        total: Array,
        outflow: float,
    ) -> None:
        """Add the shares of the unknowns of the loads; ``total`` are derivatives by prescribed values."""
        d = self._d
        owned = d.prescribed < d.owned
        for j, values, external, flow in loads:
            self._own[sum_, j] += total[d.prescribed[owned]] @ values[owned]
            self._own[sum_, j] += external[: d.owned] @ rows[: d.owned]
            self._shared[sum_, j] += outflow * flow

    def _at_rest(self, first: TapedStep) -> Array:
        """Return the weights (local unknowns, f) of the initial state by way of its memory, the law's answer to it."""
        d, states = self._d, first.memory.states
        found, changes = self._unit.at_rest(self._law, states), self._directions.points(states)
        tangent = found.response.tangent
        assert tangent is not None
        weights = np.zeros((len(d.unknowns), len(self._memory)))
        for sum_, memory in enumerate(self._memory):
            by_states = memory.of_states(tangent, found.fixed)
            weights[:, sum_] = d.residual(by_states, -1.0, self._still).values
            shares = found.of_memory_changes(memory)
            self._own[sum_] += self._unit.of_unknowns(d.weights[:, None] * shares, changes)
        return weights
