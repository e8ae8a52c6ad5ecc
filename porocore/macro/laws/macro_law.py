"""Macroscopic law of a cell law and a closure (ClosedLaw); the same for users' own solvers (Law)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from porocore.cell.family.family import CellParameter, number, require_known, values_of_states
from porocore.core.echo import echo
from porocore.core.fields import Batch, provided
from porocore.core.inputs import given_states
from porocore.core.units import ResultUnits
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    CellLaw,
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    UndeformedCells,
    fingerprint,
)
from porocore.macro.laws.closure import CellChanges, Closure, ClosurePoints, cell_changes
from porocore.macro.laws.composed import BoundLaw
from porocore.plugins.border import check_prediction, prediction_of
from porocore.states import Array, CellResponse, IntArray, MacroState

#: Points that a closure treats at once, whose tensors stay in the cache: 80,000 points take 0.30 s in place of 0.49.
CHUNK = 5_000


class ClosedLaw(MacroLaw):
    """Macroscopic law of a cell law and a closure.

    Where the cell law has parameters, the closure takes φ_s and K of each point from the cell law too.

    Parameters
    ----------
    cell_law
        Predicts the responses of the cell; it is given the last accepted states too.
    closure
        Makes stress, storage and flux of them.
    identity
        Hash that distinguishes this cell law from every other, such as that of the file it was loaded from; without
        it the cell law's own is taken (for a surrogate that is the cell's, whatever its weights).
    name
        For reports.

    Raises
    ------
    ConfigurationError
        The cell law does not provide what the closure needs.
    """

    def __init__(
        self, cell_law: CellLaw, closure: Closure, *, identity: str | None = None, name: str | None = None
    ) -> None:
        self.cell_law, self.closure = cell_law, closure
        self.name = closure.name if name is None else name
        self.noise, self.parameters = cell_law.noise, cell_law.parameters
        self.internal = closure.internal
        self.identity = fingerprint(closure.identity, cell_law.identity if identity is None else identity)
        self._rest: CellResponse | None = None
        #: Parameters of points and their undeformed cells, of the last two that were asked for.
        self._known: list[tuple[Array, UndeformedCells]] = []
        self._begin()

    def _begin(self) -> None:
        """Ask the cell law for its response at rest, which has to have what the closure reads."""
        if not self.parameters:
            self._rest = prediction_of(self.cell_law, MacroState.zeros(1))
            self.closure.check(self._rest, type(self.cell_law).__name__)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest with the cell law's own response there, so that its error stores no fluid.

        Raises
        ------
        ValueError
            The law has parameters, which :meth:`initial_at` is given.
        """
        if self._rest is None:
            raise ValueError(f"expected the parameters {', '.join(self.parameters)}; call initial_at")
        rest = replace(self._rest, tangent=None, extrema=None)[np.zeros(n, dtype=np.int64)]
        return self.closure.memory(MacroState.zeros(n), rest, self._porosity(None, n))

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, of a cell law with parameters by its response to each point's own.

        Raises
        ------
        ConfigurationError
            The cell law does not provide what the closure needs.
        """
        if not self.parameters:
            return self.initial(len(points))
        rest = points.at_rest()
        if len(rest):
            self.closure.check(prediction_of(self.cell_law, rest[:1]), type(self.cell_law).__name__)
        found = prediction_of(self.cell_law, rest, tangent=False)
        porosity = self._porosity(self._cells(rest.parameters), len(rest))
        return self.closure.memory(rest, replace(found, extrema=None), porosity)

    def porosity(self, parameters: Array) -> Array:
        """Return φ_f (n,) of the undeformed cells with ``parameters`` (n, m), of a cell law that has some."""
        return provided(self._cells(parameters)).porosity

    def _porosity(self, cells: UndeformedCells | None, n: int) -> Array:
        """Return φ_f (n,) of the undeformed cells of n points."""
        return np.full(n, 1 - self.closure.solid_fraction_of(cells))

    def _cells(self, parameters: Array | None) -> UndeformedCells | None:
        """Return the undeformed cells with ``parameters`` (n, m); None where all are that of the closure's constants.

        Raises
        ------
        ConfigurationError
            The parameters are missing, or the cell law does not provide the cells.
        """
        if not self.parameters:
            return None
        law, names = type(self.cell_law).__name__, ", ".join(self.parameters)
        if parameters is None:
            raise ConfigurationError(
                f"the cell law {law} has the parameters {names}, but no values were given"
            )
        for known, cells in self._known:
            if np.array_equal(known, parameters):
                return cells
        found = self.cell_law.undeformed(parameters)
        if found is None:
            raise ConfigurationError(
                f"the cell law {law} has the parameters {names}, but does not provide porosity and conductivity of "
                "the undeformed cell for them"
            )
        self._known = [(parameters, found), *self._known[:1]]
        return found

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """See :class:`MacroLaw`; NaN where the cell law has no values."""
        return self.respond_to_each(states, [grad_p], memory, step=step, tangent=tangent)[0]

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """See :class:`MacroLaw`; the cell law is asked once."""
        # Newton's iteration may ask for anything; what is not finite is for the macro solver to refuse.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            # Parameters that are missing are refused before the cell law is asked.
            cells = self._cells_of(states, memory)
            cell = self._predicted(states, memory, tangent)
            points = [ClosurePoints(states, cell, grad_p, memory, *cells) for grad_p in gradients]
            return [self._closed(at, tangent) for at in points]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
        *,
        step: Interval | None = None,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives by unknowns; see :class:`MacroLaw`."""
        at, by = self._changed(states, grad_p, memory, changes)
        closed = [
            self.closure.respond_to_changes(at[part], by[part], before[part]) for part in _parts(len(states))
        ]
        if len(closed) == 1:
            return closed[0]
        responses, derivatives = map(list, zip(*closed, strict=True))
        return MacroResponse.concatenate(responses), ResponseChanges.concatenate(derivatives)

    def rest_changes(self, points: MacroState, changes: PointChanges) -> Array:
        """Return the derivatives of the fluid volume at rest, where p = 0 and a modulus changes nothing."""
        if changes.parameters is None or not changes.parameters.any():
            return np.zeros_like(changes.modulus)
        rest = points.at_rest()
        by = self._changed(rest, np.zeros((len(rest), 3)), self.initial_at(rest), changes)[1]
        return self.closure.fluid_changes(by)

    def _changed(
        self, states: MacroState, grad_p: Array, memory: LawMemory, changes: PointChanges
    ) -> tuple[ClosurePoints, CellChanges]:
        """Return what the closure is given at the points, and the changes of the cell's responses."""
        closure, cells = self.closure, self._cells_of(states, memory)
        at = ClosurePoints(states, self._predicted(states, memory, True), grad_p, memory, *cells)
        K = closure.conductivity if at.cells is None else at.cells.conductivity
        undeformed = None if closure.law == "deformed" else K
        return at, cell_changes(self.cell_law, states, at.cell, changes, undeformed, closure.responses)

    def _cells_of(
        self, states: MacroState, memory: LawMemory
    ) -> tuple[UndeformedCells | None, UndeformedCells | None]:
        """Return the undeformed cells of the points, and those of the memory where they are others."""
        before, cells = (self._cells(at.parameters) for at in (memory.states, states))
        return cells, None if before is cells else before

    def _predicted(self, states: MacroState, memory: LawMemory, tangent: bool) -> CellResponse:
        found = self.cell_law.predict_from(memory.states.in_own_axes(), states, tangent=tangent)
        return check_prediction(self.cell_law, found, states)

    def _closed(self, at: ClosurePoints, tangent: bool) -> MacroResponse:
        """Return the response that the closure makes of the cell's, so many points at a time."""
        found = [self.closure.respond(at[part], tangent=tangent) for part in _parts(len(at.states))]
        return found[0] if len(found) == 1 else MacroResponse.concatenate(found)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the cell law knows; see :class:`MacroLaw`."""
        return self.cell_law.reasons(states)


def _parts(n: int) -> list[slice]:
    """Return the parts of n points that a closure treats at once, one at least."""
    if n <= CHUNK:
        return [slice(None)]
    return [slice(first, first + CHUNK) for first in range(0, n, CHUNK)]


class SurrogateRefinement(Protocol):
    """Refinement of a cell law by further states."""

    def __call__(self, states: MacroState) -> CellLaw | None:
        """Return a cell law that is trained on cells at or near n states too; None where none has a solution."""


class AdaptiveLaw(ClosedLaw):
    """A :class:`ClosedLaw` whose cell law is exchanged when a converged step asked it outside its range.

    The step is then solved again from the last accepted time, whose stored fluid is counted by the new cell law, so
    that the exchange itself moves no fluid. This ends when no point is outside any more or nothing more can be
    learned; what is left is flagged as always.

    Parameters
    ----------
    cell_law, closure, identity, name
        See :class:`ClosedLaw`. The identity does not change with what is learned.
    refine
        Asked with the states of the points outside.
    rounds
        Most exchanges in one step.
    """

    def __init__(
        self,
        cell_law: CellLaw,
        closure: Closure,
        refine: SurrogateRefinement,
        *,
        identity: str | None = None,
        name: str | None = None,
        rounds: int = 8,
    ) -> None:
        super().__init__(cell_law, closure, identity=identity, name=name)
        self.refine, self._rounds, self._round = refine, rounds, 0

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Refine the surrogate where the step left its range; see :class:`~porocore.interfaces.law.MacroLaw`."""
        outside = np.flatnonzero(response.flagged)
        if not len(outside) or self._round >= self._rounds:
            self._round = 0
            return None
        refined = self.refine(response.memory.states[outside])
        if refined is None:
            self._round = 0
            return None
        self._round += 1
        self.cell_law, self._known = refined, []
        self._begin()
        known = replace(prediction_of(refined, memory.states, tangent=False), doubt=None)
        return self.closure.memory(memory.states, known, memory.fluid_volume)


