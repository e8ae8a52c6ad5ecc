"""Law of a solid that relaxes (RelaxingLaw): a Prony series on the stress and the pressure of any law.

The solid's stress is S_∞ + Σ Q_i with Q̇_i + Q_i/τ_i = γ_i Ṡ_∞, so that all of it relaxes alike. The same operator acts
at the macroscale on the drained stress and on the pressure, and the cell is asked at the pressure p_r of which
p = p_r + Σ q_i is the relaxing answer: its law is that of equilibrium, and no cell is solved again. At small strain
this is the correspondence principle: the drained stiffness relaxes with g(t) = 1 + Σ γ_i exp(−t/τ_i), α is constant,
and 1/M_B creeps with the conjugate function.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.cell.materials.prony import decays_and_shares
from porocore.core.fields import provided
from porocore.core.tensors import cofactor, determinant
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
from porocore.states import Array, MacroState

#: Names of the internal variables of a branch, before its number.
OVERSTRESS, OVERPRESSURE = "overstress_", "overpressure_"
#: Numbers of a branch, and of what it relaxes from: a stress and a pressure.
BLOCK = 10


def relaxation_parameters(branches: int) -> list[str]:
    """Return the names of the parameters of so many branches."""
    return [f"relaxation.{i}.{name}" for i in range(1, branches + 1) for name in ("strength", "time")]


@dataclass(frozen=True, eq=False)
class _Step:
    """Relaxation over one step at n points with N branches; stresses and pressures are numbers (…, 10) together.

    Attributes
    ----------
    strength, time : (n, N)
        γ and τ.
    ratio, decay, share : (n, N)
        a = Δt/τ; e = exp(−a) and c = (1 − e)/a: what is left of an overstress, and of one that grows in the step.
    over : (n, N, 10)
        Q_i and q_i at the beginning.
    before : (n, 10)
        S and p_r at the beginning.
    """

    strength: Array
    time: Array
    ratio: Array
    decay: Array
    share: Array
    over: Array
    before: Array

    @classmethod
    def over_interval(cls, own: Array, remembered: Array, interval: Interval | None) -> _Step:
        """Return the step from the law's own parameters (n, 2 N) and internal variables (n, 10 N + 10)."""
        n = len(own)
        strength, time = own[:, ::2], own[:, 1::2]
        blocks = remembered.reshape(n, -1, BLOCK)
        if interval is None:
            ratio = decay = share = np.zeros_like(time)
        else:
            ratio = interval.length / time
            decay, share = decays_and_shares(ratio)
        return cls(strength, time, ratio, decay, share, blocks[:, :-1], blocks[:, -1])

    @property
    def gain(self) -> Array:
        """c γ (n, N): overstress of each branch by a change of the stress."""
        return self.share * self.strength

    @property
    def stiffening(self) -> Array:
        """1 + G = 1 + Σ c γ (n,)."""
        return np.asarray(1 + self.gain.sum(axis=1))

    @property
    def held(self) -> Array:
        """B = Σ e Q − G S and b = Σ e q − G p_r of the beginning (n, 10), constant in the step."""
        fading = np.einsum("ni,nij->nj", self.decay, self.over)
        return np.asarray(fading - self.gain.sum(axis=1)[:, None] * self.before)

    def remembered(self, now: Array) -> Array:
        """Return the internal variables (n, 10 N + 10) at the end, where S and p_r are ``now`` (n, 10)."""
        change = (now - self.before)[:, None]
        over = self.decay[..., None] * self.over + self.gain[..., None] * change
        return np.asarray(np.concatenate([over, now[:, None]], axis=1).reshape(len(now), -1))


@dataclass(frozen=True, eq=False)
class _Kinematics:
    """F₀ and its inverse at n points, (n, 3, 3); None at small strain, where both are the identity."""

    F: Array
    inverse: Array

    @classmethod
    def at(cls, states: MacroState) -> _Kinematics:
        F = np.eye(3) + states.grad_u
        J = determinant(F)
        J = np.where(J > 0, J, np.nan)
        return cls(F, np.ascontiguousarray(cofactor(F).swapaxes(1, 2)) / J[:, None, None])

    @property
    def inverse_transposed(self) -> Array:
        return self.inverse.swapaxes(1, 2)

    @property
    def inverse_transposed_slope(self) -> Array:
        """∂(F₀⁻ᵀ)_ij/∂F_kl = −F⁻¹_jk F⁻¹_li (n, 3, 3, 3, 3)."""
        return np.asarray(-np.einsum("njk,nli->nijkl", self.inverse, self.inverse))


