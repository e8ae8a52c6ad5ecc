"""Interface of a discrete solid: energy, residual, tangent, sensitivities; integrals over its domain.

The energies of solid and contact do not change under rotations, so this holds for each solid, whatever its fibres.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Generic, Self

import numpy as np
from scipy import sparse
from typing_extensions import TypeVar

from porocore.cell.contact.pairs import ContactPairs
from porocore.cell.contact.wall_contact import ContactModel, ContactState
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import determinants, shape_functions, tetrahedron_rule
from porocore.cell.symmetry import exchanged_axes
from porocore.states import Array, Status


@dataclass(frozen=True, eq=False)
class DomainIntegrals:
    """Integrals over the domain without contact, and extrema over its quadrature points."""

    grad: Array  #: (3, 3)  ∫ ∇u¹ dV
    stress: Array  #: (3, 3)  ∫ (P + p cof F) dV
    volume: float  #: ∫ J dV
    energy: float  #: ∫ Ψ dV
    largest_grad: Array  #: (3, 3)  of |∂u¹_i/∂Y_j|
    largest_energy: float  #: of Ψ


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Sensitivities of the equilibrium to k of the ten loads θ = (H_11, H_12, …, H_33, p).

    Attributes
    ----------
    displacement : (k, nodes, 3)
        u_θ at the nodes of the mesh; NaN where the linear solver did not reach its tolerance.
    grad : (k, 3, 3)
        ∫ ∇u_θ dV.
    second : (k, k)
        ∂²Π/∂θ∂θ' at equilibrium: Π_θθ' + R_θᵀ u_θ' with R = ∂Π/∂u. Contact contributes to the second term only.
    negative : int
        Number of negative eigenvalues of the tangent as far as the way here told; 1 for one or more by a solver without
        pivots, -1 where it did not tell.
    """

    displacement: Array
    grad: Array
    second: Array
    negative: int = -1


def second_derivatives(columns: Sequence[int], stresses: Array) -> Array:
    """Return ∂²Π/∂θ∂θ' at fixed u¹, (k, k), from the slopes (k, 9) of ∫ (P + p cof F) dV; Π is linear in p."""
    found = np.hstack([stresses, np.zeros((len(stresses), 1))])[:, list(columns)]
    by_pressure = np.array(columns) == 9
    found[:, by_pressure] = found[by_pressure].T
    return found


#: Degree of the rule; it integrates the square of a quadratic shape function on a straight tetrahedron.
DEGREE = 4


@lru_cache(maxsize=8)
def lumped_mass(mesh: CellMesh) -> Array:
    """Return the share of each node in the undeformed volume, (nodes,), all positive.

    The diagonal of each element's consistent mass matrix, scaled to the element's volume [Hinton, Rock & Zienkiewicz,
    Earthquake Eng. Struct. Dyn. 4 (1976) 245–249]; row sums would be negative at the corners of quadratic elements.
    """
    points, weights = tetrahedron_rule(DEGREE)
    N, _ = shape_functions(points, mesh.cells.shape[1])
    volume = determinants(mesh.points, mesh.cells, points) * weights
    diagonal = volume @ N**2
    share = diagonal * (volume.sum(axis=1) / diagonal.sum(axis=1))[:, None]
    nodal = np.bincount(mesh.cells.ravel(), share.ravel(), len(mesh.points))
    return nodal.astype(np.float64)


class FactorError(Exception):
    """The linear solver broke down; the load path shortens its step."""


