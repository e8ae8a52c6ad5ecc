"""The logarithmic stretch L = ln U of F = I + H = R U, and derivatives through it.

A function of L is objective by construction. With the eigenvectors of U as a basis everything is closed: for
C = U² the derivative of ln C in the direction dC is the divided difference of ln times dC, entry by entry, and so
on for the second (:mod:`porocore.surrogates.divided_differences`).

Six components stand for a symmetric tensor, in the order 11, 22, 33, 23, 13, 12; a derivative with respect to a
shear component is the one with respect to both of its places at once. Arrays are component-first, so that each
operation runs over the states; only products of matrices lead with the states.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.states import Array
from porocore.surrogates import diagonal_stretch
from porocore.surrogates.components import COMPONENT, PAIRS, PLACES, SHARE
from porocore.surrogates.diagonal_stretch import Slopes
from porocore.surrogates.divided_differences import of_three, of_two

#: Of Jacobi's rotations at most; entries off the diagonal count as zero below this share of the trace.
SWEEPS, ROUND_OFF = 8, 1e-18
#: Keeps 0/0 away.
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class LogStretch:
    """n deformation gradients with det F > 0; where it is not, everything is NaN.

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
    def of(cls, grad_u: Array) -> LogStretch:
        """From H (n, 3, 3)."""
        n = len(grad_u)
        F = np.array(grad_u.reshape(n, 9).T, order="C")
        F[::4] += 1.0
        diagonal = not (F[1:4].any() or F[5:8].any())
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
        """ln U, six components (6, n)."""
        logs = np.log(self.stretches)
        if self.axes is None:
            L = np.zeros((6, len(self)))
            L[:3] = logs
            return L
        Q = self.axes
        return np.stack([(Q[i] * Q[j] * logs).sum(axis=0) for i, j in PLACES])

    @cached_property
    def rotation(self) -> Array | None:
        """R (3, 3, n); None where all F are diagonal."""
        if self.axes is None:
            return None
        return _product(self._turned_axes, self.axes.swapaxes(0, 1))

    @cached_property
    def rotations(self) -> Array | None:
        """R (n, 3, 3); None where all F are diagonal."""
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
        return of_two(c[[1, 0, 0]], c[[2, 2, 1]])

    @cached_property
    def first(self) -> Array:
        """Divided differences g_ij = ln[λ_i², λ_j²], six components (6, n)."""
        return np.concatenate([1 / self.stretches**2, self._differences[0]])

    def second(self) -> dict[tuple[int, int, int], Array]:
        """Divided differences ln[λ_i², λ_j², λ_k²] for i ≤ j ≤ k."""
        c, (_, left, right) = self.stretches**2, self._differences
        found = {(i, i, i): -0.5 / c[i] ** 2 for i in range(3)}
        for pair, (i, j, _) in enumerate(PAIRS):
            found[i, i, j], found[i, j, j] = left[pair], right[pair]
        found[0, 1, 2] = of_three(*c)
        return found

    # ---- from F to L: what a solved cell says of W as a function of L ----------------------------

    def pull(self, P: Array) -> Array:
        """∂W/∂L (6, n) from P = ∂W/∂F (3, 3, n) of an objective W."""
        # Along dF = R dU nothing rotates, and dU follows from dL entry by entry in the eigenbasis.
        P = self._to_axes(P if self.rotation is None else _product(self.rotation.swapaxes(0, 1), P))
        A = self._from_axes((P + P.swapaxes(0, 1)) / 2 / self._log_of_stretch)
        return np.stack([A[i, j] if i == j else A[i, j] + A[j, i] for i, j in PLACES])

    def pull_direction(self, component: int) -> Array:
        """dF (3, 3, n) that changes one component of L by 1, a shear in both places, and does not rotate."""
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
        """∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n)."""
        if self.axes is None and not T[3:].any():
            return diagonal_stretch.stress(self.stretches, T)
        by_C = (np.ascontiguousarray(T.T)[:, None, :] @ self._scaled_turn)[:, 0, :, None]
        return (self._lift @ by_C).reshape(-1, 3, 3)

    def tangent(self, T: Array, K: Array) -> Array:
        """∂²W/∂F² (n, 3, 3, 3, 3) from T = ∂W/∂L (6, n) and K = ∂²W/∂L² (6, 6, n)."""
        if self.axes is None and diagonal_stretch.is_orthotropic(T, K):
            return diagonal_stretch.tangent(self.stretches, self._differences, T, K)
        n = len(self)
        T_axes = T if self.axes is None else (np.ascontiguousarray(T.T)[:, None, :] @ self._turn)[:, 0].T
        by_L = np.ascontiguousarray(K.reshape(36, n).T).reshape(n, 6, 6)
        bend = np.ascontiguousarray(self._curvature(T_axes).reshape(36, n).T).reshape(n, 6, 6)
        bend += (self._scaled_turn_turned @ by_L) @ self._scaled_turn
        out = ((self._lift @ bend) @ self._lift_turned).reshape(n, 3, 3, 3, 3)
        S = self._from_axes((self.first * SHARE[:, None] * T_axes)[COMPONENT])
        S = np.ascontiguousarray(S.reshape(9, n).T).reshape(n, 3, 3)
        for i in range(3):
            out[:, i, :, i, :] += S
        result: Array = out
        return result

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

    def _curvature(self, T: Array) -> Array:
        """2 ∂S/∂C (6, 6, n) at fixed ∂W/∂L, places of the components, in the eigenbasis, where T is given, too.

        S = 2 ∂W/∂C has the second divided differences of ln: with the nine-place T,
        T:∂²ln C[A, B] = Σ T_ij ln[i, k, j] (A_ik B_kj + B_ik A_kj).
        """
        f = self.second()
        six = T * SHARE[:, None]
        X = np.zeros((6, 6, len(self)))
        for alpha, (a, b) in enumerate(PLACES):
            for i in range(3):
                # ∂S_ab/∂C_ia and ∂S_ab/∂C_bi, each a half of a place above and one below the diagonal.
                value = f[tuple(sorted((i, a, b)))]  # type: ignore[index]
                first, second = COMPONENT[i, a], COMPONENT[b, i]
                X[alpha, first] += six[COMPONENT[i, b]] * value * (2.0 if i == a else 1.0)
                X[alpha, second] += six[COMPONENT[a, i]] * value * (2.0 if i == b else 1.0)
        return X

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

    def rotation_gradient(self, A: Array) -> Array:
        """∂(R A)/∂F at fixed A (3, 3, n): (3, 3, 3, 3, n), the last two places those of F."""
        left, right = self._rotation_factors(A)
        n = len(self)
        return np.moveaxis(left @ right, 0, -1).reshape(3, 3, 3, 3, n)

    def rotated_gradient(self, A: Array, slopes: Slopes) -> Array:
        """∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n), whose derivatives by L are ``slopes``.

        These are (n,) or one number by (place of A, component of L); others are zero.
        """
        n = len(self)
        if self.axes is None:
            return diagonal_stretch.rotated_gradient(self.stretches, self.first, A, slopes)
        assert self.rotations is not None
        by_L = np.zeros((9, 6, n))
        for at, slope in slopes.items():
            by_L[at] = slope
        rows = np.ascontiguousarray(by_L.reshape(54, n).T).reshape(n, 3, 18)
        spin, direction = self._rotation_factors(A)
        product: Array = ((self.rotations @ rows).reshape(n, 9, 6) @ self._scaled_turn) @ self._lift_turned
        product += spin @ direction
        return product

    def _rotation_factors(self, A: Array) -> tuple[Array, Array]:
        """(n, 9, 3) and (n, 3, 9) whose product is ∂(R A)/∂F at fixed A.

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
        """R Q (3, 3, n)."""
        return self._axes if self.axes is None else _product(self.F, self.axes) / self.stretches

    def _to_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes.swapaxes(0, 1), A), self.axes)

    def _from_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes, A), self.axes.swapaxes(0, 1))


def symmetric_eigen(A: Array) -> tuple[Array, Array]:
    """Eigenvalues (3, n) and eigenvectors (3, 3, n), in columns, of symmetric A (3, 3, n).

    By Jacobi's rotations, which converge quadratically; for thousands of matrices at once they are faster than a
    call of LAPACK for each.
    """
    d = np.stack([A[i, i] for i in range(3)])
    off = np.stack([A[1, 2], A[0, 2], A[0, 1]])  # by the third axis
    Q = np.zeros_like(A)  # eigenvectors in rows, so that a rotation mixes two blocks of memory
    Q[0, 0] = Q[1, 1] = Q[2, 2] = 1.0
    smallest = ROUND_OFF * d.sum(axis=0)
    for _ in range(SWEEPS):
        if (np.abs(off).max(axis=0) <= smallest).all():
            break
        for i, j, k in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            e = off[k]
            gap = d[j] - d[i]
            gap *= 0.5
            t = np.sqrt(gap * gap + e * e)
            t += np.abs(gap)
            t += TINY
            t = e / np.copysign(t, gap, out=t)
            c = t * t
            c += 1.0
            np.sqrt(c, out=c)
            np.divide(1.0, c, out=c)
            s = t * c
            t *= e
            d[i] -= t
            d[j] += t
            off[k] = 0.0
            before = off[j].copy()
            off[j] *= c
            off[j] -= s * off[i]
            off[i] *= c
            off[i] += s * before
            turned = s * Q[i]
            Q[i] *= c
            Q[i] -= s * Q[j]
            Q[j] *= c
            Q[j] += turned
    return d, Q.swapaxes(0, 1)


def _product(A: Array, B: Array) -> Array:
    """Matrix product of (3, 3, n) arrays."""
    product: Array = A[:, 0, None] * B[None, 0]
    product += A[:, 1, None] * B[None, 1]
    product += A[:, 2, None] * B[None, 2]
    return product
