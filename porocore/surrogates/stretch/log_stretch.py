"""Logarithmic stretch ln U and rotation of F = R U; stress and tangent through it (LogStretch).

A function of L is objective by construction. With the eigenvectors of U as a basis everything is closed: for
C = U² the derivative of ln C in the direction dC is the divided difference of ln times dC, entry by entry, and so
on for the second (:mod:`porocore.surrogates.stretch.divided_differences`).

Six components stand for a symmetric tensor, in the order 11, 22, 33, 23, 13, 12; a derivative with respect to a
shear component is the one with respect to both of its places at once. Arrays are component-first, so that each
operation runs over the states; only products of matrices lead with the states.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.tensors.symmetric_functions import symmetric_eigen
from porocore.states import Array
from porocore.surrogates.stretch import diagonal as diagonal_stretch
from porocore.surrogates.stretch.components import COMPONENT, PAIRS, PLACES, SHARE
from porocore.surrogates.stretch.curvature_terms import second_derivative
from porocore.surrogates.stretch.diagonal import Gradients
from porocore.surrogates.stretch.divided_differences import pair_differences, triple_difference


@dataclass(frozen=True, eq=False)
class LogStretch:
    """Logarithmic stretch of n deformation gradients; NaN where det F ≤ 0.

    Attributes
    ----------
    F : (3, 3, n)
        I + H.
    stretches : (3, n)
        Eigenvalues λ of U.
    axes : (3, 3, n) or None
        Eigenvectors in columns; None where all F are diagonal, whose axes are the coordinates'.
    """

    F: Array
    stretches: Array
    axes: Array | None

    @classmethod
    def from_gradient(cls, grad_u: Array) -> LogStretch:
        """Return the stretch of H (n, 3, 3)."""
        n = len(grad_u)
        F = np.array(grad_u.reshape(n, 9).T, order="C")
        F[::4] += 1.0
        diagonal = diagonal_stretch.vanishes(F[1:4]) and diagonal_stretch.vanishes(F[5:8])
        F = F.reshape(3, 3, n)
        if diagonal:
            stretches = F.reshape(9, n)[::4].copy()
            bad = ~(stretches > 0)
            if bad.any():
                stretches[:, bad.any(axis=0)] = np.nan
            return cls(F, stretches, None)
        determinant = (
            F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
            - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
            + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
        )
        good = np.isfinite(determinant) & (determinant > 0)
        C = _product(F.swapaxes(0, 1), F)
        if not good.all():
            C = np.where(good, C, np.eye(3)[:, :, None])
        squares, axes = symmetric_eigen(C)
        return cls(F, np.sqrt(np.where(good & (squares > 0).all(axis=0), squares, np.nan)), axes)

    def __len__(self) -> int:
        return self.F.shape[-1]

    @cached_property
    def L(self) -> Array:
        """Logarithmic stretch ln U, six components (6, n)."""
        logs = np.log(self.stretches)
        if self.axes is None:
            L = np.zeros((6, len(self)))
            L[:3] = logs
            return L
        Q = self.axes
        return np.stack([(Q[i] * Q[j] * logs).sum(axis=0) for i, j in PLACES])

    @cached_property
    def rotation(self) -> Array | None:
        """Rotation R (3, 3, n); None where all F are diagonal."""
        if self.axes is None:
            return None
        return _product(self._turned_axes, self.axes.swapaxes(0, 1))

    @cached_property
    def rotations(self) -> Array | None:
        """Rotation R (n, 3, 3); None where all F are diagonal."""
        if self.rotation is None:
            return None
        return np.ascontiguousarray(self.rotation.reshape(9, -1).T).reshape(-1, 3, 3)

    @cached_property
    def _differences(self) -> tuple[Array, Array, Array]:
        """ln[λ_i², λ_j²], ln[λ_i², λ_i², λ_j²] and ln[λ_i², λ_j², λ_j²] for the three of ``PAIRS`` (3, n)."""
        c = self.stretches**2
        if self.axes is None:
            for i, j, alike in PAIRS:
                if (c[i] == c[j]).all():
                    return diagonal_stretch.uniaxial_differences(c, alike - 3)
        return pair_differences(c[[1, 0, 0]], c[[2, 2, 1]])

    @cached_property
    def first(self) -> Array:
        """Divided differences g_ij = ln[λ_i², λ_j²], six components (6, n)."""
        return np.concatenate([1 / self.stretches**2, self._differences[0]])

    def second(self) -> dict[tuple[int, int, int], Array]:
        """Return the divided differences ln[λ_i², λ_j², λ_k²] for i ≤ j ≤ k."""
        c, (_, left, right) = self.stretches**2, self._differences
        found = {(i, i, i): -0.5 / c[i] ** 2 for i in range(3)}
        for pair, (i, j, _) in enumerate(PAIRS):
            found[i, i, j], found[i, j, j] = left[pair], right[pair]
        found[0, 1, 2] = triple_difference(*c)
        return found

    # ---- from F to L: what a solved cell says of W as a function of L ----------------------------

    def pull(self, P: Array) -> Array:
        """Return ∂W/∂L (6, n) from P = ∂W/∂F (3, 3, n) of an objective W."""
        # Along dF = R dU nothing rotates, and dU follows from dL entry by entry in the eigenbasis.
        P = self._to_axes(P if self.rotation is None else _product(self.rotation.swapaxes(0, 1), P))
        A = self._from_axes((P + P.swapaxes(0, 1)) / 2 / self._log_of_stretch)
        return np.stack([A[i, j] if i == j else A[i, j] + A[j, i] for i, j in PLACES])

    def pull_direction(self, component: int) -> Array:
        """Return dF (3, 3, n) without rotation that changes one component of L by 1, a shear in both places."""
        E = np.zeros((3, 3, len(self)))
        i, j = PLACES[component]
        E[i, j] = E[j, i] = 1.0
        dU = self._from_axes(self._to_axes(E) / self._log_of_stretch)
        return dU if self.rotation is None else _product(self.rotation, dU)

    @cached_property
    def _log_of_stretch(self) -> Array:
        """ln[λ_i, λ_j] (3, 3, n)."""
        s = self.stretches
        logs: Array = self.first[COMPONENT] * (s[:, None] + s[None, :]) / 2
        return logs

    # ---- from L to F -----------------------------------------------------------------------------

    @cached_property
    def gradient(self) -> Array:
        """∂L/∂F (n, 9, 6), the places of F row by row."""
        gradient: Array = self._lift @ np.ascontiguousarray(self._scaled_turn.swapaxes(1, 2))
        return gradient

    def stress(self, T: Array) -> Array:
        """Return ∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n)."""
        return self.stresses(T)[0]

    def stresses(self, *T: Array) -> list[Array]:
        """Return the stresses of several potentials, in one pass."""
        if self.axes is None and all(diagonal_stretch.vanishes(by_L[3:]) for by_L in T):
            return [diagonal_stretch.stress(self.stretches, by_L) for by_L in T]
        lifted = self._by_C(*T) @ self._lift_turned
        return [np.ascontiguousarray(lifted[:, k]).reshape(-1, 3, 3) for k in range(len(T))]

    def tangent(self, T: Array, K: Array) -> Array:
        """Return ∂²W/∂F² (n, 3, 3, 3, 3) from T = ∂W/∂L (6, n) and K = ∂²W/∂L² (6, 6, n)."""
        if self.axes is None and diagonal_stretch.is_orthotropic(T, K):
            return diagonal_stretch.tangent(self.stretches, self._differences, T, K)
        n = len(self)
        by_C = np.ascontiguousarray(self._by_C(T)[:, 0].T)
        by_L = np.ascontiguousarray(K.reshape(36, n).T).reshape(n, 6, 6)
        stretching = (self._scaled_turn_turned @ by_L) @ self._scaled_turn
        stretching += second_derivative(by_C / self.first, self.second())
        out: Array = ((self._lift @ stretching) @ self._lift_turned).reshape(n, 3, 3, 3, 3)
        S = self._from_axes(by_C[COMPONENT])
        for j, l in itertools.product(range(3), repeat=2):
            for i in range(3):
                out[:, i, j, i, l] += S[j, l]
        return out

    def _by_C(self, *T: Array) -> Array:
        """Return ∂W/∂C (n, k, 6) in the eigenbasis, one place for each component, from ∂W/∂L (6, n) of k potentials."""
        rows = np.ascontiguousarray(np.concatenate(T).T).reshape(len(self), len(T), 6)
        by_C: Array = rows @ self._scaled_turn
        return by_C

    @cached_property
    def _scaled_turn(self) -> Array:
        """∂L/∂C (n, 6, 6) where C is given in the eigenbasis, one place for each of its components."""
        scale = np.ascontiguousarray((self.first * SHARE[:, None]).T)[:, None, :]
        turn: Array = self._turn * scale
        return turn

    @cached_property
    def _scaled_turn_turned(self) -> Array:
        return np.ascontiguousarray(self._scaled_turn.swapaxes(1, 2))

    @cached_property
    def _lift_turned(self) -> Array:
        return np.ascontiguousarray(self._lift.swapaxes(1, 2))

    @cached_property
    def _lift(self) -> Array:
        """V (n, 9, 6) with dC:A = 2 Σ dF_ij V_ij,α A_α for symmetric A (one place each) in the eigenbasis."""
        n, Q = len(self), self._axes
        FQ = self._turned_axes * self.stretches
        V = np.empty((3, 3, 6, n))
        for alpha, (a, b) in enumerate(PLACES):
            np.multiply(FQ[:, None, a], Q[None, :, b], out=V[:, :, alpha])
            if a != b:
                V[:, :, alpha] += FQ[:, None, b] * Q[None, :, a]
        return np.ascontiguousarray(V.reshape(54, n).T).reshape(n, 9, 6)

    @cached_property
    def _turn(self) -> Array:
        """r (n, 6, 6) with L = r L̃: components in the coordinates from those in the eigenbasis."""
        Q, n = self._axes, len(self)
        r = np.empty((6, 6, n))
        for alpha, (i, j) in enumerate(PLACES):
            r[alpha, :3] = Q[i] * Q[j]
            for a, b, beta in PAIRS:
                r[alpha, beta] = Q[i, a] * Q[j, b] + Q[i, b] * Q[j, a]
        return np.ascontiguousarray(r.reshape(36, n).T).reshape(n, 6, 6)

    # ---- what rotates with the solid -------------------------------------------------------------

    def rotated_gradient(self, A: Array, gradients: Gradients) -> Array:
        """Return ∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n), whose derivatives by L are ``gradients``.

        These are (n,) or one number by (place of A, component of L); others are zero.
        """
        n = len(self)
        if self.axes is None:
            return diagonal_stretch.rotated_gradient(self.stretches, self.first, A, gradients)
        assert self.rotations is not None
        by_L = np.zeros((n, 9, 6))
        for (output, component), gradient in gradients.items():
            by_L[:, output, component] = gradient
        rows = by_L.reshape(n, 3, 18)
        spin, direction = self._rotation_factors(A)
        product: Array = ((self.rotations @ rows).reshape(n, 9, 6) @ self._scaled_turn) @ self._lift_turned
        product += spin @ direction
        return product

    def _rotation_factors(self, A: Array) -> tuple[Array, Array]:
        """Return (n, 9, 3) and (n, 3, 9) whose product is ∂(R A)/∂F at fixed A.

        RᵀdR in the eigenbasis is (G_ij − G_ji)/(λ_i + λ_j) of G = Rᵀ dF, so it has three numbers.
        """
        n, Q, u, s = len(self), self._axes, self._turned_axes, self.stretches
        B = _product(Q.swapaxes(0, 1), A)
        spin, direction = np.empty((3, 3, 3, n)), np.empty((3, 3, 3, n))
        for k, (a, b, _) in enumerate(PAIRS):
            weight = 1 / (s[a] + s[b])
            wa, wb = u[:, a] * weight, u[:, b] * weight
            direction[k] = wa[:, None] * Q[None, :, b] - wb[:, None] * Q[None, :, a]
            spin[:, :, k] = u[:, None, a] * B[None, b] - u[:, None, b] * B[None, a]
        return (
            np.ascontiguousarray(spin.reshape(27, n).T).reshape(n, 9, 3),
            np.ascontiguousarray(direction.reshape(27, n).T).reshape(n, 3, 9),
        )

    # ---- bases -----------------------------------------------------------------------------------

    @property
    def _axes(self) -> Array:
        """Eigenvectors (3, 3, n), those of diagonal F as well."""
        if self.axes is not None:
            return self.axes
        return np.broadcast_to(np.eye(3)[:, :, None], self.F.shape)

    @cached_property
    def _turned_axes(self) -> Array:
        """Rotated eigenvectors R Q (3, 3, n)."""
        return self._axes if self.axes is None else _product(self.F, self.axes) / self.stretches

    def _to_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes.swapaxes(0, 1), A), self.axes)

    def _from_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes, A), self.axes.swapaxes(0, 1))


def _product(A: Array, B: Array) -> Array:
    """Return the matrix product of (3, 3, n) arrays."""
    product: Array = A[:, 0, None] * B[None, 0]
    product += A[:, 1, None] * B[None, 1]
    product += A[:, 2, None] * B[None, 2]
    return product
