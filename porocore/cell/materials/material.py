"""Base of a configured material (Material): energy, swelling, moduli, slopes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from porocore.cell.materials.prony import RELAXATION, Relaxation
from porocore.core.files.yaml_document import Location
from porocore.core.models.strict import StrictModel, with_number
from porocore.core.tensors import MIRRORS
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh


#: Key of λ below a material.
SWELLING = "swelling"


class StrainEnergy(ABC):
    """Strain energy Ψ(F) of a hyperelastic solid at many points.

    F_ij = ∂x_i/∂X_j has the shape (..., 3, 3), and (elements, points, 3, 3) where materials differ between elements.
    All stresses and moduli are in units of E, the reference modulus of the study.
    """

    @property
    @abstractmethod
    def isotropic(self) -> bool:
        """True where the response is the same in all directions of the reference configuration."""

    @abstractmethod
    def energy_density(self, F: Array) -> Array:
        """Return Ψ (...) per undeformed volume [E]; 0 at F = I."""

    @abstractmethod
    def stress(self, F: Array) -> Array:
        """Return P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""

    @abstractmethod
    def tangent(self, F: Array) -> Array:
        """Return A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""

    @abstractmethod
    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return Young's and shear modulus of small strains [E], averaged over directions and elements (all)."""

    @property
    def mean_stretch(self) -> float:
        """Stretch λ at which the solid, free, has no stress, averaged over elements; 1 unless it is swollen."""
        return 1.0

    @abstractmethod
    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return the slopes of energy and stress by one number of the solid.

        Parameters
        ----------
        key
            Keys that lead to the number, below ``cell.material``, such as ``("poisson_ratio",)``, or below
            ``cell.materials``, such as ``("core", "poisson_ratio")``.
        F : (..., 3, 3)
            Deformation gradient, which is kept.

        Returns
        -------
        by_energy, by_stress
            ∂Ψ/∂θ (...) and ∂P/∂θ (..., 3, 3), exact to round-off.
        """


@dataclass(frozen=True, eq=False)
class Swollen(StrainEnergy):
    """Solid that has no stress where it is stretched by λ in all directions.

    With F = F_e F_g and F_g = λ I only F_e stores energy. Per volume of the solid before it swells

        Ψ_ref(F) = λ³ Ψ(F/λ),  P = λ² P_e(F/λ),  A = λ A_e(F/λ),

    where Ψ, P_e and A_e are those of the ``elastic`` solid (Rodriguez, Hoger & McCulloch 1994, J. Biomech. 27). It
    stands for osmotic swelling, growth, shrinkage and thermal expansion alike.
    """

    elastic: StrainEnergy
    stretch: float

    @property
    def isotropic(self) -> bool:
        """True where the elastic solid is isotropic."""
        return self.elastic.isotropic

    @property
    def mean_stretch(self) -> float:
        """Swelling stretch λ."""
        return self.stretch

    def energy_density(self, F: Array) -> Array:
        """Return Ψ_ref (...) per volume before swelling [E]; 0 at F = λ I."""
        return np.asarray(self.stretch**3 * self.elastic.energy_density(F / self.stretch))

    def stress(self, F: Array) -> Array:
        return np.asarray(self.stretch**2 * self.elastic.stress(F / self.stretch))

    def tangent(self, F: Array) -> Array:
        return np.asarray(self.stretch * self.elastic.tangent(F / self.stretch))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return the moduli of the elastic solid; see :class:`StrainEnergy`."""
        return self.elastic.mean_moduli(elements)

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return ∂Ψ_ref/∂θ and ∂P/∂θ; by λ itself 3λ² Ψ − λ P_e:F and 2λ P_e − A_e:F, all at F/λ."""
        stretch, inner = self.stretch, F / self.stretch
        if key != (SWELLING,):
            by_energy, by_stress = self.elastic.parameter_slopes(key, inner)
            return stretch**3 * by_energy, stretch**2 * by_stress
        P = self.elastic.stress(inner)
        work = (P * F).sum(axis=(-2, -1))
        stiffened = np.einsum("...ijkl,...kl->...ij", self.elastic.tangent(inner), F)
        energy = self.elastic.energy_density(inner)
        return 3 * stretch**2 * energy - stretch * work, 2 * stretch * P - stiffened


#: Tolerances of a residual stress and of the smallest eigenvalue of the elasticity, over the largest modulus.
STRESS_FREE, POSITIVE = 1e-10, 1e-8
#: Kelvin's notation: pairs of indices, and the factors that make the basis orthonormal.
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_FACTORS = np.array([1.0, 1.0, 1.0, np.sqrt(2), np.sqrt(2), np.sqrt(2)])


def bulk_and_shear(C: Array) -> tuple[float, float]:
    """Return bulk modulus and shear modulus [E] of C (3, 3, 3, 3) averaged over all directions; linear in C."""
    bulk = float(np.einsum("iijj->", C)) / 9
    return bulk, (3 * float(np.einsum("ijij->", C)) - 9 * bulk) / 30


def voigt_moduli(C: Array) -> tuple[float, float]:
    """Return Young's modulus and shear modulus [E] of C (3, 3, 3, 3) averaged over all directions (Voigt 1889)."""
    bulk, shear = bulk_and_shear(C)
    return 9 * bulk * shear / (3 * bulk + shear), shear


def kelvin(C: Array) -> Array:
    """Return the Kelvin matrix (6, 6) of C (3, 3, 3, 3), with the eigenvalues of C on symmetric strains (1856)."""
    rows = np.array([[C[i, j, k, l] for k, l in _PAIRS] for i, j in _PAIRS])
    return np.asarray(_FACTORS[:, None] * rows * _FACTORS)