class RelaxingLaw(ExtendedLaw):
    """A law whose solid relaxes by a Prony series.

    With e = exp(−Δt/τ), c = (1 − e) τ/Δt, G = Σ c γ, B = Σ e Q − G S_old and b = Σ e q − G p_r,old::

        p_r = (p − b)/(1 + G)
        P_E = (1 + G) P_r + F₀ B − b φ_r F₀⁻ᵀ       with P_r, φ_r of the law at (H, p_r)
        S   = F₀⁻¹ (P_r + p_r φ_r F₀⁻ᵀ)
        Q   = e Q_old + c γ (S − S_old),  q = e q_old + c γ (p_r − p_r,old)

    which is exact for paths on which S and p_r are linear in time. The stored fluid and the conductivity are those at
    p_r. Without a step in time all overstress has relaxed, and the answer is the law's own.

    Parameters
    ----------
    law
        Law of the equilibrium.
    branches
        Number N of the branches, whose strengths γ and times τ are parameters.
    small_strain
        The law is linear: F₀ is the identity and S = P_r, so that this is linear viscoelastic poroelasticity.
    """

    def __init__(self, law: MacroLaw, branches: int, *, small_strain: bool = False) -> None:
        variables: list[InternalVariable] = []
        for i in range(1, branches + 1):
            variables.append(InternalVariable(f"{OVERSTRESS}{i}", (3, 3), "overstress", "stress"))
            variables.append(InternalVariable(f"{OVERPRESSURE}{i}", (), "overpressure", "pressure"))
        variables.append(InternalVariable("relaxed_stress", (3, 3), quantity="stress"))
        variables.append(InternalVariable("relaxed_pressure", quantity="pressure"))
        super().__init__(law, relaxation_parameters(branches), variables)
        self.branches, self._small = branches, small_strain
        self.identity = fingerprint("relaxing", law.identity, float(branches), float(small_strain))
        self.constant_tangent = law.constant_tangent and small_strain

    def own_at_rest(self, points: MacroState, inner: LawMemory) -> Array:
        """Return no overstress, and the stress and pressure at rest."""
        found = np.zeros((len(points), self.branches + 1, BLOCK))
        if len(points):
            found[:, -1, :9] = self._stress_at(self.states_in(points), inner)
        return found.reshape(len(points), -1)

    def _stress_at(self, states: MacroState, inner: LawMemory) -> Array:
        """Return S (n, 9) of the law's own answer at once to ``states`` of its own."""
        still = np.zeros((len(states), 3))
        response = self.law.respond(states, still, inner, step=Interval(0.0, 0.0), tangent=False)
        return self._stress(response, None if self._small else _Kinematics.at(states), states.p)

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory of the law, which stood at the pressure p_r."""
        found = super().memory_in(memory, states)
        return replace(found, states=replace(found.states, p=memory.internal[:, -1].copy()))

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses with the overstress; see :class:`~porocore.interfaces.law.MacroLaw`."""
        course, inner = self._asked(states, memory, step)
        at = None if self._small else _Kinematics.at(states)
        found = self.law.respond_to_each(
            inner, gradients, self.memory_in(memory, states), step=step, tangent=tangent
        )
        return [self._relaxing(response, states, course, at, inner.p) for response in found]

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
        """Return the response and its derivatives, strengths and times among the unknowns."""
        course, inner = self._asked(states, memory, step)
        at = None if self._small else _Kinematics.at(states)
        response, found = self.law.respond_to_changes(
            inner,
            grad_p,
            self.memory_in(memory, states),
            self.changes_in(changes),
            self.memory_changes_in(before, states),
            step=step,
        )
        whole = self._relaxing(response, states, course, at, inner.p)
        derived = _Derivatives(self, course, at, inner.p, response, found, changes, before)
        return whole, derived.changes()

    def renewed(self, inner: LawMemory, memory: LawMemory) -> LawMemory:
        """Return the memory with that of the law, and with the stress that the law now has at the beginning."""
        found = super().renewed(inner, memory)
        seen, internal = self.memory_in(found, memory.states), found.internal.copy()
        internal[:, -BLOCK:-1] = self._stress_at(seen.states, seen)
        return replace(found, internal=internal)

    def _asked(
        self, states: MacroState, memory: LawMemory, step: Interval | None
    ) -> tuple[_Step, MacroState]:
        """Return the relaxation over the step, and the states at p_r with the law's own parameters."""
        own = self.own_parameters(states)
        course = _Step.over_interval(own, self.own_internal(memory.internal), step)
        p_r = (states.p - course.held[:, 9]) / course.stiffening
        return course, replace(self.states_in(states), p=p_r)

    def _stress(self, response: MacroResponse, at: _Kinematics | None, p_r: Array) -> Array:
        """Return S (n, 9)."""
        n = len(p_r)
        if at is None:
            return np.asarray(response.stress.reshape(n, 9))
        borne = (p_r * response.memory.fluid_volume)[:, None, None] * at.inverse_transposed
        return np.asarray(at.inverse @ (response.stress + borne)).reshape(n, 9)

    def _relaxing(
        self, response: MacroResponse, states: MacroState, course: _Step, at: _Kinematics | None, p_r: Array
    ) -> MacroResponse:
        n, held, one_more = len(p_r), course.held, course.stiffening
        B, b = held[:, :9].reshape(n, 3, 3), held[:, 9]
        fluid = response.memory.fluid_volume
        stress = one_more[:, None, None] * response.stress
        if at is None:
            stress = stress + B
        else:
            stress = stress + (at.F @ B - (b * fluid)[:, None, None] * at.inverse_transposed)
        now = np.concatenate([self._stress(response, at, p_r), p_r[:, None]], axis=1)
        internal = np.concatenate([response.memory.internal, course.remembered(now)], axis=1)
        slopes = response.tangent
        return replace(
            response,
            stress=stress,
            memory=replace(response.memory, states=states, internal=internal),
            tangent=None if slopes is None else _tangent(slopes, course, at, fluid),
        )


