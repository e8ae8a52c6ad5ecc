"""Law of cells whose parameters evolve with the state of the point (EvolvingLaw), implicitly within a step.

θ = θ_old + Δt r(H, p, ∇p, θ; t) at the end of the step, held at the ends of the range of θ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from porocore.core.echo import joined
from porocore.core.fields import Batch, provided
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    ExtendedLaw,
    InternalVariable,
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.laws.rates import Rate, RatePoints, RateSlopes
from porocore.states import Array, Doubt, IntArray, MacroState

Flags = npt.NDArray[np.bool_]
#: A response as 14 numbers, P_E, the fluid taken up, q and W, with derivatives by 13 numbers: H, p and ∇p.
TENSOR, SCALAR, VECTOR, POTENTIAL = slice(0, 9), 9, slice(10, 13), 13


@dataclass(frozen=True, eq=False)
class _Evolved(Batch):
    """Evolving parameters of n points at the end of a step, e of them, and what they follow there.

    Attributes
    ----------
    values : (n, e)
        θ.
    held : (n, e)
        Which stay at an end of their range.
    lost : (n,)
        Points whose equations are not solved.
    rates
        Rates, with an axis of e behind that of the points.
    response, units
        Of the inner law, and its derivatives by the e parameters; None where no rate follows the state.
    """

    values: Array
    held: Flags
    lost: Flags
    rates: RateSlopes
    response: MacroResponse | None = None
    units: ResponseChanges | None = None

    @property
    def by_parameters(self) -> Array:
        """Derivatives of the response by the e parameters (n, 14, e)."""
        n, e = self.values.shape
        return np.zeros((n, 14, e)) if self.units is None else _numbers(self.units)

    @property
    def rates_by_response(self) -> Array:
        """Derivatives of the rates by the response (n, e, 14)."""
        r, shape = self.rates, self.values.shape
        return np.concatenate(
            [r.stress.reshape(*shape, 9), r.fluid_volume[..., None], r.flux, r.potential[..., None]], axis=2
        )

    @property
    def rates_by_state(self) -> Array:
        """Derivatives of the rates by (H, p, ∇p) at the same θ (n, e, 13)."""
        r, shape = self.rates, self.values.shape
        parts = [r.grad_u.reshape(*shape, 9), r.p[..., None], np.zeros((*shape, 3))]
        found: Array = np.concatenate(parts, axis=2)
        if self.response is not None:
            found += self.rates_by_response @ _matrix(self.response)
        return found


class EvolvingLaw(ExtendedLaw):
    """Law of a body whose cells change: some of their parameters follow a rate at each point.

    They begin at the values that are given with the states. The constants of the rates are parameters of the law,
    ``evolution.PARAMETER.CONSTANT``, behind the cell's. Where a parameter is driven out of its range, it stays at the
    end, and the response is flagged as outside. Without a step in time, and in a step of no length, nothing evolves.

    Newton's iteration solves the equations of each point, between bounds that close in on the solution. Where it does
    not converge, the response is NaN, so that the step is refused.

    Parameters
    ----------
    law
        Law of the cells, with derivatives by the parameters.
    rates
        Rates by the names of the parameters that evolve.
    ranges
        Ranges of these parameters.

    Raises
    ------
    ConfigurationError
        No parameter evolves, or one that the law does not have, or that has no range; or a rate was made for other
        parameters.
    """

    def __init__(
        self, law: MacroLaw, rates: Mapping[str, Rate], ranges: Mapping[str, tuple[float, float]]
    ) -> None:
        _check(law, rates, ranges)
        super().__init__(law, constant_names(rates), [InternalVariable(name, group=name) for name in rates])
        self.rates = dict(rates)
        self._ranges = np.array([ranges[name] for name in rates], dtype=float)
        self._columns = [law.parameters.index(name) for name in rates]
        self.constant_tangent = False
        self._follows_state = any(rate.follows_state for rate in rates.values())
        self._follows_energy = any("energy" in rate.names for rate in rates.values())
        self._follows_flux = any("flux" in rate.names for rate in rates.values())
        formulas = (f"{name}: {rate.formula}, {rate.constants}" for name, rate in rates.items())
        self.identity = fingerprint("evolution", law.identity, *formulas, self._ranges)

    def own_at_rest(self, points: MacroState, inner: LawMemory) -> Array:
        """Return the values with which the parameters begin."""
        return provided(inner.states.parameters)[:, self._columns]

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory of the inner law, with the evolved parameters in its states."""
        v = self.law.memory_size
        return LawMemory(
            self._with(memory.states, memory.internal[:, v:]), memory.fluid_volume, memory.internal[:, :v]
        )

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory with the evolved parameters, which are in the states of the inner law's."""
        theta = provided(memory.states.parameters)[:, self._columns]
        return LawMemory(states, memory.fluid_volume, np.concatenate([memory.internal, theta], axis=1))

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses; see :class:`~porocore.interfaces.law.MacroLaw`."""
        if self._follows_state and step is not None and step.length:
            return [self._respond(states, grad_p, memory, step, tangent) for grad_p in gradients]
        at = self._evolved(states, np.zeros((len(states), 3)), memory, step)
        found = self.law.respond_to_each(
            self._with(states, at.values),
            gradients,
            self.memory_in(memory, states),
            step=step,
            tangent=tangent,
        )
        return [self._out(response, states, at) for response in found]

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
        """Return the response and its derivatives by unknowns; see :class:`~porocore.interfaces.law.MacroLaw`."""
        (n, k), m, v = changes.modulus.shape, len(self.law.parameters), self.law.memory_size
        theta = provided(changes.parameters)
        given, initial, constants = theta[:, :m].copy(), theta[:, self._columns], theta[:, m:]
        given[:, self._columns] = 0.0
        at = self._evolved(states, grad_p, memory, step)
        response, found = self._asked(
            states,
            grad_p,
            memory,
            at.values,
            step,
            replace(changes, parameters=given),
            replace(before, internal=before.internal[:, :v]),
        )
        fixed, units = _columns(found, slice(0, k)), _columns(found, slice(k, None))
        length = 0.0 if step is None else step.length
        rates = self._rates(states, at.values, step, response)
        at = replace(at, rates=rates, response=response, units=units)
        begin = initial if step is None else before.internal[:, v:]
        # φ = φ_old + storage, of which the numbers of a response have the storage alone.
        rate = (
            rates.parameters @ given
            + rates.constants @ constants
            + at.rates_by_response @ _numbers(fixed)
            + rates.fluid_volume[..., None] * before.fluid_volume[:, None]
        )
        moved, by_state = _settled(
            at, self._columns, length, begin + length * rate, length * at.rates_by_state
        )
        total = _numbers(fixed) + at.by_parameters @ moved
        internal_by = _internal_matrix(fixed) + units.internal @ by_state
        internal_by = np.concatenate([internal_by, by_state], axis=1)
        by_grad_p = self._follows_flux or fixed.internal_grad_p is not None
        return self._out(self._with_tangent(at, by_state), states, at), ResponseChanges(
            stress=total[:, TENSOR].reshape(n, 3, 3, k),
            storage=total[:, SCALAR],
            flux=total[:, VECTOR],
            internal=np.concatenate([fixed.internal + units.internal @ moved, moved], axis=1),
            internal_grad_u=internal_by[..., TENSOR].reshape(n, -1, 3, 3),
            internal_p=internal_by[..., SCALAR],
            internal_grad_p=internal_by[..., VECTOR] if by_grad_p else None,
            potential=None if fixed.potential is None else total[:, POTENTIAL],
        )

    def _respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, step: Interval, tangent: bool
    ) -> MacroResponse:
        """Return the response at the end of a step in which parameters follow the state."""
        at = self._evolved(states, grad_p, memory, step)
        if not tangent:
            return self._out(replace(provided(at.response), tangent=None), states, at)
        (by_state,) = _settled(at, self._columns, step.length, step.length * at.rates_by_state)
        return self._out(self._with_tangent(at, by_state), states, at)

    def _out(self, response: MacroResponse, states: MacroState, at: _Evolved) -> MacroResponse:
        """Return the response of the law, flagged where a parameter is held; NaN where none is found."""
        response = self.response_out(response, states)
        doubt = response.doubt | Doubt.where(outside=at.held.any(axis=1))
        stress = (
            np.where(at.lost[:, None, None], np.nan, response.stress) if at.lost.any() else response.stress
        )
        return replace(response, stress=stress, doubt=doubt)

    def _with_tangent(self, at: _Evolved, by_state: Array) -> MacroResponse:
        """Return the response with the tangent in which the parameters move by ∂θ/∂(H, p, ∇p), (n, e, 13)."""
        response, n = provided(at.response), len(at.values)
        before = provided(response.tangent)
        total = _matrix(response) + at.by_parameters @ by_state
        by_grad_p = self._follows_flux or before.stress_grad_p is not None
        tangent = MacroTangent(
            stress_grad_u=total[:, TENSOR, TENSOR].reshape(n, 3, 3, 3, 3),
            stress_p=total[:, TENSOR, SCALAR].reshape(n, 3, 3),
            storage_grad_u=total[:, SCALAR, TENSOR].reshape(n, 3, 3),
            storage_p=total[:, SCALAR, SCALAR],
            flux_grad_u=total[:, VECTOR, TENSOR].reshape(n, 3, 3, 3),
            flux_p=total[:, VECTOR, SCALAR],
            flux_grad_p=total[:, VECTOR, VECTOR],
            stress_grad_p=total[:, TENSOR, VECTOR].reshape(n, 3, 3, 3) if by_grad_p else None,
            storage_grad_p=total[:, SCALAR, VECTOR] if by_grad_p else None,
        )
        return replace(response, tangent=tangent)

    def _evolved(
        self, states: MacroState, grad_p: Array, memory: LawMemory, step: Interval | None
    ) -> _Evolved:
        """Return the parameters at the end of a step; with the response of the inner law where they follow it."""
        n, e = len(states), len(self.rates)
        old = memory.internal[:, self.law.memory_size :]
        if step is None:
            old = provided(states.parameters)[:, self._columns]
        if step is None or not step.length:
            return _Evolved(
                old, np.zeros((n, e), bool), np.zeros(n, bool), self._rates(states, old, step, None)
            )
        search = _Search(old, self._ranges)
        theta, rows, parts, order = old.copy(), np.arange(n), [], []
        for iteration in range(MOST_ITERATIONS):
            at = self._tried(states[rows], grad_p[rows], memory[rows], theta[rows], step)
            reached = old[rows] + step.length * at.rates.value
            at = replace(at, held=search.held(rows, theta[rows], reached))
            residual = np.where(at.held, 0.0, theta[rows] - reached)
            (way,) = _settled(at, self._columns, step.length, -residual[..., None])
            done = search.is_close(way[..., 0])
            lost = ~done & ((iteration == MOST_ITERATIONS - 1) | (iteration == 0) & ~_finite(residual))
            ended, on = done | lost, rows[~(done | lost)]
            if ended.any():
                parts.append(replace(at, lost=lost)[ended])
                order.append(rows[ended])
            if not len(on):
                break
            theta[on] = search.following(on, theta[on], residual[~ended], way[~ended, :, 0])
            rows = on
        if len(parts) == 1:
            return parts[0]
        return _Evolved.concatenate(parts)[np.argsort(np.concatenate(order))]

    def _tried(
        self, states: MacroState, grad_p: Array, memory: LawMemory, theta: Array, step: Interval
    ) -> _Evolved:
        """Return rates at some values of the parameters, with the response that they follow."""
        n, e = theta.shape
        free, found = np.zeros((n, e), bool), np.zeros(n, bool)
        if not self._follows_state:
            return _Evolved(theta, free, found, self._rates(states, theta, step, None))
        none = np.zeros((n, 0))
        response, units = self._asked(
            states,
            grad_p,
            memory,
            theta,
            step,
            PointChanges(none, none, np.zeros((n, len(self.law.parameters), 0))),
            MemoryChanges.zeros(n, self.law.memory_size, 0),
        )
        return _Evolved(theta, free, found, self._rates(states, theta, step, response), response, units)

    def _asked(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        theta: Array,
        step: Interval | None,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return response and derivatives of the inner law by k changes, then by each of the evolving parameters.

        Raises
        ------
        ConfigurationError
            A rate follows the energy, which the inner law does not differentiate.
        """
        n, e = theta.shape
        units = np.zeros((n, len(self.law.parameters), e))
        units[:, self._columns] = np.eye(e)
        still = np.zeros((n, e))
        response, found = self.law.respond_to_changes(
            self._with(states, theta),
            grad_p,
            self.memory_in(memory, states),
            PointChanges(
                np.concatenate([changes.modulus, still], axis=1),
                np.concatenate([changes.viscosity, still], axis=1),
                np.concatenate([provided(changes.parameters), units], axis=2),
            ),
            _widened(before, e),
            step=step,
        )
        if self._follows_energy and found.potential is None:
            raise ConfigurationError(
                f"a rate follows the energy, but the law '{self.law.name}' gives no derivatives of it by the "
                "parameters of the cell; choose closure: potential and a surrogate that gives them"
            )
        return response, found

    def _rates(
        self, states: MacroState, theta: Array, step: Interval | None, response: MacroResponse | None
    ) -> RateSlopes:
        """Return the rates with an axis of e behind that of the points, derivatives by the constants of all of them.

        Zero in a step of no length. A response is needed where a rate follows the state.
        """
        n, given = len(states), provided(states.parameters)[:, len(self.law.parameters) :]
        first, found = 0, []
        for rate in self.rates.values():
            own = slice(first, first + len(rate.constants))
            first = own.stop
            if step is None or not step.length:
                one = RateSlopes.zeros(n, len(self.law.parameters), len(rate.constants))
            else:
                one = rate.at(self._points(states, theta, step.end, response), given[:, own])
            among_all = np.zeros((n, given.shape[1]))
            among_all[:, own] = one.constants
            found.append(replace(one, constants=among_all))
        return RateSlopes(
            **{f.name: np.stack([getattr(one, f.name) for one in found], axis=1) for f in fields(RateSlopes)}
        )

    def _points(
        self, states: MacroState, theta: Array, time: float, response: MacroResponse | None
    ) -> RatePoints:
        n, place = len(states), states.place
        return RatePoints(
            time=np.full(n, time),
            grad_u=states.grad_u,
            p=states.p,
            parameters=provided(self._with(states, theta).parameters),
            fluid_volume=np.zeros(n) if response is None else response.memory.fluid_volume,
            stress=np.zeros((n, 3, 3)) if response is None else response.stress,
            flux=np.zeros((n, 3)) if response is None else response.flux,
            position=None if place is None else place.position,
            potential=None if response is None else response.potential,
        )

    def _with(self, states: MacroState, theta: Array) -> MacroState:
        """Return the states as the inner law sees them at some values (n, e) of the evolving parameters."""
        parameters = provided(states.parameters)[:, : len(self.law.parameters)].copy()
        parameters[:, self._columns] = theta
        return replace(states, parameters=parameters)