@dataclass(frozen=True, eq=False)
class LawTangent(Batch):
    """Exact derivatives of a :class:`LawResponse` with respect to (H, p); response indices first.

    Attributes
    ----------
    stress_grad_u : (n, 3, 3, 3, 3)
        ∂P_E,ij / ∂H_kl [E].
    stress_p : (n, 3, 3)
        ∂P_E,ij / ∂p [-].
    fluid_volume_grad_u : (n, 3, 3)
        ∂φ / ∂H_kl [-].
    fluid_volume_p : (n,)
        ∂φ / ∂p [1/E].
    conductivity_grad_u : (n, 3, 3, 3, 3)
        ∂K_ref,ij / ∂H_kl.
    conductivity_p : (n, 3, 3)
        ∂K_ref,ij / ∂p.
    """

    stress_grad_u: Array
    stress_p: Array
    fluid_volume_grad_u: Array
    fluid_volume_p: Array
    conductivity_grad_u: Array
    conductivity_p: Array


@dataclass(frozen=True, eq=False)
class LawResponse(Batch):
    """Response of a :class:`Law` at n states, dimensionless; NaN where there is none.

    Attributes
    ----------
    stress : (n, 3, 3)
        P_E, total first Piola–Kirchhoff stress, tension positive [E].
    fluid_volume : (n,)
        φ, current fluid volume per reference volume [-].
    conductivity : (n, 3, 3)
        K_ref, with which q = −K_ref ∇_X p is the flux through reference area; K in the linear law.
    deformation : (n, 3, 3)
        F̄ = I + H + <∇u¹>_s/φ_s (I + H in the linear law).
    doubt : (n,) int
        Reasons not to rely on the state, :class:`~porocore.Doubt` as a number; 0: none.
    memory
        State of the law, from which a further response counts the fluid.
    tangent
        Derivatives; None if they were not asked for.
    """

    stress: Array
    fluid_volume: Array
    conductivity: Array
    deformation: Array
    doubt: IntArray
    memory: LawMemory
    tangent: LawTangent | None = None

    def __len__(self) -> int:
        return len(self.fluid_volume)

    @property
    def flagged(self) -> npt.NDArray[np.bool_]:
        """States that are not to be relied on, (n,) bool."""
        flagged: npt.NDArray[np.bool_] = self.doubt != 0
        return flagged


