"""Undeformed members as functions of θ (RestModel): porosity, stiffness, Biot's data, ⟨∇u¹⟩, conductivity.

W₂(y; θ) = W₀ + g·y + ½ y·A y. The drained stiffness is A_LL = N^½ exp(S) N^½ in Mandel's components, N isotropic with
the upper bounds of Hashin and Shtrikman, S(θ̂) a symmetric polynomial: positive definite for all coefficients. What an
isotropic solid that is the same everywhere ties to it is not learned but follows: Biot's coupling and modulus from
the state in which solid and fluid bear the same pressure, and the linear ⟨∇u¹⟩ from the mean stress of the solid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.inputs.point_coordinates import Coordinates
from porocore.core.tensors.point_group import PointGroup
from porocore.core.tensors.symmetric_functions import exponential, symmetric_exponential
from porocore.states import Array, IntArray
from porocore.surrogates.family.coordinates import Bounds, ParameterMap, bounds
from porocore.surrogates.family.identities import normaliser, tied
from porocore.surrogates.polynomial.monomials import Polynomial

#: Sets of parameters whose rest is kept.
KEPT = 4
#: Entries (n,) of matrices at n points by their row and column.
Places = dict[tuple[int, int], Array]


@dataclass(frozen=True, eq=False)
class RestValues:
    """Undeformed members at n points, and derivatives by the l learned parameters where they are asked for.

    Arrays lead with the components and end with the points; derivatives have an axis of length l before these.

    Attributes
    ----------
    x : (l, n)
        θ̂.
    porosity : (n,)
        φ_f.
    value : (n,), gradient : (7, n), matrix : (7, 7, n)
        W₀, g and A.
    mean_value : (9, n), mean : (9, 7, n)
        ⟨∇u¹⟩_s at y = 0, and its derivatives by y.
    scale : (n,)
        M.
    log_conductivity : (n, r, r)
        ln(Bᵀ K B) for a viscosity of 1.
    slopes
        Derivatives of all of these; of x (l, l, n), of the last (l, n, r, r).
    """

    x: Array
    porosity: Array
    value: Array
    gradient: Array
    matrix: Array
    mean_value: Array
    mean: Array
    scale: Array
    log_conductivity: Array
    slopes: RestValues | None = None

    @cached_property
    def coordinates(self) -> Coordinates:
        """θ̂, with what is known of points that share theirs."""
        return Coordinates(self.x)

    @cached_property
    def linear(self) -> Places:
        """Entries of ``matrix`` that are not zero everywhere."""
        return _places(self.matrix)

    @cached_property
    def mean_linear(self) -> Places:
        """Entries of ``mean`` that are not zero everywhere."""
        return _places(self.mean)

    def take(self, rows: IntArray) -> RestValues:
        """Return the values of some points, which may be repeated."""
        names = ("x", "porosity", "value", "gradient", "matrix", "mean_value", "mean", "scale")
        found = {name: getattr(self, name)[..., rows] for name in names}
        K, slopes = self.log_conductivity, None if self.slopes is None else self.slopes.take(rows)
        return RestValues(**found, log_conductivity=K[rows] if K.ndim == 3 else K[:, rows], slopes=slopes)


@dataclass(frozen=True, eq=False)
class KnownRest:
    """Undeformed members at parameters that were asked for.

    Attributes
    ----------
    theta : (n, m)
        θ.
    values, rows
        Members, and which of them the points have; None: one each.
    """

    theta: Array
    values: RestValues
    rows: IntArray | None = None

    @cached_property
    def at_points(self) -> RestValues:
        """The members at the n points."""
        return self.values if self.rows is None else self.values.take(self.rows)


@dataclass(frozen=True, eq=False)
class RestModel:
    """Model of the undeformed members.

    Attributes
    ----------
    parameters
        Kinds and coordinates of θ.
    symmetry
        Point group that all members have.
    centre, half : (l,)
        θ̂ = (coordinates − centre)/half.
    porosity
        Polynomial of the shape coordinates, one output.
    stiffness
        S, 36 outputs, of θ̂.
    level : float
        N where there are no bounds.
    affine
        W₀ and g, 8 outputs, beyond W₀ = 0, g = (0, −φ_f); without monomials where these are exact.
    coupling
        Last row of A, 7 outputs, beyond what the solid ties to the stiffness.
    mean
        ⟨∇u¹⟩_s at y = 0 and its derivatives by y, 9 + 63 outputs, beyond the same.
    basis : (3, r)
        B, directions in which the pores conduct; r = 0 where no conductivity is known.
    conductivity
        ln(Bᵀ K B), r² outputs.
    """

    parameters: ParameterMap
    symmetry: PointGroup
    centre: Array
    half: Array
    porosity: Polynomial
    stiffness: Polynomial
    level: float
    affine: Polynomial
    coupling: Polynomial
    mean: Polynomial
    basis: Array
    conductivity: Polynomial

    def at(self, theta: Array, *, slopes: bool = False) -> RestValues:
        """Return the undeformed members at θ (n, m); those of the last parameters are kept."""
        return self._known(theta, slopes).at_points

    def together(self, theta: Array, *, slopes: bool = False) -> RestValues:
        """Return the same; of one point, n = 1, where all parameters are the same."""
        known = self._known(theta, slopes)
        return known.values if known.values.x.shape[1] == 1 else known.at_points

    def _known(self, theta: Array, slopes: bool) -> KnownRest:
        kept = self._kept
        for i, known in enumerate(kept):
            if (not slopes or known.values.slopes is not None) and np.array_equal(known.theta, theta):
                kept.insert(0, kept.pop(i))
                return known
        unique, rows = np.unique(theta, axis=0, return_inverse=True)
        if len(unique) <= len(theta) // 2:
            found = KnownRest(theta.copy(), self._compute(unique, slopes), rows.reshape(-1))
        else:
            found = KnownRest(theta.copy(), self._compute(theta, slopes))
        kept.insert(0, found)
        del kept[KEPT:]
        return found

    @cached_property
    def _kept(self) -> list[KnownRest]:
        return []

    def coordinates(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Return θ̂ (l, n), its derivatives by θ (l, l, n), φ_f (n,) and its derivatives (l, n)."""
        shape, slope = self.parameters.shape(theta)
        phi, by_shape, _ = self.porosity.derivatives(shape.T, second=False)
        phi_slopes = by_shape[0].T * slope
        x, J = self.parameters.smooth(theta, phi[0], phi_slopes)
        scaled = ((x - self.centre) / self.half).T
        return scaled, np.moveaxis(J / self.half[:, None], 0, -1), phi[0], phi_slopes.T

    def conductivities(self, theta: Array) -> Array | None:
        """Return K (n, 3, 3) of the undeformed pore at θ (n, m); None where it is not known."""
        if not self.basis.shape[1]:
            return None
        _, _, viscosity = self.parameters.factors(theta)
        found: Array = self.basis @ exponential(self.at(theta).log_conductivity) @ self.basis.T
        return found / viscosity[:, None, None]

    def conductivity_slopes(self, theta: Array) -> Array | None:
        """Return the derivatives (n, 3, 3, m) of K of the undeformed pore by θ; None where it is not known."""
        if not self.basis.shape[1]:
            return None
        at, kinds, r = self.together(theta, slopes=True), self.parameters.kinds, self.basis.shape[1]
        assert at.slopes is not None
        n = at.x.shape[1]
        if n == 1 < len(theta):
            same = self.conductivity_slopes(theta[:1])
            return None if same is None else np.broadcast_to(same, (len(theta), *same.shape[1:]))
        _, _, viscosity = self.parameters.factors(theta)
        ways = np.zeros((n, len(kinds), r, r))
        ways[:, self.parameters.learned] = np.moveaxis(at.slopes.log_conductivity, 0, 1)
        for k in np.flatnonzero(np.array(kinds) == "viscosity"):
            ways[:, k] = -np.eye(r) / theta[:, k, None, None]
        _, found = symmetric_exponential(at.log_conductivity, ways)
        found = self.basis @ found @ self.basis.T / viscosity[:, None, None, None]
        return np.moveaxis(found, 1, -1)

    def _compute(self, theta: Array, slopes: bool) -> RestValues:
        x, J, phi, phi_slopes = self.coordinates(theta)
        if not slopes:
            J, phi_slopes = J[:, :0], phi_slopes[:0]
        solid = self.solid(theta, phi, phi_slopes) if self.parameters.isotropic else None
        C, C_slopes = self._stiffness(x, J, solid)
        wave = np.einsum("aan->n", C) / 6 if solid is None else solid[0].wave
        wave_slopes = np.einsum("aaln->ln", C_slopes) / 6 if solid is None else solid[1].wave
        A, A_slopes, m, m_slopes = tied(C, C_slopes, phi, phi_slopes, solid)
        more, more_slopes = _chained(self.coupling, x, J)
        A[6] += more
        A[:6, 6] += more[:6]
        affine, affine_slopes = _chained(self.affine, x, J)
        mean, mean_slopes = _chained(self.mean, x, J)
        K, K_slopes = _chained(self.conductivity, x, J)
        r, n = self.basis.shape[1], len(theta)
        affine[7] -= phi
        found = None
        if slopes:
            A_slopes[6] += more_slopes
            A_slopes[:6, 6] += more_slopes[:6]
            affine_slopes[7] -= phi_slopes
            m_slopes += mean_slopes[9:].reshape(9, 7, *mean_slopes.shape[1:])
            found = RestValues(
                J, phi_slopes, affine_slopes[0], affine_slopes[1:], A_slopes, mean_slopes[:9], m_slopes,
                wave_slopes, np.moveaxis(K_slopes.reshape(r, r, len(x), n), (2, 3), (0, 1)),
            )  # fmt: skip
        m += mean[9:].reshape(9, 7, n)
        log_K = np.moveaxis(K.reshape(r, r, n), -1, 0)
        return RestValues(x, phi, affine[0], affine[1:], A, mean[:9], m, wave, log_K, found)

    def solid(self, theta: Array, phi: Array, phi_slopes: Array) -> tuple[Bounds, Bounds]:
        """Return the bounds (n,) and their derivatives (l, n) by θ, as many as those of φ_f."""
        nu, nu_slopes = self.parameters.poisson_ratio(theta)
        values, by_phi, by_nu = bounds(phi, nu)
        by = [
            getattr(by_phi, name) * phi_slopes + getattr(by_nu, name) * nu_slopes.T[: len(phi_slopes)]
            for name in ("bulk", "shear", "drained", "wave")
        ]
        return values, Bounds(*by)

    def _stiffness(self, x: Array, J: Array, solid: tuple[Bounds, Bounds] | None) -> tuple[Array, Array]:
        """Return the stiffness in Mandel's components (6, 6, n) and its derivatives (6, 6, l, n)."""
        n = x.shape[1]
        S, S_slopes = _chained(self.stiffness, x, J)
        S_slopes = S_slopes.reshape(6, 6, J.shape[1], n)
        E, E_slopes = symmetric_exponential(
            np.moveaxis(S.reshape(6, 6, n), -1, 0), np.moveaxis(S_slopes, (2, 3), (1, 0))
        )
        if solid is None:
            return self.level * np.moveaxis(E, 0, -1), self.level * np.moveaxis(E_slopes, (0, 1), (3, 2))
        root, root_slopes = normaliser(*solid)
        C = root @ E @ root
        left = root_slopes @ (E @ root)[:, None]
        C_slopes = left + left.swapaxes(-1, -2) + root[:, None] @ E_slopes @ root[:, None]
        return np.moveaxis(C, 0, -1), np.moveaxis(C_slopes, (0, 1), (3, 2))


def _chained(polynomial: Polynomial, x: Array, J: Array) -> tuple[Array, Array]:
    """Return values (o, n) of polynomials of θ̂, and derivatives (o, l, n) by as many of θ as those of θ̂, (l, l, n)."""
    if not J.shape[1]:
        return polynomial.evaluate(x), np.zeros((len(polynomial.coefficients), 0, x.shape[1]))
    value, by_x, _ = polynomial.derivatives(x, second=False)
    return value, np.einsum("ocn,cln->oln", by_x, J)


def _places(matrices: Array) -> Places:
    return {(int(i), int(j)): matrices[i, j] for i, j in np.argwhere(matrices.any(axis=2))}