#: Most iterations at a point.
MOST_ITERATIONS = 40
#: Share of the range of a parameter by which the last iteration would change it at most.
CLOSE = 1e-12
#: Iterations after which several parameters begin anew, with ways that may be longer than the last one by this factor.
PATIENCE, LONGER = 15, 3.0
#: Share of the range by which the bounds of the solution begin beyond its ends, so that these are tried, too.
BEYOND = 0.1


class _Search:
    """Search for the solution of R = θ − θ_old − Δt r = 0 in the ranges of the parameters, by Newton's iteration.

    One parameter always has a solution, since R < 0 below the range and R > 0 above it, as far as the parameter is held
    at its ends. It is enclosed by bounds, which are halved where Newton's iteration leaves them or is slow. Several
    parameters go back by half a way to where it was shorter; where this does not end, they begin anew with less care.

    Parameters
    ----------
    old : (n, e)
        θ_old, which may lie beyond the range.
    ranges : (e, 2)
        Ranges of the parameters.
    """

    def __init__(self, old: Array, ranges: Array) -> None:
        self._spans = ranges[:, 1] - ranges[:, 0]
        self._lower, self._upper = np.minimum(ranges[:, 0], old), np.maximum(ranges[:, 1], old)
        self._low, self._high = self._lower - BEYOND * self._spans, self._upper + BEYOND * self._spans
        self._old, self._from, self._way = old, old.copy(), np.full(old.shape, np.inf)
        self._count = 0

    def held(self, rows: IntArray, theta: Array, reached: Array) -> Flags:
        """Return which parameters are at an end of their range and driven on, (n, e)."""
        lower, upper = self._lower[rows], self._upper[rows]
        held: Flags = ((theta <= lower) & (reached < lower)) | ((theta >= upper) & (reached > upper))
        return held

    def is_close(self, way: Array) -> Flags:
        """Return the points that Newton's iteration would move by next to nothing, (n,)."""
        close: Flags = (np.abs(way) <= CLOSE * self._spans).all(axis=1)
        return close

    def following(self, rows: IntArray, theta: Array, residual: Array, way: Array) -> Array:
        """Return the values (n, e) to try next, given R and Newton's way at θ."""
        self._count += 1
        follow = self._between if theta.shape[1] == 1 else self._shorter
        return np.clip(follow(rows, theta, residual, way), self._lower[rows], self._upper[rows])

    def _between(self, rows: IntArray, theta: Array, residual: Array, way: Array) -> Array:
        low = np.where(residual < 0, theta, self._low[rows])
        high = np.where(residual > 0, theta, self._high[rows])
        wanted = np.clip(theta + way, self._lower[rows], self._upper[rows])
        fast = (wanted > low) & (wanted < high) & (np.abs(way) <= np.abs(self._way[rows]) / 2)
        self._low[rows], self._high[rows], self._way[rows] = low, high, way
        return np.where(fast, wanted, (low + high) / 2)

    def _shorter(self, rows: IntArray, theta: Array, residual: Array, way: Array) -> Array:
        if self._count == PATIENCE:
            self._from, self._way = self._old.copy(), np.full(self._old.shape, np.inf)
            return self._old[rows]
        size, last = (
            np.abs(each / self._spans).max(axis=1, keepdims=True) for each in (way, self._way[rows])
        )
        shorter = size <= last * (1.0 if self._count < PATIENCE else LONGER)
        start = np.where(shorter, theta, self._from[rows])
        self._way[rows], self._from[rows] = np.where(shorter, way, self._way[rows]), start
        return np.where(shorter, theta + way, (theta + start) / 2)