def _tangent(t: MacroTangent, course: _Step, at: _Kinematics | None, fluid: Array) -> MacroTangent:
    """Return the exact derivatives by (H, p, ∇p) from those of the law by (H, p_r, ∇p)."""
    n, held, one_more = len(fluid), course.held, course.stiffening
    less = 1 / one_more
    by_H, by_p = one_more[:, None, None, None, None] * t.stress_grad_u, t.stress_p
    by_grad_p = None if t.stress_grad_p is None else one_more[:, None, None, None] * t.stress_grad_p
    if at is not None:
        B, b, out = held[:, :9].reshape(n, 3, 3), held[:, 9], at.inverse_transposed
        by_H = by_H + np.einsum("ik,nlj->nijkl", np.eye(3), B)
        weighed = b[:, None, None] * out
        by_H -= weighed[:, :, :, None, None] * t.storage_grad_u[:, None, None]
        by_H -= (b * fluid)[:, None, None, None, None] * at.inverse_transposed_slope
        by_p = by_p - weighed * (less * t.storage_p)[:, None, None]
        if by_grad_p is not None and t.storage_grad_p is not None:
            by_grad_p = by_grad_p - weighed[..., None] * t.storage_grad_p[:, None, None]
    return replace(
        t,
        stress_grad_u=by_H,
        stress_p=by_p,
        storage_p=less * t.storage_p,
        flux_p=less[:, None] * t.flux_p,
        stress_grad_p=by_grad_p,
    )


