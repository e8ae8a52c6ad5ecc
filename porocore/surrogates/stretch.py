"""The logarithmic stretch L = ln U of F = I + H = R U, and derivatives through it.

A function of L is objective by construction. With the eigenvectors of U as a basis everything is closed: for
C = U² the derivative of ln C in the direction dC is the divided difference of ln times dC, entry by entry
(Daleckii & Krein 1965; Higham, Functions of Matrices, ch. 3), and so on for the second.

Six components stand for a symmetric tensor, in the order 11, 22, 33, 23, 13, 12; a derivative with respect to a
shear component is the one with respect to both of its places at once. Arrays are component-first, so that each
operation runs over the states.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from porocore.states import Array

#: Places of the six components.
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Component at each of the nine places.
COMPONENT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
_ROWS, _COLUMNS = np.array(PLACES).T
#: A derivative with respect to a component, shared among its places.
_SHARE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
#: Eigenvalues of C closer than this relative distance are treated as one in a divided difference.
CLOSE = 1e-4
#: Of Jacobi's rotations; they converge quadratically, and five reach round-off for any 3 × 3 matrix.
SWEEPS = 6


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
        F = np.moveaxis(grad_u, 0, -1) + np.eye(3)[:, :, None]
        off = F[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]]
        if not off.any():
            stretches = np.stack([F[0, 0], F[1, 1], F[2, 2]])
            bad = ~(stretches > 0).all(axis=0)
            return cls(F, np.where(bad, np.nan, stretches) if bad.any() else stretches, None)
        determinant = (
            F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
            - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
            + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
        )
        squares, axes = symmetric_eigen(_product(F.swapaxes(0, 1), F))
        squares = np.where((determinant > 0) & (squares > 0).all(axis=0), squares, np.nan)
        return cls(F, np.sqrt(squares), axes)

    def __len__(self) -> int:
        return self.F.shape[-1]

    @cached_property
    def L(self) -> Array:
        """ln U, six components (6, n)."""
        logs = np.log(self.stretches)
        if self.axes is None:
            return np.concatenate([logs, np.zeros((3, len(self)))])
        Q = self.axes
        return np.stack([(Q[i] * Q[j] * logs).sum(axis=0) for i, j in PLACES])

    @cached_property
    def rotation(self) -> Array | None:
        """R (3, 3, n); None where all F are diagonal."""
        if self.axes is None:
            return None
        Q = self.axes
        inverse = _product(Q / self.stretches, Q.swapaxes(0, 1))
        return _product(self.F, inverse)

    @cached_property
    def first(self) -> Array:
        """Divided differences g_ij = ln[λ_i², λ_j²] (3, 3, n)."""
        c = self.stretches**2
        g = np.empty((3, 3, len(self)))
        for i in range(3):
            g[i, i] = 1 / c[i]
            for j in range(i):
                g[i, j] = g[j, i] = _log_difference(c[i], c[j])
        return g

    def second(self) -> dict[tuple[int, int, int], Array]:
        """Divided differences ln[λ_i², λ_j², λ_k²] for i ≤ j ≤ k."""
        c, g = self.stretches**2, self.first
        found = {}
        for i in range(3):
            for j in range(i, 3):
                for k in range(j, 3):
                    if i == k:
                        found[i, j, k] = -0.5 / c[i] ** 2
                    else:
                        found[i, j, k] = _second_difference(c[i], c[j], c[k], g[i, j], g[j, k])
        return found

    # ---- from F to L: what a solved cell says of W as a function of L ----------------------------

    def pull(self, P: Array) -> Array:
        """∂W/∂L (6, n) from P = ∂W/∂F (3, 3, n) of an objective W."""
        # Along dF = R dU nothing rotates, and dU follows from dL entry by entry in the eigenbasis.
        P = self._to_axes(P if self.rotation is None else _product(self.rotation.swapaxes(0, 1), P))
        return self._six(self._from_axes((P + P.swapaxes(0, 1)) / 2 / self._log_of_stretch))

    def pull_direction(self, component: int) -> Array:
        """dF (3, 3, n) that changes one component of L by 1, a shear in both places, and does not rotate."""
        E = np.zeros((3, 3, len(self)))
        i, j = PLACES[component]
        E[i, j] = E[j, i] = 1.0
        dU = self._from_axes(self._to_axes(E) / self._log_of_stretch)
        return dU if self.rotation is None else _product(self.rotation, dU)

    @cached_property
    def _log_of_stretch(self) -> Array:
        """ln[λ_i, λ_j]."""
        s = self.stretches
        return self.first * (s[:, None] + s[None, :]) / 2

    # ---- from L to F -----------------------------------------------------------------------------

    @cached_property
    def gradient(self) -> Array:
        """∂L/∂F (n, 9, 6), the places of F row by row."""
        gradient: Array = self._lift * (self.first[_ROWS, _COLUMNS] * _SHARE[:, None]).T[:, None, :]
        if self.axes is not None:
            gradient = gradient @ self._turn.swapaxes(1, 2)
        return gradient

    def stress(self, T: Array) -> Array:
        """∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n)."""
        if self.axes is None and not T[3:].any():
            out = np.zeros((len(self), 9))
            out[:, ::4] = (T[:3] / self.stretches).T
            return out.reshape(-1, 3, 3)
        return (self.gradient @ T.T[:, :, None]).reshape(-1, 3, 3)

    def tangent(self, T: Array, K: Array) -> Array:
        """∂²W/∂F² (n, 3, 3, 3, 3) from T = ∂W/∂L (6, n) and K = ∂²W/∂L² (6, 6, n)."""
        T_axes = T if self.axes is None else (T.T[:, None, :] @ self._turn)[:, 0].T
        S = self.first[_ROWS, _COLUMNS] * _SHARE[:, None] * T_axes
        X = self._curvature(T_axes)
        if self.axes is None:
            if not (T[3:].any() or K[:3, 3:].any() or K[[3, 3, 4], [4, 5, 5]].any()):
                return self._orthotropic(S, X, K)
            g = self.first[_ROWS, _COLUMNS] * _SHARE[:, None]
            inner = X + g[:, None] * g[None, :] * K
            out = self._lift @ np.moveaxis(inner, -1, 0) @ self._lift.swapaxes(1, 2)
        else:
            # Both parts in one product.
            left = np.concatenate(
                [self.gradient @ np.moveaxis(K, -1, 0), self._lift @ np.moveaxis(X, -1, 0)], axis=2
            )
            out = left @ np.concatenate([self.gradient, self._lift], axis=2).swapaxes(1, 2)
        S_nine = self._from_axes(S[COMPONENT])
        out = out.reshape(-1, 3, 3, 3, 3)
        for i in range(3):
            out[:, i, :, i, :] += np.moveaxis(S_nine, -1, 0)
        result: Array = out
        return result

    def _orthotropic(self, S: Array, X: Array, K: Array) -> Array:
        """The tangent for diagonal F where nothing couples shears with anything else; S and X are in the axes of F."""
        out = np.zeros((len(self), 3, 3, 3, 3))
        s, g = self.stretches, self.first
        for i in range(3):
            for j in range(3):
                alpha = COMPONENT[i, j]
                if i == j:
                    for k in range(3):
                        out[:, i, i, k, k] = s[i] * s[k] * (X[i, k] + g[i, i] * g[k, k] * K[i, k])
                    out[:, i, i, i, i] += S[i]
                else:
                    inner = X[alpha, alpha] + g[i, j] ** 2 / 4 * K[alpha, alpha]
                    out[:, i, j, i, j] = s[i] ** 2 * inner + S[j]
                    out[:, i, j, j, i] = s[i] * s[j] * inner
        return out

    def _curvature(self, T: Array) -> Array:
        """2 ∂S/∂C (6, 6, n) at fixed ∂W/∂L, places of the components, in the eigenbasis, where T is given, too.

        S = 2 ∂W/∂C has the second divided differences of ln: with the nine-place T,
        T:∂²ln C[A, B] = Σ T_ij ln[i, k, j] (A_ik B_kj + B_ik A_kj).
        """
        f = self.second()
        six = T * _SHARE[:, None]
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
        n = len(self)
        V = np.zeros((9, 6, n))
        if self.axes is None:
            for i in range(3):
                for j in range(3):
                    V[3 * i + j, COMPONENT[i, j]] = self.stretches[i]
        else:
            Q, F = self.axes, _product(self.F, self.axes)
            for alpha, (a, b) in enumerate(PLACES):
                V[:, alpha] = (F[:, None, a] * Q[None, :, b]).reshape(9, n)
                if a != b:
                    V[:, alpha] += (F[:, None, b] * Q[None, :, a]).reshape(9, n)
        return np.ascontiguousarray(np.moveaxis(V, -1, 0))

    @cached_property
    def _turn(self) -> Array:
        """r (n, 6, 6) with L = r L̃: components in the coordinates from those in the eigenbasis."""
        Q = self.axes
        assert Q is not None
        r = np.empty((6, 6, len(self)))
        for alpha, (i, j) in enumerate(PLACES):
            for beta, (a, b) in enumerate(PLACES):
                r[alpha, beta] = Q[i, a] * Q[j, b] if a == b else Q[i, a] * Q[j, b] + Q[i, b] * Q[j, a]
        return np.ascontiguousarray(np.moveaxis(r, -1, 0))

    def rotation_gradient(self, A: Array) -> Array:
        """∂(R A)/∂F at fixed A (3, 3, n): (3, 3, 3, 3, n), the last two places those of F."""
        n = len(self)
        Q = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n)) if self.axes is None else self.axes
        R = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n)) if self.rotation is None else self.rotation
        s = self.stretches
        RQ, QA = _product(R, Q), _product(Q.swapaxes(0, 1), A)
        # RᵀdR in the eigenbasis is (G_ij − G_ji)/(λ_i + λ_j) of G = Rᵀ dF.
        weights = 1 / (s[:, None] + s[None, :])
        out = np.einsum("iaN,abN,bjN,kaN,lbN->ijklN", RQ, weights, QA, RQ, Q, optimize=True)
        out -= np.einsum("iaN,abN,bjN,kbN,laN->ijklN", RQ, weights, QA, RQ, Q, optimize=True)
        result: Array = out
        return result

    # ---- bases -----------------------------------------------------------------------------------

    def _to_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes.swapaxes(0, 1), A), self.axes)

    def _from_axes(self, A: Array) -> Array:
        return A if self.axes is None else _product(_product(self.axes, A), self.axes.swapaxes(0, 1))

    @staticmethod
    def _six(A: Array) -> Array:
        """∂/∂(six components) of a symmetric ∂/∂(nine places)."""
        return np.stack([A[i, j] if i == j else A[i, j] + A[j, i] for i, j in PLACES])


def symmetric_eigen(A: Array) -> tuple[Array, Array]:
    """Eigenvalues (3, n) and eigenvectors (3, 3, n), in columns, of symmetric A (3, 3, n), by Jacobi's rotations.

    For thousands of small matrices at once this is faster than a call of LAPACK for each.
    """
    a = {(i, j): A[i, j].copy() for i in range(3) for j in range(i, 3)}
    Q = np.zeros_like(A)
    Q[0, 0] = Q[1, 1] = Q[2, 2] = 1.0
    for _ in range(SWEEPS):
        if not any(a[place].any() for place in ((0, 1), (0, 2), (1, 2))):
            break
        for i, j in ((0, 1), (0, 2), (1, 2)):
            k = 3 - i - j
            off = a[i, j]
            gap = (a[j, j] - a[i, i]) / 2
            norm = np.abs(gap) + np.hypot(gap, off)
            t = np.where(norm > 0, off / np.where(norm > 0, norm, 1.0), 0.0) * np.where(gap < 0, -1.0, 1.0)
            c = 1 / np.sqrt(1 + t * t)
            s = t * c
            a[i, i] = a[i, i] - t * off
            a[j, j] = a[j, j] + t * off
            a[i, j] = np.zeros_like(off)
            ik, jk = (min(i, k), max(i, k)), (min(j, k), max(j, k))
            a[ik], a[jk] = c * a[ik] - s * a[jk], s * a[ik] + c * a[jk]
            Q[:, i], Q[:, j] = c * Q[:, i] - s * Q[:, j], s * Q[:, i] + c * Q[:, j]
    return np.stack([a[0, 0], a[1, 1], a[2, 2]]), Q


def _product(A: Any, B: Any) -> Array:
    """Matrix product of (3, 3, n) arrays."""
    product: Array = np.einsum("ikn,kjn->ijn", A, B)
    return product


def _log_difference(x: Array, y: Array) -> Array:
    """(ln x − ln y)/(x − y), by artanh so that nothing cancels where x ≈ y."""
    z = (x - y) / (x + y)
    small = np.abs(z) < CLOSE
    safe = np.where(small, 0.5, z)
    ratio = np.where(small, 1 + z * z / 3 + z**4 / 5, np.arctanh(safe) / safe)
    result: Array = 2 / (x + y) * ratio
    return result


def _second_difference(x: Array, y: Array, z: Array, xy: Array, yz: Array) -> Array:
    """ln[x, y, z] from ln[x, y] and ln[y, z]; by its series around the mean where x ≈ z."""
    close = np.abs(x - z) < 0.02 * (x + z)
    spread = np.where(close, 1.0, x - z)
    plain = (xy - yz) / spread
    if not close.any():
        result: Array = plain
        return result
    # ln[x, y, z] = Σ_k f⁽ᵏ⁺²⁾(m)/(k+2)! h_k(x − m, y − m, z − m) with the complete symmetric polynomials h_k.
    m = (x + y + z) / 3
    a, b, c = (x - m) / m, (y - m) / m, (z - m) / m
    # Where y is far off although x ≈ z, order the three so that the outer ones differ.
    far = close & (np.abs(y - m) > 0.02 * m)
    h = _complete(a, b, c, 9)
    series = sum((-1.0) ** (k + 1) / (k + 2) * h[k] for k in range(9)) / m**2
    result = np.where(close, series, plain)
    if far.any():
        other = (yz - _log_difference(x, z)) / np.where(far, y - x, 1.0)
        result = np.where(far, other, result)
    return result


def _complete(a: Array, b: Array, c: Array, count: int) -> list[Array]:
    """Complete homogeneous symmetric polynomials h_0 … of three variables."""
    one, two, three = [np.ones_like(a)], [np.ones_like(a)], [np.ones_like(a)]
    for _ in range(1, count):
        one.append(one[-1] * a)
        two.append(one[-1] + b * two[-1])
        three.append(two[-1] + c * three[-1])
    return three
