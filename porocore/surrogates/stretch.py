"""Logarithmic stretch ln U and rotation of F = R U; stress and tangent through it (LogStretch).

Divided differences are the derivatives of a matrix logarithm in the eigenbasis (Daleckii & Krein 1965; Higham,
Functions of Matrices, ch. 3). With m = (x + y)/2 and z = (x − y)/(x + y) those of two points are smooth functions of
z:

    ln[x, y] = artanh(z)/z / m,   ln[x, x, y] = −(1/(1 − z²) − z h(z²)) / 2 m²,   h(w) = Σ_k 2k/(2k+1) w^(k−1)

Where every F is diagonal fewer operations are needed; one-dimensional consolidation asks for nothing else. For the
second derivatives the potential must couple no shear with anything else. All arrays are component-first; s (3, n) are
the stretches, the diagonal of F.

A function of L is objective by construction. With the eigenvectors of U as a basis everything is closed: for
C = U² the derivative of ln C in the direction dC is the divided difference of ln times dC, entry by entry, and so
on for the second (:mod:`porocore.surrogates.stretch`).

Six components stand for a symmetric tensor, in the order 11, 22, 33, 23, 13, 12; a derivative with respect to a
shear component is the one with respect to both of its places at once. Arrays are component-first, so that each
operation runs over the states; only products of matrices lead with the states.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.tensors import symmetric_eigen
from porocore.states import Array

#: Below this |z| the series of h is summed, which is exact to round-off there; beyond it nothing cancels.
SMALL = 0.03
#: Its coefficients, highest power first.
_H = tuple(2 * k / (2 * k + 1) for k in range(6, 0, -1))
#: Keeps 0/0 away.
_TINY = 1e-300
#: Three points closer than this share of their mean are developed around it; terms of that series.
_CLOSE, _TERMS = 0.05, 12


def pair_differences(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return ln[x, y], ln[x, x, y] and ln[x, y, y] of positive numbers."""
    m: Array = (x + y) / 2
    z: Array = (x - y) / (x + y)
    w = z * z
    one_over = 1 / (1 - w)
    size = np.maximum(np.abs(z), _TINY)
    ratio = np.arctanh(size) / size
    small = np.flatnonzero(size < SMALL)
    if len(small) == z.size:
        h = _horner(_H, w)
    else:
        h = (one_over - ratio) / np.maximum(w, _TINY)
        h.reshape(-1)[small] = _horner(_H, w.reshape(-1)[small])
    scale = -0.5 / (m * m)
    zh = z * h
    return ratio / m, scale * (one_over - zh), scale * (one_over + zh)


def triple_difference(x: Array, y: Array, z: Array) -> Array:
    """Return ln[x, y, z] of positive numbers (n,) in any order."""
    low, high = np.minimum(np.minimum(x, y), z), np.maximum(np.maximum(x, y), z)
    middle = np.maximum(np.minimum(x, y), np.minimum(np.maximum(x, y), z))
    spread = high - low
    close = spread < _CLOSE * (low + high)
    found: Array = (pair_differences(low, middle)[0] - pair_differences(middle, high)[0]) / np.where(
        close, -1.0, -spread
    )
    if close.any():
        rows = np.flatnonzero(close)
        found[rows] = _series(low[rows], middle[rows], high[rows])
    return found


def _series(x: Array, y: Array, z: Array) -> Array:
    """Return Σ_k ln⁽ᵏ⁺²⁾(m)/(k+2)! h_k(x − m, y − m, z − m), h_k the complete homogeneous symmetric polynomials."""
    m = (x + y + z) / 3
    one, two, three = np.ones_like(m), np.ones_like(m), np.ones_like(m)
    a, b, c = (x - m) / m, (y - m) / m, (z - m) / m
    total = -0.5 * three
    for k in range(1, _TERMS):
        one = one * a
        two = one + b * two
        three = two + c * three
        total = total + (-1.0) ** (k + 1) / (k + 2) * three
    scaled: Array = total / m**2
    return scaled