class UnevolvedLaw(ExtendedLaw):
    """Law without derivatives by parameters in a body that evolves: its parameters stay those of the beginning.

    Parameters
    ----------
    law
        Law that is asked, such as a linear one.
    rates
        Rates by the names of the parameters that would evolve, whose constants do nothing.
    """

    def __init__(self, law: MacroLaw, rates: Mapping[str, Rate]) -> None:
        super().__init__(law, constant_names(rates), ())

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory of points with all parameters."""
        return replace(memory, states=states)


def constant_names(rates: Mapping[str, Rate]) -> tuple[str, ...]:
    """Return the names of the constants of rates as parameters of a law, by the names of the parameters that evolve."""
    return tuple(
        f"evolution.{name}.{constant}" for name, rate in rates.items() for constant in rate.constants
    )


def _check(law: MacroLaw, rates: Mapping[str, Rate], ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse rates and ranges that do not belong to a law.

    Raises
    ------
    ConfigurationError
        They do not.
    """
    if not rates:
        raise ConfigurationError("evolution: expected the rate of at least one parameter, got none")
    known = joined(law.parameters) or "none"
    for name, rate in rates.items():
        if name not in law.parameters:
            raise ConfigurationError(
                f"evolution.{name}: the cell has no such parameter that could evolve; its parameters are {known}"
            )
        if rate.parameters != law.parameters:
            raise ConfigurationError(
                f"evolution.{name}: expected a rate for the parameters {known} of the law, got one for "
                f"{joined(rate.parameters) or 'none'}"
            )
        if name not in ranges or not ranges[name][0] < ranges[name][1]:
            raise ConfigurationError(
                f"evolution.{name}: expected a range of the parameter in which it can evolve, got {ranges.get(name)}"
            )