class LoadStepFailed(Exception):
    """Newton's iteration did not reach the load; ``status`` is the reason."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


class Iterate(ABC):
    """A displacement u¹ under (H, p), in equilibrium or not; each quantity is computed once, when it is first used.

    Attributes
    ----------
    H : (3, 3)
        Macroscopic displacement gradient.
    p : float
        Pore pressure.
    """

    H: Array
    p: float

    #: Contact of the pore wall; None where there is none.
    contact: ContactModel | None = None
    #: Contact pairs of another iterate that this one reuses; None: they are searched at this iterate.
    pairs: ContactPairs | None = None

    @cached_property
    def _contact_state(self) -> ContactState | None:
        return None if self.contact is None else self.contact.at(self.H, self.displacement, self.pairs)

    @property
    def touching(self) -> ContactState | None:
        """Contact state of this iterate; None where nothing touches."""
        return self._contact_state if self._contact_state is not None and self._contact_state.active else None

    @property
    def contact_pairs(self) -> ContactPairs | None:
        """Contact pairs of this iterate, reused or found; None where they do not depend on the iterate."""
        return None if self._contact_state is None else self._contact_state.pairs

    def with_pairs(self, pairs: ContactPairs | None) -> Self:
        """Return this iterate with other contact pairs; with None, they are searched anew."""
        if pairs is self.pairs:
            return self
        other = copy(self)
        other.pairs = pairs
        for name in ("_contact_state", "energy", "residual"):
            other.__dict__.pop(name, None)
        return other

    @property
    @abstractmethod
    def energy(self) -> float:
        """Π = ∫ (Ψ(F) + pJ) dV over the domain and the energy of contact.

        It is defined where :attr:`min_jacobian` is positive.
        """

    @property
    @abstractmethod
    def residual(self) -> Array:
        """∂Π/∂u for the free unknowns, (n,)."""

    @property
    @abstractmethod
    def min_jacobian(self) -> float:
        """Smallest J at the quadrature points."""

    @property
    @abstractmethod
    def displacement(self) -> Array:
        """u¹ at the nodes of the mesh, (nodes, 3)."""


class FactorisedTangent(ABC):
    """Factorised tangent K − shift·M of one parity class at one iterate, a value that no later call changes.

    A solid may store fewer factors than there are values; a displaced one is computed again when it is applied.

    Attributes
    ----------
    iterate
        Iterate of the tangent.
    parity
        Parity class.
    shift
        Shift of the eigenvalues.
    negative
        Number of negative pivots, equal to that of the eigenvalues below the shift; -1 where the solver cannot tell.
    """

    iterate: Iterate
    parity: str
    shift: float
    negative: int

    @abstractmethod
    def solve(self, rhs: Array) -> Array:
        """Return x (n,) or (n, k) with (K − shift·M) x = rhs, to the precision of the factor.

        Raises
        ------
        FactorError
            The factor cannot be applied.
        """


#: Types of the iterates and of the factorised tangents of a solid, which takes its own ones only.
OwnIterate = TypeVar("OwnIterate", bound=Iterate, contravariant=True, default=Any)
OwnFactor = TypeVar("OwnFactor", bound=FactorisedTangent, contravariant=True, default=Any)


class DiscreteSolid(ABC, Generic[OwnIterate, OwnFactor]):
    """The discrete energy Π(u¹; H, p) on one mesh, with its first and second derivatives and linear solves.

    On the eighth u¹·n = 0 on the six planes, which admits diagonal H and any p; a perturbation by H_12 or H_21 is odd
    under the mirrors of x and y, ``parity="xy"``, and so on. On the whole cell u¹ is periodic and one node is held.

    Attributes
    ----------
    mesh
        Mesh of the solid.
    material
        Its strain energy, at F of shape (elements, points, 3, 3).
    degree
        Degree of its quadrature rule.
    contact
        Contact of the pore wall; None where walls may pass through each other.
    """

    mesh: CellMesh
    material: StrainEnergy
    degree: int
    contact: ContactModel | None = None

    @property
    def choice(self) -> str:
        """Unknowns and linear solver, in words; empty where the backend does not tell."""
        return ""

    @property
    def copies(self) -> float:
        """Number of images of the domain that fill one cell, of volume 1; 1/n for a block of n cells."""
        return 8.0 if self.mesh.domain == "eighth" else 1.0 / math.prod(self.mesh.periods)

    @property
    def unstressed(self) -> Array:
        """H (3, 3) at which the cell with u¹ = 0 has no stress, where load paths begin: 0, or (λ − 1) I if it swells.

        Where the swelling λ differs between regions it is the mean, and the first step reaches an equilibrium.
        """
        return np.asarray((self.material.mean_stretch - 1.0) * np.eye(3))

    def exchanged_axes(self, iterate: OwnIterate) -> tuple[str, ...]:
        """Return the pairs of axes, "xz", whose exchange changes neither the solid nor u¹; none on the whole cell.

        Fibres may distinguish the axes; with them no pair is returned.
        """
        if self.mesh.domain == "whole" or not self.material.isotropic:
            return ()
        return exchanged_axes(self.mesh, iterate.H, iterate.displacement)

    def reset(self) -> None:
        """Release what would make a load path depend on the one before it; every path begins with this."""

    @abstractmethod
    def iterate_at(self, H: Array, p: float, displacement: Array | None = None) -> Iterate:
        """Return the iterate of u¹ (nodes, 3) or of u¹ = 0 under (H, p)."""

    @abstractmethod
    def moved(self, iterate: OwnIterate, change: Array, H: Array, p: float) -> Iterate:
        """Return an iterate under another load, with ``change`` (n,) added to the free unknowns."""

    @abstractmethod
    def force_scale(self, iterate: OwnIterate) -> float:
        """Return the norm of the nodal forces without cancellation, at least that of a strain of 1e-3."""

    @abstractmethod
    def load_change(self, iterate: OwnIterate, dH: Array, dp: float) -> Array:
        """Return the change of the residual, (n,), by the load alone."""

    @abstractmethod
    def solve(self, iterate: OwnIterate, rhs: Array, accuracy: float) -> Array:
        """Return x (n,) with K x = rhs to a relative accuracy; an indefinite K is shifted until it is definite.

        Raises
        ------
        LoadStepFailed
            No shift makes K definite, or the linear solver broke down.
        """

    @abstractmethod
    def factor(self, iterate: OwnIterate, parity: str, shift: float = 0.0) -> FactorisedTangent:
        """Return the factorised tangent K − shift·M of one parity class, with the :meth:`masses` M.

        Raises
        ------
        FactorError
            The tangent cannot be factorised.
        """

    def negative_pivots(self, iterate: OwnIterate, parity: str, shift: float = 0.0) -> int:
        """Return the number of eigenvalues below ``shift``, by :meth:`factor` and :meth:`negative_eigenvalues`.

        Raises
        ------
        FactorError
            The tangent cannot be factorised.
        """
        factor: Any = self.factor(iterate, parity, shift)
        return self.negative_eigenvalues(factor)

    def negative_eigenvalues(self, factor: OwnFactor) -> int:
        """Return the number of eigenvalues below the shift of ``factor``; -1 where unknown.

        A solver without pivots that finds out whether there are any overrides this; it returns 1 for one or more.

        Raises
        ------
        FactorError
            The factor cannot be applied.
        """
        return factor.negative

    @abstractmethod
    def release(self, parity: str) -> None:
        """Release the memory of one class other than ""; what is needed later is computed again."""

    @abstractmethod
    def tangent(self, iterate: OwnIterate, parity: str) -> sparse.csr_matrix:
        """Return K of a class, a symmetric sparse matrix (n, n)."""

    @abstractmethod
    def reduced(self, values: Array, parity: str) -> Array:
        """Return the sums (n,) of (nodes, 3) over the images of each free unknown of a class."""

    @abstractmethod
    def expanded(self, x: Array, parity: str) -> Array:
        """Return the field (nodes, 3) of the free unknowns (n,) of a class."""

    def masses(self, parity: str) -> Array:
        """Return the lumped mass (n,) of each free unknown of a class, at density 1 of the undeformed solid."""
        return self.reduced(np.repeat(lumped_mass(self.mesh)[:, None], 3, axis=1), parity)

    @abstractmethod
    def integrals(self, iterate: OwnIterate) -> DomainIntegrals:
        """Return the integrals over the domain that the averages of the cell are made of."""

    @abstractmethod
    def sensitivities(self, factor: OwnFactor, columns: Sequence[int]) -> Sensitivities:
        """Return the sensitivities to the loads in ``columns``, all of the class of the unshifted ``factor``.

        Raises
        ------
        FactorError
            The factor cannot be applied.
        """

    def solve_forces(self, factor: OwnFactor, forces: Array) -> Array:
        """Return K⁻¹ f (k, nodes, 3) for k ≥ 1 forces f on the nodes, as accurate as the sensitivities.

        Raises
        ------
        FactorError
            The unshifted ``factor`` cannot be applied.
        """
        rhs = np.stack([self.reduced(force, factor.parity) for force in forces], axis=1)
        return np.stack([self.expanded(x, factor.parity) for x in factor.solve(rhs).T])


#: Meshes whose gradients are kept: the eighth and the whole of one member.
KEPT = 2


class ElementGradients:
    """Isoparametric gradients at the q quadrature points of each of M elements, those of every backend.

    Parameters
    ----------
    mesh
        Linear or quadratic tetrahedra with a nodes each.
    degree
        Degree of the quadrature rule.
    points : (nodes, 3)
        Positions of the nodes; those of the mesh by default.

    Attributes
    ----------
    grad_N : (M, q, a, 3)
        ∇N of each shape function.
    weights : (M, q)
        Volume of each point.
    """

    def __init__(self, mesh: CellMesh, degree: int, points: Array | None = None) -> None:
        self.cells, self.count = mesh.cells, len(mesh.points)
        at, weights = tetrahedron_rule(degree)
        dN = shape_functions(at, mesh.cells.shape[1])[1]
        nodes = (mesh.points if points is None else points)[mesh.cells]
        jacobian = np.einsum("eai,qaj->eqij", nodes, dN, optimize=True)
        self.grad_N = np.einsum("qaj,eqji->eqai", dN, np.linalg.inv(jacobian), optimize=True)
        self.weights = np.linalg.det(jacobian) * weights

    def gradient(self, u: Array) -> Array:
        """Return ∂u_i/∂Y_j (M, q, 3, 3) of u (nodes, 3)."""
        return np.asarray(u[self.cells].swapaxes(1, 2)[:, None] @ self.grad_N)

    def integral(self, values: Array) -> Array:
        """Return the integral (...) of values (M, q, ...)."""
        return np.tensordot(self.weights, values, axes=2)

    def forces(self, stress: Array) -> Array:
        """Return ∫ S:∇v for all nodal v, (nodes, 3), of S (M, q, 3, 3)."""
        weighted = self.weights[:, :, None, None] * stress
        blocks = (self.grad_N @ weighted.swapaxes(2, 3)).sum(axis=1)
        flat = self.cells.ravel()
        return np.stack(
            [np.bincount(flat, blocks[:, :, i].ravel(), self.count) for i in range(3)], axis=1
        ).astype(float)


@lru_cache(maxsize=KEPT)
def element_gradients(mesh: CellMesh, degree: int) -> ElementGradients:
    """Return the gradients on an undeformed mesh, which all states of a cell share."""
    return ElementGradients(mesh, degree)


@dataclass(frozen=True, eq=False)
class LoadBasis:
    """Loads of a parity class in which as many as possible are rotations.

    Attributes
    ----------
    loads : (k, k)
        The new loads in columns, by the loads of the class; rotations are the last ones.
    spins : (r, 3, 3)
        W of the rotations.
    """

    loads: Array
    spins: Array


def load_basis(H: Array, columns: Sequence[int]) -> LoadBasis:
    """Return the basis of loads ``columns`` of the ten θ = (H_11, …, H_33, p) at H."""
    F0, found = np.eye(3) + H, dict[str, list[Array]]()
    others = np.setdiff1d(np.arange(9), columns)
    for name, sign in (("stretches", 1.0), ("spins", -1.0)):
        motions = [
            _unit(i, j) + sign * _unit(j, i) for i in range(3) for j in range(i if sign > 0 else i + 1, 3)
        ]
        found[name] = [motion for motion in motions if not (motion @ F0).ravel()[others].any()]
    loads = np.zeros((10, sum(map(len, found.values())) + (9 in columns)))
    for place, motion in enumerate(found["stretches"]):
        loads[:9, place] = (motion @ F0).ravel()
    if 9 in columns:
        loads[9, len(found["stretches"])] = 1.0
    for place, motion in enumerate(found["spins"], start=-len(found["spins"])):
        loads[:9, place] = (motion @ F0).ravel()
    if loads.shape[1] < len(columns):
        return LoadBasis(np.eye(len(columns)), np.zeros((0, 3, 3)))
    return LoadBasis(loads[list(columns)], np.reshape(found["spins"], (-1, 3, 3)))


def _unit(i: int, j: int) -> Array:
    unit = np.zeros((3, 3))
    unit[i, j] = 1.0
    return unit