def _horner(coefficients: tuple[float, ...], w: Array) -> Array:
    value = np.full_like(w, coefficients[0])
    for coefficient in coefficients[1:]:
        value *= w
        value += coefficient
    return value


#: Places of the six components.
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Component at each of the nine places.
COMPONENT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
#: A derivative with respect to a component, shared among its places.
SHARE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
#: Two different axes, and where a shear between them stands among the six.
PAIRS = ((1, 2, 3), (0, 2, 4), (0, 1, 5))


#: Derivatives by L, (n,) or constant, by (place, component).
Gradients = Mapping[tuple[int, int], Array | float]


def stress(s: Array, T: Array) -> Array:
    """Return ∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n), whose shears are zero."""
    out = np.zeros((s.shape[1], 9))
    for i in range(3):
        np.divide(T[i], s[i], out=out[:, 4 * i])
    return out.reshape(-1, 3, 3)


def is_orthotropic(T: Array, K: Array) -> bool:
    """Return whether ∂W/∂L (6, n) and ∂²W/∂L² (6, 6, n) couple no shear to anything else."""
    blocks = (T[3:], K[0, 3:], K[1, 3:], K[2, 3:], K[3, 4:], K[4, 5:])
    return all(vanishes(block) for block in blocks)


def vanishes(block: Array) -> bool:
    """Return whether all entries are zero; NaN is not."""
    flat = block.reshape(-1)
    return bool(flat @ flat == 0)


def uniaxial_differences(c: Array, axis: int) -> tuple[Array, Array, Array]:
    """Return ln[c_i, c_j], ln[c_i, c_i, c_j] and ln[c_i, c_j, c_j] of the three ``PAIRS`` of c (3, n), (3, n) each.

    All entries of c but those of ``axis`` are equal, state by state.
    """
    other = (axis + 1) % 3
    g, twice_other, twice_axis = pair_differences(c[other], c[axis])
    pair, left, right = np.empty_like(c), np.empty_like(c), np.empty_like(c)
    for k, (i, _, _) in enumerate(PAIRS):
        if k == axis:  # the pair of the other two
            pair[k] = 1 / c[other]
            left[k] = right[k] = -0.5 * pair[k] * pair[k]
        else:
            pair[k] = g
            left[k], right[k] = (twice_axis, twice_other) if i == axis else (twice_other, twice_axis)
    return pair, left, right


def tangent(s: Array, differences: tuple[Array, Array, Array], T: Array, K: Array) -> Array:
    """Return ∂²W/∂F² (n, 3, 3, 3, 3) of an orthotropic W; ``differences`` are those of the three pairs of λ²."""
    g, left, right = differences
    out = np.zeros((s.shape[1], 3, 3, 3, 3))
    inverse = 1 / s
    S = T[:3] * inverse * inverse
    for i in range(3):
        out[:, i, i, i, i] = inverse[i] * inverse[i] * (K[i, i] - T[i])
        for j in range(i + 1, 3):
            out[:, i, i, j, j] = out[:, j, j, i, i] = inverse[i] * inverse[j] * K[i, j]
    for pair, (i, j, shear) in enumerate(PAIRS):
        # The curvature of ln C and that of W in the shear, for dC_ij = λ_i dF_ij + λ_j dF_ji.
        inner = T[i] * left[pair] + T[j] * right[pair] + g[pair] * g[pair] / 4 * K[shear, shear]
        once = s[i] * inner
        out[:, i, j, i, j] = s[i] * once + S[j]
        out[:, j, i, j, i] = s[j] * s[j] * inner + S[i]
        out[:, i, j, j, i] = out[:, j, i, i, j] = s[j] * once
    return out


