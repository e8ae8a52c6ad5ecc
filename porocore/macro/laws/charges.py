"""Law of a cell with fixed charges in Donnan equilibrium with a bath (ChargedLaw); osmotic pressure.

The pores hold charges that do not move, Q per reference volume, of the concentration c_F = Q/φ. In equilibrium with a
bath of the monovalent salt c* their ions give the fluid the osmotic pressure

    π(φ; c*) = R T Φ (√(c_F² + 4 c*²) − 2 c*),   π′ = dπ/dφ = −R T Φ c_F²/(φ √(c_F² + 4 c*²)) < 0,

with the osmotic coefficient Φ (Overbeek 1956, Prog. Biophys. 6, 58; Lai, Hou & Mow 1991, J. Biomech. Eng. 113, 245).
Ions are taken to be in equilibrium at once (Lanir 1987, Biorheology 24, 173). The fluid flows by the gradient of the
effective pressure μ = p − π, which is continuous, and 0 where a surface touches the bath. It is the unknown of the
body, and the pressure p of the cell at a point is the root of p − π(φ(H, p)) = μ. There is one, for the left-hand side
grows with p: its slope is 1 − π′ φ_p with φ_p = −∂²W/∂p² > 0. With

    ∂p/∂μ = 1/(1 − π′ φ_p),   ∂p/∂H = π′ φ_H/(1 − π′ φ_p)

stress and fluid volume are derivatives of Ω(H, μ) = W + φ π − ∫π dφ, dΩ = P_E:dH − φ dμ, as they are of W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

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
    add_scaled,
    fingerprint,
)
from porocore.interfaces.solution import FIXED_CHARGE, PORE_PRESSURE
from porocore.states import Array, BoolArray, MacroState

#: Names of the law's own parameters: c_F0, concentration of the charges in the fluid of the undeformed cell, and c*.
DENSITY, BATH = "charges.density", "charges.bath"
#: Internal variables, which follow those of the inner law: p, and Q, charges per reference volume.
PRESSURE = InternalVariable(PORE_PRESSURE, quantity="pressure")
CHARGE = InternalVariable(FIXED_CHARGE, quantity="concentration")
#: Iterations at most, and units of round-off that are left of an equation.
MOST, ROUND_OFF = 50, 32 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class OsmoticPressure(Batch):
    """Osmotic pressure of n points and its derivatives.

    Attributes
    ----------
    value : (n,)
        π [E].
    by_fluid : (n,)
        π′ = ∂π/∂φ [E].
    by_charge : (n,)
        ∂π/∂Q.
    by_bath : (n,)
        ∂π/∂c*.
    """

    value: Array
    by_fluid: Array
    by_charge: Array
    by_bath: Array

    @classmethod
    def at(cls, fluid: Array, charge: Array, bath: Array, osmotic: float) -> OsmoticPressure:
        """Return it in pores with the fluid volume φ and the charges Q, both (n,) per reference volume.

        Parameters
        ----------
        fluid, charge, bath : (n,)
            φ, Q and c*.
        osmotic
            R T Φ, pressure per concentration [E].
        """
        charged = charge != 0
        c = np.divide(charge, fluid, out=np.zeros_like(charge), where=charged)
        root = np.where(charged, np.hypot(c, 2 * bath), 1.0)
        # In a form without differences of large numbers.
        value = np.where(charged, osmotic * c**2 / (root + 2 * np.where(charged, bath, 0.0)), 0.0)
        slope = osmotic * c / root
        return cls(
            value,
            np.divide(-slope * c, fluid, out=np.zeros_like(charge), where=charged),
            slope / fluid,
            -2 * value / root,
        )


@dataclass(frozen=True, eq=False)
class _Points:
    """Data of n points as a law of an uncharged cell sees them, with their charges Q (n,) and bath c* (n,)."""

    states: MacroState
    memory: LawMemory
    charge: Array
    bath: Array
    step: Interval | None

    def at_pressure(self, p: Array) -> MacroState:
        """Return the states at the pressures p (n,)."""
        return replace(self.states, p=p)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Derivatives of p by μ (n,), H (n, 3, 3) and ∇μ (n, 3), the last where the fluid volume depends on it."""

    share: Array
    by_H: Array
    by_gradient: Array | None


@dataclass(frozen=True, eq=False)
class _Solved:
    """Response of the inner law at p (n,), and the osmotic pressure there; without values at the points ``left``."""

    p: Array
    response: MacroResponse
    osmotic: OsmoticPressure
    left: BoolArray

    @property
    def slopes(self) -> _Slopes:
        """Derivatives of p."""
        t, by_fluid = provided(self.response.tangent), self.osmotic.by_fluid
        share = 1 / (1 - by_fluid * t.storage_p)
        rise = by_fluid * share
        by_gradient = None if t.storage_grad_p is None else rise[:, None] * t.storage_grad_p
        return _Slopes(share, rise[:, None, None] * t.storage_grad_u, by_gradient)


