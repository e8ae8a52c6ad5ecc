"""Undeformed cells (Rest), and their values at points (RestValues); one cell without parameters (SingleRest).

W₂(y; θ) = W₀ + g·y + ½ y·A y is the expansion of the potential at rest, exact in the limit of small loads. A cell that
is held while its solid swells has an energy W₀, a stress and a mean gradient at rest; of others they are zero, and
g = (0, −φ_f).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.inputs import Coordinates
from porocore.core.tensors import PointGroup, logarithm
from porocore.errors import DataError
from porocore.states import Array, CellResponse, IntArray
from porocore.surrogates.family.coordinates import ParameterMap, Scaling
from porocore.surrogates.polynomial.monomials import VARIABLES
from porocore.surrogates.stretch import PLACES
from porocore.surrogates.symmetry import on_one, on_places, on_variables

#: Stress and energy at rest below this share of the stiffness are round-off.
NOTHING = 1e-10
#: The pore is closed in directions in which it conducts less than this share of the largest conductivity.
CLOSED = 1e-6
#: ∂L/∂y of the six components of L, (6, 3, 3).
STRETCHES = np.array(
    [[[(r, c) in {(i, j), (j, i)} for c in range(3)] for r in range(3)] for i, j in PLACES], float
)
#: Shapes of the numbers of an undeformed cell without parameters, by their names in :class:`RestValues`.
NUMBERS: dict[str, tuple[int, ...]] = {
    "value": (),
    "porosity": (),
    "gradient": (7,),
    "matrix": (7, 7),
    "mean_value": (9,),
    "mean": (9, 7),
}
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
        W₀, g and A: the drained stiffness, minus Biot's coupling, minus the inverse of the Biot modulus.
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

    def potential_gradient(self, y: Array) -> Array:
        """Return ∂W₂/∂y (7, n) at y (7, n)."""
        if self.matrix.shape[2] == 1:
            found: Array = self.matrix[:, :, 0] @ y
            found += self.gradient
            return found
        gradient = self.gradient.copy()
        for (a, b), entry in self.linear.items():
            gradient[a] += entry * y[b]
        return gradient

    def potential_hessian(self, n: int) -> Array:
        """Return ∂²W₂/∂y² (7, 7, n), of which most entries are zero."""
        if self.matrix.shape[2] == 1:
            return np.repeat(self.matrix, n, axis=2)
        hessian = np.zeros((VARIABLES, VARIABLES, n))
        for place, entry in self.linear.items():
            hessian[place] = entry
        return hessian

    def mean_part(self, y: Array) -> Array:
        """Return the linear limit of Rᵀ⟨∇u¹⟩_s (9, n) at y (7, n)."""
        if self.mean.shape[2] == 1:
            found: Array = self.mean[:, :, 0] @ y
            found += self.mean_value
            return found
        found = np.zeros((9, y.shape[1])) + self.mean_value
        for (o, a), slope in self.mean_linear.items():
            found[o] += slope * y[a]
        return found


def _places(matrices: Array) -> Places:
    return {(int(i), int(j)): matrices[i, j] for i, j in np.argwhere(matrices.any(axis=2))}


class Rest(ABC):
    """Undeformed cells: one without parameters, or all members of a family.

    Attributes
    ----------
    symmetry
        Point group that all of them have exactly.
    basis : (3, r)
        B, orthonormal directions in which the pores conduct; r = 0 where no conductivity is known.
    parameters
        Kinds and coordinates of θ; None for a cell without parameters.
    """

    symmetry: PointGroup
    basis: Array
    parameters: ParameterMap | None

    @property
    def learned(self) -> int:
        """Number l of the parameters that are learned, which is that of the coordinates θ̂."""
        return 0 if self.parameters is None else len(self.parameters.learned)

    @abstractmethod
    def together(self, theta: Array | None, *, slopes: bool = False) -> RestValues:
        """Return the undeformed cells at θ (n, m), None without parameters; of one point where all are the same."""

    def scaling(self, theta: Array | None) -> Scaling:
        """Return the factors of the parameters that are not learned at θ (n, m)."""
        if self.parameters is None:
            return Scaling.one()
        assert theta is not None
        return Scaling.from_parameters(self.parameters, theta)


@dataclass(frozen=True, eq=False)
class SingleRest(Rest):
    """Undeformed cell without parameters; where it has no potential, only its conductivity counts.

    Attributes
    ----------
    values
        Its values, at one point.
    """

    values: RestValues
    symmetry: PointGroup
    basis: Array
    parameters: None = None

    def together(self, theta: Array | None = None, *, slopes: bool = False) -> RestValues:
        """Return the values of the cell."""
        return self.values

    def potential(self, y: Array) -> tuple[Array, Array]:
        """Return W₂ (n,) and ∂W₂/∂y (7, n)."""
        at = self.values
        gradient = at.matrix[:, :, 0] @ y
        value = (y * gradient).sum(axis=0) / 2 + at.gradient[6] * y[6]
        if at.value[0] or at.gradient[:6].any():
            value += at.value[0] + at.gradient[:6, 0] @ y[:6]
        return value, gradient + at.gradient

    @classmethod
    def from_response(cls, reference: CellResponse, symmetry: PointGroup) -> SingleRest:
        """Return the expansion from the response of the undeformed cell (one row) with its tangent.

        The error of a free mesh breaks the cell's symmetry and is averaged out.

        Raises
        ------
        DataError
            A derivative is missing.
        """
        t = reference.tangent
        if (
            t is None
            or reference.fluid_volume is None
            or t.stress_grad_u is None
            or t.stress_p is None
            or t.fluid_volume_p is None
            or t.mean_grad_grad_u is None
            or t.mean_grad_p is None
        ):
            raise DataError(
                "a potential needs stress, fluid volume and all derivatives of the undeformed cell; "
                "solve it with tangent=True"
            )
        A = np.zeros((7, 7))
        m = np.zeros((9, 7))
        for a, (i, j) in enumerate(PLACES):
            column = _symmetric(t.stress_grad_u[0], i, j)
            for b, (k, l) in enumerate(PLACES):
                A[b, a] = column[k, l] if k == l else column[k, l] + column[l, k]
            A[6, a] = A[a, 6] = t.stress_p[0, i, j] if i == j else t.stress_p[0, i, j] + t.stress_p[0, j, i]
            m[:, a] = _symmetric(t.mean_grad_grad_u[0], i, j).ravel()
        A[6, 6] = -t.fluid_volume_p[0]
        m[:, 6] = t.mean_grad_p[0].ravel()
        y, places, one = on_variables(symmetry), on_places(symmetry), on_one(symmetry)
        value, P, held = _held(reference, float(np.abs(A).max()))
        # F = I + L + L²/2 + …, so that a stress at rest works on second order of L.
        curved = np.einsum("ij,aik,bkj->ab", P, STRETCHES, STRETCHES)
        A[:6, :6] += (curved + curved.T) / 2
        T = np.append(np.einsum("ij,aij->a", P, STRETCHES), 0.0)
        porosity, gradient = float(reference.fluid_volume[0]), np.zeros(VARIABLES)
        gradient[:6], gradient[6] = y.mean(one, T[:, None])[:6, 0], -porosity
        return cls.from_numbers(
            symmetry,
            *_conducting(reference, symmetry),
            value=np.array(value),
            porosity=np.array(porosity),
            gradient=gradient,
            matrix=y.mean(y, (A + A.T) / 2),
            mean_value=places.mean(one, held.reshape(9, 1))[:, 0],
            mean=places.mean(y, m),
        )

    @classmethod
    def of_conductivity(cls, reference: CellResponse, symmetry: PointGroup) -> SingleRest:
        """Return the cell with its conductivity alone."""
        return cls.from_numbers(symmetry, *_conducting(reference, symmetry))

    @classmethod
    def from_numbers(
        cls, symmetry: PointGroup, basis: Array, log_conductivity: Array, **numbers: Array
    ) -> SingleRest:
        """Return the cell from what :class:`RestValues` holds at one point (:data:`NUMBERS`); zeros where not given."""
        found = {
            name: np.asarray(numbers.get(name, np.zeros(shape)), float)[..., None]
            for name, shape in NUMBERS.items()
        }
        values = RestValues(
            x=np.zeros((0, 1)),
            scale=np.ones(1),
            log_conductivity=log_conductivity[None],
            slopes=None,
            **found,
        )
        return cls(values, symmetry, basis)


def _conducting(reference: CellResponse, symmetry: PointGroup) -> tuple[Array, Array]:
    """Return B (3, r) and ln(Bᵀ K B) (r, r) of the undeformed cell; r = 0 where no conductivity is known."""
    if reference.conductivity is None or not np.isfinite(reference.conductivity).all():
        return np.zeros((3, 0)), np.zeros((0, 0))
    # The error of a free mesh breaks the symmetry of the cell at rest.
    mean = on_places(symmetry).mean(on_one(symmetry), reference.conductivity[0].reshape(9, 1)).reshape(3, 3)
    basis = conducting_basis(mean)
    if not basis.shape[1]:
        return basis, np.zeros((0, 0))
    log = logarithm(basis.T @ mean @ basis)
    return basis, (log + log.T) / 2


def conducting_basis(K: Array) -> Array:
    """Return orthonormal directions (3, r) in which K (3, 3) conducts; the identity for all three."""
    values, vectors = np.linalg.eigh((K + K.T) / 2)
    kept = values > CLOSED * max(float(values.max()), 0.0)
    basis: Array = np.eye(3) if kept.all() else vectors[:, kept]
    return basis


def _held(reference: CellResponse, stiffness: float) -> tuple[float, Array, Array]:
    """Return W₀, P (3, 3) and <∇u¹>_s (3, 3) of a cell at rest; exact zeros where they are but round-off."""
    P = np.zeros((3, 3)) if reference.stress is None else reference.stress[0]
    W = 0.0 if reference.potential is None else float(reference.potential[0])
    held = np.abs(P).max() > NOTHING * stiffness or abs(W) > NOTHING * stiffness
    return (W, P, reference.mean_grad[0]) if held else (0.0, np.zeros((3, 3)), np.zeros((3, 3)))


def _symmetric(tensor: Array, i: int, j: int) -> Array:
    """Return ∂(3, 3)/∂ one component of a symmetric argument."""
    column: Array = tensor[:, :, i, j] if i == j else tensor[:, :, i, j] + tensor[:, :, j, i]
    return column