def rotated_gradient(s: Array, first: Array, A: Array, gradients: Gradients) -> Array:
    """Return ∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n) with these ∂A/∂L; ``first`` are ln[λ_i², λ_j²] (6, n)."""
    out = np.zeros((s.shape[1], 9, 9))
    inverse = 1 / s
    for (output, component), gradient in gradients.items():
        if component < 3:
            np.multiply(gradient, inverse[component], out=out[:, output, 4 * component])
    nine = A.reshape(9, -1)
    is_diagonal = vanishes(nine[1:4]) and vanishes(nine[5:8])
    turned = [divmod(place, 3) for place in range(0, 9, 4 if is_diagonal else 1)]
    for i, j, shear in PAIRS:
        by_shear = {
            output: gradient for (output, component), gradient in gradients.items() if component == shear
        }
        half = first[shear] / 2
        # dR_ij = (dF_ij − dF_ji)/(λ_i + λ_j) = −dR_ji.
        weight = 1 / (s[i] + s[j])
        spins = {3 * i + k: weight * A[j, k] for row, k in turned if row == j}
        spins |= {3 * j + k: -weight * A[i, k] for row, k in turned if row == i}
        for output in by_shear.keys() | spins.keys():
            stretching, spin = by_shear.get(output, 0.0) * half, spins.get(output, 0.0)
            np.add(stretching * s[i], spin, out=out[:, output, 3 * i + j])
            np.subtract(stretching * s[j], spin, out=out[:, output, 3 * j + i])
    return out


#: The component of the function's derivative, and the three eigenvalues of C between which ln is differenced.
Factors = tuple[int, tuple[int, int, int]]


def _terms() -> dict[tuple[int, int], dict[Factors, float]]:
    """Return the terms by two components α ≤ β of C, whose exchange changes nothing."""
    found: dict[tuple[int, int], dict[Factors, float]] = {}
    for alpha, (a, b) in enumerate(PLACES):
        for i in range(3):
            # ∂S_ab/∂C_ia and ∂S_ab/∂C_bi, each a half of a place above and one below the diagonal.
            low, middle, high = sorted((i, a, b))
            for beta, place, twice in (
                (COMPONENT[i, a], COMPONENT[i, b], i == a),
                (COMPONENT[b, i], COMPONENT[a, i], i == b),
            ):
                if alpha <= beta:
                    terms = found.setdefault((alpha, int(beta)), {})
                    key = int(place), (low, middle, high)
                    terms[key] = terms.get(key, 0.0) + (2.0 if twice else 1.0)
    return found


#: Terms of ∂S_α/∂C_β, with their numbers.
CURVATURE = _terms()


def second_derivative(T: Array, differences: dict[tuple[int, int, int], Array]) -> Array:
    """Return 2 ∂S/∂C (n, 6, 6) at fixed ∂W/∂L, from its nine places T (6, n); all in the eigenbasis.

    S = 2 ∂W/∂C has the second divided differences of ln:
    T:∂²ln C[A, B] = Σ T_ij ln[i, k, j] (A_ik B_kj + B_ik A_kj).
    """
    X = np.zeros((T.shape[1], 6, 6))
    for (alpha, beta), terms in CURVATURE.items():
        value = sum(factor * (T[place] * differences[points]) for (place, points), factor in terms.items())
        X[:, alpha, beta] = X[:, beta, alpha] = value
    return X


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
        diagonal = vanishes(F[1:4]) and vanishes(F[5:8])
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
                    return uniaxial_differences(c, alike - 3)
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
        if self.axes is None and all(vanishes(by_L[3:]) for by_L in T):
            return [stress(self.stretches, by_L) for by_L in T]
        lifted = self._by_C(*T) @ self._lift_turned
        return [np.ascontiguousarray(lifted[:, k]).reshape(-1, 3, 3) for k in range(len(T))]

    def tangent(self, T: Array, K: Array) -> Array:
        """Return ∂²W/∂F² (n, 3, 3, 3, 3) from T = ∂W/∂L (6, n) and K = ∂²W/∂L² (6, 6, n)."""
        if self.axes is None and is_orthotropic(T, K):
            return tangent(self.stretches, self._differences, T, K)
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
            return rotated_gradient(self.stretches, self.first, A, gradients)
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