class ChargedLaw(ExtendedLaw):
    """A law of a cell whose pores hold fixed charges; its states' pressure is the effective one, μ.

    Its own parameters follow those of the law: ``charges.density``, the concentration c_F0 of the charges in the fluid
    of the undeformed cell, and ``charges.bath``, c*. What a point holds, Q = c_F0 φ_f0, is settled where the law is
    asked without a step, and stays.

    Parameters
    ----------
    law
        Any law, which is asked at (H, p); its flux goes by ∇μ.
    osmotic
        R T Φ, pressure per concentration [E].

    Raises
    ------
    ConfigurationError
        ``osmotic`` is not positive, or the law has charges already.
    """

    def __init__(self, law: MacroLaw, osmotic: float) -> None:
        if not osmotic > 0:
            raise ConfigurationError(
                f"charges: expected a positive osmotic pressure per concentration, got {osmotic:g}"
            )
        if DENSITY in law.parameters:
            raise ConfigurationError(f"charges: the law '{law.name}' has charges already")
        super().__init__(law, (DENSITY, BATH), (PRESSURE, CHARGE))
        self.osmotic = float(osmotic)
        self.identity = fingerprint("charged", law.identity, self.osmotic)
        self.constant_tangent = False

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory of the uncharged cell, which stood at p."""
        found = super().memory_in(memory, states)
        return replace(found, states=replace(found.states, p=memory.internal[:, -2].copy()))

    def own_at_rest(self, points: MacroState, inner: LawMemory) -> Array:
        """Return p = 0, for the charges do not act yet, and Q."""
        density = self.own_parameters(points)[:, 0]
        return np.column_stack([np.zeros(len(points)), density * inner.fluid_volume])

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses at the pressure of the cell; see :class:`~porocore.interfaces.law.MacroLaw`."""
        at, further = self._points(states, memory, step), gradients[1:]
        found = [self._solved(at, gradients[0])]
        if provided(found[0].response.tangent).storage_grad_p is not None:
            found += [self._solved(at, grad_p) for grad_p in further]
        elif further:
            there = at.at_pressure(found[0].p)
            others = self.law.respond_to_each(there, further, at.memory, step=step, tangent=tangent)
            found += [replace(found[0], response=response) for response in others]
        return [self._closed(at, solved, states, tangent) for solved in found]

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
        """Return the response and its derivatives; see :class:`~porocore.interfaces.law.MacroLaw`."""
        at = self._points(states, memory, step)
        solved, inner = self._solved(at, grad_p), self.memory_changes_in(before, states)
        response, by = self.law.respond_to_changes(
            at.at_pressure(solved.p), grad_p, at.memory, self.changes_in(changes), inner, step=step
        )
        solved = replace(solved, response=response)
        charge = self._charge_changes(at, states, changes, before)
        moved = solved.osmotic.by_charge[:, None] * charge
        moved += solved.osmotic.by_fluid[:, None] * (before.fluid_volume + by.storage)
        if changes.parameters is not None:
            moved += solved.osmotic.by_bath[:, None] * changes.parameters[:, -1]
        return self._closed(at, solved, states, True), self._chained(solved, by, moved, charge)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the law knows at the pressures of the cell in equilibrium with the bath."""
        found = self.respond(states, np.zeros((len(states), 3)), self.initial_at(states), tangent=False)
        return self.law.reasons(replace(self.states_in(states), p=found.memory.internal[:, -2]))

    def _points(self, states: MacroState, memory: LawMemory, step: Interval | None) -> _Points:
        seen, (density, bath) = self.states_in(states), self.own_parameters(states).T
        charge = (
            memory.internal[:, -1] if step is not None else density * self.law.initial_at(seen).fluid_volume
        )
        return _Points(seen, self.memory_in(memory, states), charge, bath, step)

    def _charge_changes(
        self, at: _Points, states: MacroState, changes: PointChanges, before: MemoryChanges
    ) -> Array:
        """Return the derivatives (n, k) of Q."""
        if at.step is not None:
            return before.internal[:, -1]
        density = self.own_parameters(states)[:, 0, None]
        found: Array = density * self.law.rest_changes(at.states, self.changes_in(changes))
        if changes.parameters is not None:
            fluid = self.law.initial_at(at.states).fluid_volume
            found = found + fluid[:, None] * changes.parameters[:, -2]
        return found

    def _solved(self, at: _Points, grad_p: Array) -> _Solved:
        """Solve p − π(φ(H, p)) = μ at each point by Newton's method, between bounds.

        The same root has φ(H, p) = φ_π(p − μ), with the inverse φ_π of π. Where φ is linear in p, both equations are
        concave, so that no step of Newton's method passes the root to the right, and the larger of both is the better
        one: the first where the charges are many, the second where hardly any fluid is left between them.
        """
        mu, before = at.states.p, at.memory.fluid_volume
        p = mu + OsmoticPressure.at(before, at.charge, at.bath, self.osmotic).value
        low, high = mu, np.full_like(p, np.inf)
        for _ in range(MOST):
            response = self.law.respond(at.at_pressure(p), grad_p, at.memory, step=at.step, tangent=True)
            fluid, by_p = before + response.storage, provided(response.tangent).storage_p
            empty = (fluid <= 0) & (at.charge != 0)
            osmotic = OsmoticPressure.at(np.where(empty, np.nan, fluid), at.charge, at.bath, self.osmotic)
            fault = p - osmotic.value - mu
            terms = (
                np.abs(p)
                + np.abs(mu)
                + osmotic.value
                - osmotic.by_fluid * (before + np.abs(response.storage))
            )
            left = empty | (np.abs(fault) > (ROUND_OFF + self.noise) * terms)
            if not left.any():
                break
            low, high = np.where(empty | (fault < 0), p, low), np.where(fault > 0, p, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = (p - mu) / self.osmotic
                square = share * (share + 4 * at.bath)
                volume = at.charge / np.sqrt(square)
                slope = by_p + volume * (share + 2 * at.bath) / square / self.osmotic
                wanted = np.fmax(p - fault / (1 - osmotic.by_fluid * by_p), p - (fluid - volume) / slope)
                # Charges so few that p is μ to round-off, in a cell without fluid: up to where it has some.
                wanted = np.where(np.isnan(wanted), p + (before - fluid) / by_p, wanted)
            outside = ((wanted <= low) | (wanted >= high)) & np.isfinite(high)
            p = np.where(left, np.where(outside, (low + high) / 2, wanted), p)
        return _Solved(p, response, osmotic, left)

    def _closed(self, at: _Points, solved: _Solved, states: MacroState, tangent: bool) -> MacroResponse:
        """Return the response of the charged cell."""
        found, left = solved.response, solved.left
        stress = np.where(left[:, None, None], np.nan, found.stress) if left.any() else found.stress
        internal = np.column_stack([found.memory.internal, solved.p, at.charge])
        return replace(
            found,
            stress=stress,
            memory=replace(found.memory, states=states, internal=internal),
            tangent=self._tangent(solved) if tangent else None,
        )

    @staticmethod
    def _tangent(solved: _Solved) -> MacroTangent:
        """Return the chain rule through p(H, μ, ∇μ)."""
        t, p = provided(solved.response.tangent), solved.slopes
        stress_grad_p, flux_grad_p = t.stress_grad_p, t.flux_grad_p
        if p.by_gradient is not None:
            moved = t.stress_p[:, :, :, None] * p.by_gradient[:, None, None]
            stress_grad_p = moved if stress_grad_p is None else stress_grad_p + moved
            flux_grad_p = flux_grad_p + t.flux_p[:, :, None] * p.by_gradient[:, None]
        return MacroTangent(
            stress_grad_u=t.stress_grad_u + t.stress_p[:, :, :, None, None] * p.by_H[:, None, None],
            stress_p=t.stress_p * p.share[:, None, None],
            # φ_H + φ_p ∂p/∂H without the difference.
            storage_grad_u=t.storage_grad_u * p.share[:, None, None],
            storage_p=t.storage_p * p.share,
            flux_grad_u=t.flux_grad_u + t.flux_p[:, :, None, None] * p.by_H[:, None],
            flux_p=t.flux_p * p.share[:, None],
            flux_grad_p=flux_grad_p,
            stress_grad_p=stress_grad_p,
            storage_grad_p=None if t.storage_grad_p is None else t.storage_grad_p * p.share[:, None],
        )

    @staticmethod
    def _chained(solved: _Solved, by: ResponseChanges, moved: Array, charge: Array) -> ResponseChanges:
        """Return the derivatives of the response where π changes by ``moved`` at fixed p, Q by ``charge``, (n, k)."""
        t, slopes, (n, k) = provided(solved.response.tangent), solved.slopes, moved.shape
        p, still = slopes.share[:, None] * moved, np.zeros((n, 1, 3, 3))

        def along(values: Array, by_p: Array) -> Array:
            found = values.reshape(n, -1, k).copy()
            add_scaled(found, by_p.reshape(n, -1), p)
            return found.reshape(values.shape)

        by_gradient = by.internal_grad_p
        if slopes.by_gradient is not None:
            inner = by.internal_p[:, :, None] * slopes.by_gradient[:, None]
            inner = inner if by_gradient is None else by_gradient + inner
            by_gradient = np.concatenate([inner, slopes.by_gradient[:, None], still[..., 0]], axis=1)
        elif by_gradient is not None:
            by_gradient = np.concatenate([by_gradient, np.zeros((n, 2, 3))], axis=1)
        inner_H = by.internal_grad_u + by.internal_p[:, :, None, None] * slopes.by_H[:, None]
        return ResponseChanges(
            stress=along(by.stress, t.stress_p),
            storage=along(by.storage, t.storage_p),
            flux=along(by.flux, t.flux_p),
            internal=np.concatenate([along(by.internal, by.internal_p), p[:, None], charge[:, None]], axis=1),
            internal_grad_u=np.concatenate([inner_H, slopes.by_H[:, None], still], axis=1),
            internal_p=np.column_stack([by.internal_p * slopes.share[:, None], slopes.share, np.zeros(n)]),
            internal_grad_p=by_gradient,
        )