def _finite(residual: Array) -> Flags:
    """Return the points whose residual (n, e) is a number."""
    finite: Flags = np.isfinite(residual).all(axis=1)
    return finite


def _settled(at: _Evolved, columns: Sequence[int], length: float, *changes: Array) -> list[Array]:
    """Return the changes of θ, (n, e, k) each, under changes of θ_old + Δt r at fixed θ; none of those held.

    NaN where the equations have no solution.
    """
    eye = np.eye(at.values.shape[1])
    by = at.rates.parameters[..., columns] + at.rates_by_response @ at.by_parameters
    A = np.where(at.held[..., None], eye, eye - length * by)
    with np.errstate(invalid="ignore"):
        A[~(np.abs(np.linalg.det(A)) > 0)] = np.nan
    return [np.linalg.solve(A, np.where(at.held[..., None], 0.0, change)) for change in changes]


def _numbers(changes: ResponseChanges) -> Array:
    """Return the derivatives of the 14 numbers of a response (n, 14, k)."""
    n, k = changes.storage.shape
    W = np.zeros((n, k)) if changes.potential is None else changes.potential
    parts = [changes.stress.reshape(n, 9, k), changes.storage[:, None], changes.flux, W[:, None]]
    return np.concatenate(parts, axis=1)


def _matrix(response: MacroResponse) -> Array:
    """Return the tangent of a response as a matrix (n, 14, 13)."""
    tangent, n = provided(response.tangent), len(response.storage)
    found = np.zeros((n, 14, 13))
    found[:, POTENTIAL, TENSOR] = response.stress.reshape(n, 9)
    found[:, POTENTIAL, SCALAR] = -response.memory.fluid_volume
    found[:, TENSOR, TENSOR] = tangent.stress_grad_u.reshape(n, 9, 9)
    found[:, TENSOR, SCALAR] = tangent.stress_p.reshape(n, 9)
    found[:, SCALAR, TENSOR] = tangent.storage_grad_u.reshape(n, 9)
    found[:, SCALAR, SCALAR] = tangent.storage_p
    found[:, VECTOR, TENSOR] = tangent.flux_grad_u.reshape(n, 3, 9)
    found[:, VECTOR, SCALAR] = tangent.flux_p
    found[:, VECTOR, VECTOR] = tangent.flux_grad_p
    if tangent.stress_grad_p is not None:
        found[:, TENSOR, VECTOR] = tangent.stress_grad_p.reshape(n, 9, 3)
    if tangent.storage_grad_p is not None:
        found[:, SCALAR, VECTOR] = tangent.storage_grad_p
    return found


def _internal_matrix(changes: ResponseChanges) -> Array:
    """Return the derivatives of the internal variables by (H, p, ∇p), (n, v, 13)."""
    n, v = changes.internal_p.shape
    found = np.zeros((n, v, 13))
    found[..., TENSOR] = changes.internal_grad_u.reshape(n, v, 9)
    found[..., SCALAR] = changes.internal_p
    if changes.internal_grad_p is not None:
        found[..., VECTOR] = changes.internal_grad_p
    return found


def _columns(changes: ResponseChanges, columns: slice) -> ResponseChanges:
    """Return the derivatives by some of the unknowns."""
    return replace(
        changes,
        stress=changes.stress[..., columns],
        storage=changes.storage[..., columns],
        flux=changes.flux[..., columns],
        internal=changes.internal[..., columns],
        potential=None if changes.potential is None else changes.potential[..., columns],
    )


def _widened(before: MemoryChanges, e: int) -> MemoryChanges:
    """Return the derivatives of a memory with e more unknowns, which do not change it."""
    return MemoryChanges(
        **{
            f.name: np.concatenate(
                [value := getattr(before, f.name), np.zeros((*value.shape[:-1], e))], axis=-1
            )
            for f in fields(MemoryChanges)
        }
    )
