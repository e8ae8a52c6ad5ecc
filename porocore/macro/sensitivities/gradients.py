"""Sensitivities over the accepted steps of a run: forwards (tracker), or backwards from its tape.

A step solves R_n(x_n, m_{n−1}, θ) = 0, and the law remembers m_n = M(x_n, m_{n−1}, θ). The adjoint unknowns λ_n solve
J_nᵀ λ_n = −g_n, where g_n are the weights of x_n in a sum, with those by way of m_n and all later steps. Each unknown
then takes its share of λ_n · ∂R_n/∂θ; so a sum costs one linear solve a step, whatever the number of unknowns.

With backward Euler a step solves R(x, m, θ) = 0 for the unknowns x, with m what the law remembers of the last accepted
state. So J δx = −∂R/∂θ − ∂R/∂m δm for each unknown θ, with the tangent J at the solution and the total derivative δm
of the memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.core.units import spoken
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.law import Integrand, LawMemory, MacroLaw, MemoryChanges
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    BoundaryChange,
    HistoryWeights,
    LoadChange,
    MacroChange,
    MacroSensitivities,
)
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.checkpoint import HistoryRecorder, extremes
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.newton import Linearisation, Linearisations, Step
from porocore.macro.sensitivities.changes import Directions, UnitChanges, UnitDerivatives
from porocore.macro.sensitivities.equations import (
    AdjointEquations,
    HistoryRows,
    MemoryWeights,
    PointWeights,
    RowWeights,
    StepEquations,
    changes_at_points,
)
from porocore.states import Array, MacroState


@dataclass(frozen=True, eq=False)
class TapedStep:
    """Accepted step of a run, as a tape keeps it.

    Attributes
    ----------
    x : (local unknowns,)
        Its solution.
    states
        Of the points there, with parameters and places.
    memory
        From which it began.
    time, dt, loads
        Its end, length and loads.
    """

    x: Array
    states: MacroState
    memory: LawMemory
    time: float
    dt: float
    loads: Loads


class RunTape:
    """Record of a run, some 20 numbers for each point and step.

    Attributes
    ----------
    start : (local unknowns,)
        Initial state.
    steps
        Accepted steps.
    history
        Recorder of the histories.
    """

    start: Array
    history: HistoryRecorder

    def __init__(self) -> None:
        self.steps: list[TapedStep] = []

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state."""
        self.start, self.history = x, record

    def renew(self, memory: LawMemory) -> None:
        """Refuse a law that learns during the run: earlier steps cannot be gone over with what it was then.

        Raises
        ------
        ConfigurationError
            Always.
        """
        raise ConfigurationError(
            "gradients: the law learns during the run, so that no pass goes back over its steps; let it learn before, "
            "or ask for sensitivities"
        )

    def add(
        self,
        step: Step,
        memory: LawMemory,
        time: float,
        dt: float,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Add an accepted step that began from ``memory`` and ended at ``time``."""
        self.steps.append(TapedStep(step.x, step.response.memory.states, memory, time, dt, loads))


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


DRAINED = HISTORY_SERIES.index("drained")


class SensitivityRecorder:
    """Recorder of the derivatives of the histories by k unknowns.

    Parameters
    ----------
    record
        Recorder of the histories.
    changes
        The unknowns.
    """

    def __init__(self, record: HistoryRecorder, changes: tuple[MacroChange, ...]) -> None:
        self._record, self._changes = record, changes
        d = record.d
        self._names = list(d.problem.probes), list(d.boundary.supports), list(d.boundary.drains)
        #: Values by unknown of each step: series of the history; probes; reactions and inflows.
        self._rows: list[Array] = []

    def add_start(self, x: Array, changes: list[Array]) -> None:
        """Add the initial state with its derivatives, t = 0."""
        supports, drains = self._names[1:]
        nothing = np.zeros(3 * len(supports) + len(drains))
        places = self._places(x)
        self._rows.append(
            np.stack([np.concatenate([*self._nodal(places, each, 0.0), nothing]) for each in changes])
        )

    def add_step(
        self,
        x: Array,
        changes: list[Array],
        at_points: Sequence[Integrand],
        residuals: list[Array],
        loads: list[Loads],
        dt: float,
    ) -> None:
        """Add an accepted step.

        Parameters
        ----------
        x : (local unknowns,)
            The solution.
        changes, at_points, residuals, loads
            For each unknown the derivative of the solution, of what is integrated, of the residual and of the loads.
        """
        record, places, rows = self._record, self._places(x), []
        for j, change in enumerate(changes):
            left = self._rows[-1][j, DRAINED] + record.outflow(residuals[j], loads[j], dt)
            sums = record.sums(residuals[j], at_points[j], dt)
            rows.append(np.concatenate([*self._nodal(places, change, left), *sums]))
        self._rows.append(np.stack(rows))

    def _places(self, x: Array) -> dict[str, tuple[int, float]]:
        """Return the unknown that each extreme of a solution is, and its sign."""
        return extremes(self._record.d.to_mesh(x), self._record.d.mesh.n_u)

    def _nodal(
        self, places: dict[str, tuple[int, float]], change: Array, drained: float
    ) -> tuple[Array, Array]:
        """Return the derivatives of the series of the history, and those of the probes."""
        moved = self._record.d.to_mesh(change)
        found = {"drained": drained} | {name: sign * moved[i] for name, (i, sign) in places.items()}
        return np.array([found[name] for name in HISTORY_SERIES]), self._record.probe @ moved

    def result(self) -> MacroSensitivities:
        """Return all derivatives."""
        rows = np.swapaxes(np.array(self._rows), 1, 2)
        probes, supports, drains = self._names
        first, widths = len(HISTORY_SERIES), (4, 3, 1)
        found: list[dict[str, Array]] = []
        for names, width in zip((probes, supports, drains), widths, strict=True):
            found.append(
                {name: rows[:, first + i * width : first + (i + 1) * width] for i, name in enumerate(names)}
            )
            first += width * len(names)
        return MacroSensitivities(
            self._changes,
            **{name: rows[:, i] for i, name in enumerate(HISTORY_SERIES)},
            probes=found[0],
            reactions=found[1],
            inflow={name: values[:, 0] for name, values in found[2].items()},
            compression={},
        )


class SensitivityTracker:
    """Derivatives of a run by its unknowns, followed from step to step.

    Parameters
    ----------
    d, body, law, record
        Of the run.
    changes
        The unknowns.

    Raises
    ------
    ConfigurationError
        An unknown is of what the problem does not have.
    """

    def __init__(
        self,
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
        changes: Sequence[MacroChange],
    ) -> None:
        self._d, self._law, self._changes = d, law, tuple(changes)
        self._directions = Directions(d, body, law, changes)
        self._x = self._directions.start()
        self._memory = MemoryChanges.zeros(d.n_points, len(self._x))
        self._record: SensitivityRecorder | None = None

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state, and the memory of it."""
        self._record = SensitivityRecorder(record, self._changes)
        self._record.add_start(x, self._x)
        self.renew(memory)

    def renew(self, memory: LawMemory) -> None:
        """Take another memory of the same state, as of a law that has learned more."""
        states, law = memory.states, self._law
        points = self._directions.points(states)
        still = np.zeros((len(states), 3))
        before = MemoryChanges.zeros(len(states), len(self._x))
        response, fixed = law.respond_to_changes(states, still, law.initial_at(states), points, before)
        assert response.tangent is not None
        self._memory = fixed.moved(response.tangent, *changes_at_points(self._d, self._x))[1]

    def add(
        self,
        step: Step,
        memory: LawMemory,
        time: float,
        dt: float,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Follow an accepted step that began from ``memory`` and ended at ``time``.

        Raises
        ------
        SolveError
            A linear system has no solution.
        """
        d, states = self._d, step.response.memory.states
        points, own = self._directions.points(states), self._directions.loads(time)
        response, fixed = self._law.respond_to_changes(
            states, d.states(step.x)[1], memory, points, self._memory
        )
        try:
            linear = linearisations.begin(dt, loads) or linearisations.at(response, dt, step.x, loads)
            equations = StepEquations(d, linear, response, fixed, step.x, dt, loads, own)
            self._x, total, self._memory, residuals = equations.solved()
        except StepFailed as failure:
            raise SolveError(
                f"the derivatives at t = {spoken().text(time, 'time', 6)} have no solution: {failure}"
            ) from failure
        assert self._record is not None
        self._record.add_step(step.x, self._x, total, residuals, own, dt)

    def result(self) -> MacroSensitivities:
        """Return the derivatives of the histories."""
        assert self._record is not None
        return self._record.result()
