"""What a finite element library contributes to the solid cell problem: one discrete energy and its derivatives."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic

import numpy as np
from scipy import sparse
from typing_extensions import TypeVar

from porocore.cell.contact.contact_state import ContactState
from porocore.cell.contact.model import ContactModel
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mass import lumped_mass
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry.exchange import exchanged_axes
from porocore.states import Array, Status


class FactorError(Exception):
    """The linear solver broke down; the load path shortens its step."""


class LoadStepFailed(Exception):
    """Newton's iteration did not reach the load; ``status`` says what stood in the way."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


class Iterate(ABC):
    """u¹ under (H, p), in equilibrium or not. What is asked for is computed once.

    Attributes
    ----------
    H : (3, 3)
        Macroscopic displacement gradient.
    p : float
        Pore pressure.
    """

    H: Array
    p: float

    #: What the solid touches; None where there is no contact.
    contact: ContactModel | None = None

    _like: ContactState | None = None

    @cached_property
    def _contact(self) -> ContactState | None:
        if self.contact is None:
            return None
        return self.contact.at(self.H, self.displacement, self._like)

    @property
    def touching(self) -> ContactState | None:
        """Contact at this iterate, None where nothing touches."""
        return self._contact if self._contact is not None and self._contact.active else None

    def pair_like(self, other: Iterate) -> None:
        """Let touch what touches at the other iterate; before anything else is asked for."""
        if self.contact is not None and self.contact.pairs_move:
            self._like = other._contact

    def pair_again(self) -> None:
        """Look again what touches what."""
        if self._like is None:
            return
        self._like = None
        for name in ("_contact", "energy", "residual"):
            self.__dict__.pop(name, None)

    @property
    @abstractmethod
    def energy(self) -> float:
        """Π = ∫ (Ψ(F) + pJ) dV over the domain and the energy of contact.

        Only asked for where :attr:`min_jacobian` is positive.
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


@dataclass(frozen=True, eq=False)
class DomainIntegrals:
    """Integrals over the domain without what contact adds, and extremes over its quadrature points."""

    grad: Array  #: (3, 3)  ∫ ∇u¹ dV
    stress: Array  #: (3, 3)  ∫ (P + p cof F) dV
    volume: float  #: ∫ J dV
    energy: float  #: ∫ Ψ dV
    largest_grad: Array  #: (3, 3)  of |∂u¹_i/∂Y_j|
    largest_energy: float  #: of Ψ


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """How the equilibrium answers to k of the ten loads θ = (H_11, H_12, …, H_33, p).

    Attributes
    ----------
    grad : (k, 3, 3)
        ∫ ∇u_θ dV; NaN where the linear solver did not reach its tolerance.
    second : (k, k)
        ∂²Π/∂θ∂θ' at equilibrium: Π_θθ' + R_θᵀ u_θ' with R = ∂Π/∂u; of contact the share with u_θ only.
    indefinite : bool
        A direction of negative curvature was met on the way.
    """

    grad: Array
    second: Array
    indefinite: bool = False


def second_derivatives(columns: Sequence[int], stresses: Array) -> Array:
    """Return ∂²Π/∂θ∂θ' at fixed u¹, (k, k), from the slopes (k, 9) of ∫ (P + p cof F) dV; Π is linear in p."""
    found = np.hstack([stresses, np.zeros((len(stresses), 1))])[:, list(columns)]
    by_pressure = np.array(columns) == 9
    found[:, by_pressure] = found[by_pressure].T
    return found