def check_reference(energy: Array, P: Array, C: Array, hint: Callable[[], str]) -> None:
    """Refuse a solid with a residual stress or without stiffness in the undeformed state.

    Parameters
    ----------
    energy, P, C
        Ψ, stress (3, 3) and its derivative (3, 3, 3, 3) at F = I.
    hint
        Advice against a residual stress.

    Raises
    ------
    ValueError
        Ψ is not smooth at F = I, P is not zero, or an eigenvalue of C is not positive.
    """
    if not (np.isfinite(energy).all() and np.isfinite(P).all() and np.isfinite(C).all()):
        raise ValueError(
            "the energy, the stress or its derivative is not finite in the undeformed solid; expected an energy that "
            "is smooth at F = I, where J = 1 and I1 = I2 = 3"
        )
    scale = float(np.abs(C).max())
    residual = float(np.abs(P).max())
    if residual > STRESS_FREE * max(scale, 1e-300):
        i, j = np.unravel_index(int(np.abs(P).argmax()), (3, 3))
        advice = hint()
        raise ValueError(
            f"expected no stress in the undeformed solid, got P_{i + 1}{j + 1} = {P[i, j]:.6g} at F = I"
            + (f"; {advice}" if advice else "")
        )
    values, modes = np.linalg.eigh(kelvin(C))
    if values[0] <= POSITIVE * max(scale, 1e-300):
        share = float(modes[:3, 0].sum() ** 2) / 3
        mode = "a change of volume" if share > 0.5 else "a change of shape"
        raise ValueError(
            f"expected positive initial moduli, got {values[0]:.6g} for {mode} (smallest eigenvalue of the elasticity "
            f"tensor at F = I); raise the {'bulk' if share > 0.5 else 'shear'} stiffness"
        )


#: Imaginary step of a number; its square vanishes beside 1, whatever the number.
STEP = 1e-100


class Material(StrictModel, StrainEnergy):
    """Configuration of a homogeneous solid.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.materials.hyperelastic.AnyMaterial`. Its own methods are those of the elastic solid,
    without stress at F = I; :meth:`on` returns the swollen one. They are analytic in its numbers: with a complex
    number in the place of a real one they return complex results.
    """

    swelling: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    """Stretch λ by which the solid swells in all directions where nothing holds it: F = λ I has no stress; 1: none."""
    relaxation: Relaxation | None = None
    """Prony series by which the stress of the solid relaxes; cells are solved in equilibrium; null: none."""

    @model_serializer(mode="wrap")
    def _only_what_is_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        if self.swelling == 1:
            data.pop(SWELLING, None)
        if self.relaxation is None:
            data.pop(RELAXATION, None)
        return data

    @property
    @abstractmethod
    def description(self) -> str:
        """Short description, such as ``neo-hookean solid with Poisson's ratio 0.35``."""

    def turned(self, Q: IntArray) -> Material | None:
        """Return the solid after a signed permutation Q (3, 3) of the axes, Ψ'(F) = Ψ(QᵀFQ); None if unknown.

        An anisotropic kind turns its directions, so that its symmetry is used.
        """
        return self if self.isotropic else None

    def equals(self, other: Material) -> bool:
        """Return whether another solid has the same Ψ by its parameters."""
        return self == other

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether Q leaves the response unchanged; the images of the ``regions`` do not matter."""
        turned = self.turned(Q)
        return turned is not None and turned.equals(self)

    @property
    def mirrored(self) -> bool:
        """True where the response is invariant under the mirrors of the three axes, as on the eighth of a cell."""
        return all(self.allows(Q, None) for Q in MIRRORS.matrices)

    @property
    def swells(self) -> bool:
        """True where the solid is swollen, so that it has a stress at F = I."""
        return self.swelling != 1

    @property
    def in_equilibrium(self) -> Self:
        """The solid without its relaxation, which no cell problem depends on."""
        return self if self.relaxation is None else self.model_copy(update={RELAXATION: None})

    @property
    def identity(self) -> str:
        """Kind and parameters as text, without the relaxation."""
        return self.in_equilibrium.model_dump_json()

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Return the strain energy of every element of a mesh of the solid: itself, or the swollen solid."""
        return self if self.swelling == 1 else Swollen(self, self.swelling)

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return ∂Ψ/∂θ and ∂P/∂θ by a complex step on a copy, exact to round-off; by λ those at λ = 1.

        References
        ----------
        Squire & Trapp (1998), SIAM Review 40, 110–112.
        """
        if key == (SWELLING,):
            return Swollen(self, 1.0).parameter_slopes(key, F)
        stepped = with_number(self, key, lambda number: complex(number, STEP))
        return stepped.energy_density(F).imag / STEP, stepped.stress(F).imag / STEP

    @property
    def elasticity(self) -> Array:
        """Elasticity C (3, 3, 3, 3) of small strains, A at F = I [E]."""
        return self.tangent(np.eye(3))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; Voigt's average over directions, exact where the solid is isotropic."""
        return voigt_moduli(self.elasticity)

    def stress_hint(self) -> str:
        """Return advice for an undeformed solid with a residual stress."""
        return ""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        rest = np.eye(3)
        try:
            check_reference(self.energy_density(rest), self.stress(rest), self.elasticity, self.stress_hint)
        except OverflowError:
            raise ValueError(
                "the energy or a derivative of it is too large a number at F = I; give smaller powers"
            ) from None
        return self