class _Derivatives:
    """Derivatives of a relaxing response by k unknowns, from those of the law at fixed (H, p_r, ∇p)."""

    def __init__(
        self,
        law: RelaxingLaw,
        course: _Step,
        at: _Kinematics | None,
        p_r: Array,
        response: MacroResponse,
        found: ResponseChanges,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> None:
        self._law, self._course, self._at, self._p_r = law, course, at, p_r
        self._response, self._found, self._before = response, found, before
        n, self._k = changes.modulus.shape
        own = np.zeros((n, 2 * law.branches, self._k))
        if changes.parameters is not None:
            own = changes.parameters[:, -2 * law.branches :] if law.branches else own[:, :0]
        over = law.own_internal(before.internal).reshape(n, -1, BLOCK, self._k)
        self._over, self._start = over[:, :-1], over[:, -1]
        c, per_time = course, own[:, 1::2] / course.time[..., None]
        self._decay = (c.decay * c.ratio)[..., None] * per_time
        self._gain = (
            c.share[..., None] * own[:, ::2] + (c.strength * (c.share - c.decay))[..., None] * per_time
        )

    def changes(self) -> ResponseChanges:
        """Return them at fixed (H, p, ∇p)."""
        c, at, found, t = self._course, self._at, self._found, provided(self._response.tangent)
        n, k, one_more = len(self._p_r), self._k, c.stiffening
        d_gain = self._gain.sum(axis=1)
        held = (
            np.einsum("nik,nij->njk", self._decay, c.over)
            + np.einsum("ni,nijk->njk", c.decay, self._over)
            - d_gain[:, None] * c.before[..., None]
            - (one_more - 1)[:, None, None] * self._start
        )
        d_B, d_b = held[:, :9].reshape(n, 3, 3, k), held[:, 9]
        d_p = -(d_b + self._p_r[:, None] * d_gain) / one_more[:, None]

        def moved(fixed: Array, by_p: Array) -> Array:
            return np.asarray(fixed + by_p[..., None] * d_p.reshape(n, *(1,) * (by_p.ndim - 1), k))

        d_P, d_flux = moved(found.stress, t.stress_p), moved(found.flux, t.flux_p)
        d_storage, inner = moved(found.storage, t.storage_p), moved(found.internal, found.internal_p)
        d_fluid, fluid = self._before.fluid_volume + d_storage, self._response.memory.fluid_volume
        stress = (
            one_more[:, None, None, None] * d_P + self._response.stress[..., None] * d_gain[:, None, None]
        )
        d_S = d_P
        if at is None:
            stress = stress + d_B
        else:
            b, out = c.held[:, 9], at.inverse_transposed[..., None]
            stress = stress + np.einsum("nij,njlk->nilk", at.F, d_B)
            stress -= out * (d_b * fluid[:, None] + b[:, None] * d_fluid)[:, None, None]
            borne = d_p * fluid[:, None] + self._p_r[:, None] * d_fluid
            d_S = np.einsum("nij,njlk->nilk", at.inverse, d_P + out * borne[:, None, None])
        now = np.concatenate([d_S.reshape(n, 9, k), d_p[:, None]], axis=1)
        change = self._law._stress(self._response, at, self._p_r)
        change = np.concatenate([change, self._p_r[:, None]], axis=1) - c.before
        over = (
            self._decay[:, :, None] * c.over[..., None]
            + c.decay[..., None, None] * self._over
            + self._gain[:, :, None] * change[:, None, :, None]
            + c.gain[..., None, None] * (now - self._start)[:, None]
        )
        own = np.concatenate([over, now[:, None]], axis=1).reshape(n, -1, k)
        by_H, by_p, by_grad_p = self._own_slopes()
        less = (1 / one_more)[:, None]
        return ResponseChanges(
            stress=stress,
            storage=d_storage,
            flux=d_flux,
            internal=np.concatenate([inner, own], axis=1),
            internal_grad_u=np.concatenate([found.internal_grad_u, by_H], axis=1),
            internal_p=np.concatenate([less * found.internal_p, by_p], axis=1),
            internal_grad_p=None if by_grad_p is None else self._with_inner(by_grad_p),
        )

    def _with_inner(self, own: Array) -> Array:
        inner = self._found.internal_grad_p
        if inner is None:
            inner = np.zeros((len(own), self._found.internal.shape[1], 3))
        return np.asarray(np.concatenate([inner, own], axis=1))

    def _own_slopes(self) -> tuple[Array, Array, Array | None]:
        """Return the derivatives of the law's own internal variables by H, p and ∇p."""
        c, at, t = self._course, self._at, provided(self._response.tangent)
        n, p_r, fluid = len(self._p_r), self._p_r, self._response.memory.fluid_volume
        by_H, by_p, by_grad_p = t.stress_grad_u, t.stress_p, t.stress_grad_p
        if at is not None:
            out, weighed = at.inverse_transposed, p_r[:, None, None] * at.inverse_transposed
            S = self._law._stress(self._response, at, p_r).reshape(n, 3, 3)
            by_H = by_H + weighed[:, :, :, None, None] * t.storage_grad_u[:, None, None]
            by_H = by_H + (p_r * fluid)[:, None, None, None, None] * at.inverse_transposed_slope
            by_H = np.einsum("nmi,nijkl->nmjkl", at.inverse, by_H)
            by_H -= np.einsum("nmk,nlj->nmjkl", at.inverse, S)
            by_p = at.inverse @ (by_p + (fluid + p_r * t.storage_p)[:, None, None] * out)
            if by_grad_p is not None:
                if t.storage_grad_p is not None:
                    by_grad_p = by_grad_p + weighed[..., None] * t.storage_grad_p[:, None, None]
                by_grad_p = np.einsum("nmi,nijk->nmjk", at.inverse, by_grad_p)
        less = 1 / c.stiffening
        factors = np.concatenate([c.gain, np.ones((n, 1))], axis=1)

        def of_blocks(tensor: Array, number: Array, *shape: int) -> Array:
            block = np.concatenate([tensor.reshape(n, 9, *shape), number.reshape(n, 1, *shape)], axis=1)
            spread = factors.reshape(n, -1, 1, *(1,) * len(shape)) * block[:, None]
            return np.asarray(spread.reshape(n, -1, *shape))

        rows = np.zeros((n, 3, 3))
        return (
            of_blocks(by_H, rows, 3, 3),
            of_blocks(less[:, None, None] * by_p, less),
            None if by_grad_p is None else of_blocks(by_grad_p, np.zeros((n, 3)), 3),
        )