class FactorisedTangent(ABC):
    """The inverse of K − shift·M of one class at one iterate, a value: it stays what it is, whatever comes after.

    A solid may keep fewer factors than there are values; one that has been displaced is made anew when it is applied.

    Attributes
    ----------
    iterate
        The iterate.
    parity
        The class.
    shift
        Of the eigenvalues.
    negative
        Number of negative pivots, which is that of the eigenvalues below the shift; -1 where the solver cannot tell.
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


#: Types of the iterates and of the factorised tangents of a solid; it is given its own only.
OwnIterate = TypeVar("OwnIterate", bound=Iterate, contravariant=True, default=Any)
OwnFactor = TypeVar("OwnFactor", bound=FactorisedTangent, contravariant=True, default=Any)


class DiscreteSolid(ABC, Generic[OwnIterate, OwnFactor]):
    """The discrete energy Π(u¹; H, p) on one mesh, with its first and second derivatives and linear solves.

    On the eighth u¹·n = 0 on its six planes, which serves diagonal H and any p; a perturbation by H_12 or
    H_21 is odd under the mirrors of x and y, ``parity="xy"``, and so on. On the whole cell u¹ is periodic and
    one node is held.

    Attributes
    ----------
    mesh
        Of the solid.
    material
        Its strain energy, at F of shape (elements, points, 3, 3).
    contact
        Of its wall; None where walls pass through each other.
    """

    mesh: CellMesh
    material: StrainEnergy
    contact: ContactModel | None = None

    @property
    def copies(self) -> float:
        """How many images of the domain fill one cell; a block of n cells is averaged over."""
        return 8.0 if self.mesh.domain == "eighth" else 1.0 / math.prod(self.mesh.periods)

    def exchanged_axes(self, iterate: OwnIterate) -> tuple[str, ...]:
        """Pairs of axes, "xz", whose exchange changes neither the solid nor u¹; none on the whole cell.

        Fibres may tell the axes apart, so with them no pair is looked for.
        """
        if self.mesh.domain == "whole" or not self.material.isotropic:
            return ()
        return exchanged_axes(self.mesh, iterate.H, iterate.displacement)

    def reset(self) -> None:
        """A new path starts: forget what would make a solve depend on the one before it."""

    @abstractmethod
    def iterate_at(self, H: Array, p: float, displacement: Array | None = None) -> Iterate:
        """Of u¹ (nodes, 3), or of u¹ = 0."""

    @abstractmethod
    def moved(self, iterate: OwnIterate, change: Array, H: Array, p: float) -> Iterate:
        """``iterate`` with ``change`` (n,) added to the free unknowns, under another load."""

    @abstractmethod
    def force_scale(self, iterate: OwnIterate) -> float:
        """Norm of the nodal forces if nothing cancelled in them, with a floor of those of a strain of 1e-3."""

    @abstractmethod
    def load_change(self, iterate: OwnIterate, dH: Array, dp: float) -> Array:
        """Change of the residual, (n,), by the load alone."""

    @abstractmethod
    def solve(self, iterate: OwnIterate, rhs: Array, accuracy: float) -> Array:
        """x (n,) with K x = rhs to a relative accuracy; with an indefinite K, of the least shifted K that is definite.

        Raises
        ------
        LoadStepFailed
            No shift makes K definite, or the linear solver broke down.
        """

    @abstractmethod
    def factor(self, iterate: OwnIterate, parity: str, shift: float = 0.0) -> FactorisedTangent:
        """Return the factor of K − shift·M of one class of perturbations, with the :meth:`masses` M.

        Raises
        ------
        FactorError
            The tangent cannot be factorised.
        """

    def negative_pivots(self, iterate: OwnIterate, parity: str, shift: float = 0.0) -> int:
        """Return the number of eigenvalues below ``shift``, the negative pivots of :meth:`factor`; -1 where unknown.

        Raises
        ------
        FactorError
            The tangent cannot be factorised.
        """
        return self.factor(iterate, parity, shift).negative

    @abstractmethod
    def release(self, parity: str) -> None:
        """Free the memory of what serves one class, not "" alone; it is made anew when it is needed."""

    @abstractmethod
    def tangent(self, iterate: OwnIterate, parity: str) -> sparse.csr_matrix:
        """K of a class, a symmetric sparse matrix (n, n) of scipy's."""

    @abstractmethod
    def reduced(self, values: Array, parity: str) -> Array:
        """Return the sums (n,) of (nodes, 3) over the images of each free unknown of a class."""

    @abstractmethod
    def expanded(self, x: Array, parity: str) -> Array:
        """The field (nodes, 3) of the free unknowns (n,) of a class."""

    def masses(self, parity: str) -> Array:
        """Lumped mass (n,) of each free unknown of a class, at density 1 of the undeformed solid."""
        return self.reduced(np.repeat(lumped_mass(self.mesh)[:, None], 3, axis=1), parity)

    @abstractmethod
    def sums(self, iterate: OwnIterate) -> DomainIntegrals:
        """Over the domain."""

    @abstractmethod
    def sensitivities(self, factor: OwnFactor, columns: Sequence[int]) -> Sensitivities:
        """Return those to the loads in ``columns``, which all belong to the class of the unshifted ``factor``.

        Raises
        ------
        FactorError
            The factor cannot be applied.
        """