class Law:
    """Stress, fluid volume and conductivity of the porous body as functions of (H, p), for n states at once.

    The macro solver evaluates the same law at its quadrature points. ``porocore.Study.law`` returns it. The law of a
    family of cells has :attr:`parameters`, which are given with each state, or bound by :meth:`at`.

    Parameters
    ----------
    law
        Macroscopic law.
    porosity
        φ_f, fluid volume of the undeformed cell; of a law with parameters a function of their values (n, m), with one
        for each row.
    units
        Units of the study, which responses do not have: ``law.units.factor("stress")`` takes their stress to its unit.
    ranges
        Parameters of the cell, outside whose ranges values are refused.

    Examples
    --------
    >>> from porocore import Law
    >>> from porocore.testing.synthetic.response import linear_law
    >>> law = Law(linear_law(), porosity=0.4123)
    >>> pressed = [np.diag([0.0, -0.01, 0.0]), np.diag([0.0, -0.02, 0.0])]
    >>> found = law.response(pressed, p=[0.002, 0.0])
    >>> found.stress[:, 1, 1].round(5), found.fluid_volume.round(5), found.conductivity[0].diagonal()
    (array([-0.00603, -0.00888]), array([0.40506, 0.39644]), array([1.94, 1.94, 1.94]))
    >>> found.tangent.stress_grad_u.shape, found.flagged
    ((2, 3, 3, 3, 3), array([False, False]))

    A law with parameters:

    >>> from porocore.testing.synthetic.cell import parametric_law, porosity
    >>> family = Law(parametric_law(), lambda values: porosity(values[:, 0]))
    >>> family.parameters
    ('radius', 'stiffness')
    >>> soft = family.at(stiffness=0.5)
    >>> soft.response(pressed, parameters={"radius": [0.2, 0.25]}).fluid_volume.round(4)
    array([0.2836, 0.404 ])
    >>> round(soft.at(radius=0.2).porosity, 4)
    0.2865
    """

    def __init__(
        self,
        law: MacroLaw,
        porosity: float | Callable[[Array], Array],
        units: ResultUnits | None = None,
        ranges: Sequence[CellParameter] = (),
    ) -> None:
        self._law, self.units = law, units or ResultUnits()
        self._porosity = porosity
        self._ranges = {each.name: each for each in ranges}

    def __repr__(self) -> str:
        of = f" of {', '.join(self.parameters)}" if self.parameters else ""
        return f"<law '{self.name}'{of}>"

    @property
    def name(self) -> str:
        """Name of the law as in a report, such as ``linear``."""
        return self._law.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the cell's parameters that are given with each state; empty if it has none, or all are bound."""
        return self._law.parameters

    @property
    def porosity(self) -> float:
        """Volume share φ_f of the pores of the undeformed cell.

        Raises
        ------
        ConfigurationError
            A parameter of the cell is open.
        """
        if self.parameters:
            raise ConfigurationError(f"the porosity depends on {', '.join(self.parameters)}; at() binds them")
        return float(self._at_rest(MacroState.zeros(1))[0])

    def at(self, values: Mapping[str, float] | None = None, /, **named: float) -> Law:
        """Return the law with some parameters of the cell, or all, bound to constants.

        Parameters
        ----------
        values, **named
            Constants by name; a name with a dot stands in the mapping: ``law.at({"radii.x": 0.2}, poisson_ratio=0.3)``.

        Raises
        ------
        ConfigurationError
            A name is no open parameter, or a value no number within its range.
        """
        if values is not None and not isinstance(values, Mapping):
            raise ConfigurationError(f"expected values by name, such as radius=0.22, got {echo(values)}")
        given = {**(values or {}), **named}
        law = BoundLaw(self._law, given)
        for name, value in given.items():
            self._require_inside(name, np.array([number(name, value)]))
        porosity = self._porosity
        of_all = (lambda open_: porosity(law.completed(open_))) if callable(porosity) else porosity
        return Law(
            law, of_all, self.units, [self._ranges[name] for name in law.parameters if name in self._ranges]
        )

    def response(
        self,
        grad_u: npt.ArrayLike,
        p: npt.ArrayLike = 0.0,
        *,
        parameters: Mapping[str, npt.ArrayLike] | npt.ArrayLike | None = None,
        before: LawResponse | None = None,
        times: tuple[float, float] | None = None,
        tangent: bool = True,
    ) -> LawResponse:
        """Return the response to one state or to n of them.

        Parameters
        ----------
        grad_u : (3, 3) or (n, 3, 3)
            H_ij = ∂u_i/∂X_j.
        p : number or (n,)
            Pore pressure, positive in compression [E].
        parameters
            Values of the open parameters of the cell: by name a number or (n,), or all of them in their order, (m,) or
            (n, m).
        before
            Response of the same n points at the last time; by default they were at rest. It makes a difference with
            the closure ``mean-gradient``, whose fluid volume is summed over the steps as in the macro solver, and with
            a law that relaxes or evolves.
        times
            That last time and the present one; by default the state has stood for long, so that nothing relaxes any
            more, and nothing has evolved.
        tangent
            Compute the derivatives, too.

        Raises
        ------
        ConfigurationError
            The shapes do not belong together, a number is not finite, or a parameter is missing, unknown or outside its
            range.
        """
        states = self._states(grad_u, p, parameters)
        n = len(states)
        if before is not None and len(before) != n:
            raise ConfigurationError(
                f"before: expected the response at the same {n} states, got one at {len(before)}"
            )
        memory = self._law.initial_at(states) if before is None else before.memory
        # The flux under a unit gradient along an axis is a column of −K_ref, and so are its derivatives. The state is
        # that without a flux, which some laws follow.
        units = [np.broadcast_to(axis, (n, 3)) for axis in np.eye(3)] if tangent else []
        step = None if times is None else Interval(*map(float, times))
        found = self._law.respond_to_each(
            states, [np.zeros((n, 3)), *units], memory, step=step, tangent=tangent
        )
        first = found[0]
        tangents = [provided(response.tangent) for response in found] if tangent else []
        return LawResponse(
            stress=first.stress,
            fluid_volume=first.memory.fluid_volume,
            conductivity=first.transformed_conductivity * first.volume_ratio[:, None, None],
            deformation=first.deformation,
            doubt=first.doubt,
            memory=first.memory,
            tangent=_tangent(*tangents) if tangents else None,
        )

    def reasons(
        self,
        grad_u: npt.ArrayLike,
        p: npt.ArrayLike = 0.0,
        *,
        parameters: Mapping[str, npt.ArrayLike] | npt.ArrayLike | None = None,
    ) -> list[str]:
        """Return for each of n flagged states which component drives it out; empty where it is not known."""
        return self._law.reasons(self._states(grad_u, p, parameters))

    def _at_rest(self, states: MacroState) -> Array:
        """Return φ_f of the undeformed cell of each of n states."""
        if not callable(self._porosity):
            return np.full(len(states), self._porosity)
        given = np.zeros((len(states), 0)) if states.parameters is None else states.parameters
        return self._porosity(given)

    def _states(
        self,
        grad_u: npt.ArrayLike,
        p: npt.ArrayLike,
        parameters: Mapping[str, npt.ArrayLike] | npt.ArrayLike | None,
    ) -> MacroState:
        states, names = given_states(grad_u, p), self.parameters
        if not names and parameters is None:
            return states
        if parameters is None:
            raise ConfigurationError(
                f"parameters: missing; the law needs {', '.join(names)}: give them with the states, or bind them "
                "by at()"
            )
        if isinstance(self._law, BoundLaw) and isinstance(parameters, Mapping):
            require_known(parameters, names, self._law.bound)
        values = values_of_states(names, parameters, len(states))
        for name, column in zip(names, values.T, strict=True):
            self._require_inside(name, column)
        return states.with_parameters(values)

    def _require_inside(self, name: str, values: Array) -> None:
        if name in self._ranges and len(values):
            for end in (values.min(), values.max()):
                self._ranges[name].require_inside(float(end))


def _tangent(still: MacroTangent, *columns: MacroTangent) -> LawTangent:
    """Return the derivatives from those without a gradient of the pressure, and under a unit one along each axis."""
    return LawTangent(
        stress_grad_u=still.stress_grad_u,
        stress_p=still.stress_p,
        fluid_volume_grad_u=still.storage_grad_u,
        fluid_volume_p=still.storage_p,
        conductivity_grad_u=-np.stack([column.flux_grad_u for column in columns], axis=2),
        conductivity_p=-np.stack([column.flux_p for column in columns], axis=2),
    )
