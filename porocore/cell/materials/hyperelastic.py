"""Hyperelastic materials in closed form, fibres, composites; the list of the materials by ``kind``."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, Tag, field_validator

from porocore.cell.materials.expression import (
    BASIC,
    VOLUMETRIC,
    Direction,
    ExpressionMaterial,
    InvariantMaterial,
    fibre_invariants,
    same_families,
    turned,
)
from porocore.cell.materials.invariants import Invariant, PowerSum
from porocore.cell.materials.material import Material, StrainEnergy
from porocore.core.echo import suggestion
from porocore.core.files.yaml_document import Location
from porocore.core.models.strict import CalledByUsers, StrictModel, by_kind
from porocore.core.tensors import cofactor, determinant
from porocore.core.units import Dimension, units_now
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh


class NeoHookean(Material, metaclass=CalledByUsers):
    """Compressible neo-Hookean solid with E = 1.

    Ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)², μ = 1/(2(1+ν)), λ = ν/((1+ν)(1−2ν))
    (Dehghani & Zilian, eq. Neo_Hookean). All methods work on arrays (..., 3, 3).

    Examples
    --------
    >>> from porocore import NeoHookean
    >>> solid = NeoHookean(poisson_ratio=0.3)
    >>> solid.stress(np.diag([1.1, 1.0, 1.0])).diagonal().round(4)
    array([0.1234, 0.055 , 0.055 ])
    """

    kind: Literal["neo-hookean"] = "neo-hookean"
    """Ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)² with E = 1."""
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] = 0.35
    """Poisson's ratio of the solid; μ and λ follow with E = 1."""

    @property
    def mu(self) -> float:
        """Shear modulus μ [E]."""
        return 1 / (2 * (1 + self.poisson_ratio))

    @property
    def lam(self) -> float:
        """First Lamé constant λ [E]."""
        return self.poisson_ratio / ((1 + self.poisson_ratio) * (1 - 2 * self.poisson_ratio))

    @property
    def isotropic(self) -> bool:
        """True: no direction is preferred."""
        return True

    @property
    def description(self) -> str:
        """Kind and Poisson's ratio."""
        return f"{self.kind} solid with Poisson's ratio {self.poisson_ratio:g}"

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return E = 1 and μ, the same everywhere."""
        return 1.0, self.mu

    def volumetric(self, log_J: Array) -> tuple[Array, Array, Array]:
        """Return U = −μ ln J + λ/2 (ln J)² and its first and second derivative by ln J."""
        return (
            (self.lam / 2 * log_J - self.mu) * log_J,
            self.lam * log_J - self.mu,
            np.full(log_J.shape, self.lam),
        )

    def energy_density(self, F: Array) -> Array:
        """Return Ψ (...) [E]."""
        of_shape = self.mu / 2 * ((F * F).sum(axis=(-2, -1)) - 3)
        return np.asarray(of_shape + self.volumetric(np.log(determinant(F)))[0])

    def stress(self, F: Array) -> Array:
        """Return P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""
        J = determinant(F)
        return self.mu * F + (self.volumetric(np.log(J))[1] / J)[..., None, None] * cofactor(F)

    def tangent(self, F: Array) -> Array:
        """Return A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""
        J = determinant(F)
        G = cofactor(F) / J[..., None, None]  # F⁻ᵀ
        _, first, second = self.volumetric(np.log(J))
        G_T = G.swapaxes(-1, -2)
        tangent: Array = second[..., None, None, None, None] * (
            G[..., :, :, None, None] * G[..., None, None, :, :]
        )
        tangent -= first[..., None, None, None, None] * (
            G[..., :, None, None, :] * G_T[..., None, :, :, None]  # G_il G_kj
        )
        tangent += self.mu * np.eye(9).reshape(3, 3, 3, 3)
        return tangent


class MooneyRivlin(InvariantMaterial):
    """Mooney–Rivlin solid with a separate response to changes of volume.

    Ψ = c₁₀ (J^(−2/3) I₁ − 3) + c₀₁ (J^(−4/3) I₂ − 3) + K/4 (J² − 1 − 2 ln J); initial shear modulus 2 (c₁₀ + c₀₁), bulk
    modulus K (Rivlin 1948, Phil. Trans. R. Soc. A 241; the split of Flory 1961).
    """

    kind: Literal["mooney-rivlin"]
    """Ψ = c₁₀ (J^(−2/3) I₁ − 3) + c₀₁ (J^(−4/3) I₂ − 3) + K/4 (J² − 1 − 2 ln J)."""
    c10: Annotated[float, Dimension("stress")]
    """c₁₀; 2 (c10 + c01) is the shear modulus of small strains."""
    c01: Annotated[float, Dimension("stress")]
    """c₀₁; 0 is a neo-Hookean solid of another volumetric energy than that of the kind ``neo-hookean``."""
    bulk_modulus: Annotated[float, Field(gt=0), Dimension("stress")]
    """K of small strains."""

    @property
    def description(self) -> str:
        """Kind and moduli."""
        return (
            f"{self.kind} solid, c10 = {units_now().text(self.c10, 'stress')}, "
            f"c01 = {units_now().text(self.c01, 'stress')}, "
            f"K = {units_now().text(self.bulk_modulus, 'stress')}"
        )

    @property
    def invariants(self) -> dict[str, Invariant]:
        """I1, I2 and J."""
        return BASIC

    @property
    def formula(self) -> str:
        return f"c10*(J**(-2/3)*I1 - 3) + c01*(J**(-4/3)*I2 - 3) + {VOLUMETRIC}"

    @property
    def constants(self) -> dict[str, float]:
        """c10, c01 and K."""
        return {"c10": self.c10, "c01": self.c01, "K": self.bulk_modulus}


MOST_TERMS = 8


class OgdenTerm(StrictModel):
    """Parameters μ_p and α_p of one term; μ_p α_p is twice its share of the initial shear modulus."""

    mu: Annotated[float, Dimension("stress")]
    """μ_p; ½ Σ μ_p α_p is the shear modulus of small strains."""
    alpha: Annotated[float, Field(ge=-50, le=50)]
    """α_p, any number but 0."""

    @field_validator("alpha")
    @classmethod
    def _not_zero(cls, alpha: float) -> float:
        if alpha == 0:
            raise ValueError("expected an exponent other than 0, whose term would be constant")
        return alpha


class Ogden(InvariantMaterial):
    """Ogden solid with a separate response to changes of volume.

    Ψ = Σ_p μ_p/α_p (J^(−α_p/3) (λ₁^α_p + λ₂^α_p + λ₃^α_p) − 3) + K/4 (J² − 1 − 2 ln J); initial shear modulus
    ½ Σ_p μ_p α_p, bulk modulus K (Ogden 1972, Proc. R. Soc. A 326 and 328). The power sums of the stretches are
    traces of powers of C, whose derivatives need divided differences of first order only, so equal stretches are no
    special case.
    """

    kind: Literal["ogden"]
    """Ψ = Σ_p μ_p/α_p (J^(−α_p/3) (λ₁^α_p + λ₂^α_p + λ₃^α_p) − 3) + K/4 (J² − 1 − 2 ln J)."""
    terms: tuple[OgdenTerm, ...]
    """The terms of the sum, 1 to 8."""
    bulk_modulus: Annotated[float, Field(gt=0), Dimension("stress")]
    """K of small strains."""

    @field_validator("terms")
    @classmethod
    def _some(cls, terms: tuple[OgdenTerm, ...]) -> tuple[OgdenTerm, ...]:
        if not 1 <= len(terms) <= MOST_TERMS:
            raise ValueError(f"expected 1 to {MOST_TERMS} terms, got {len(terms)}")
        return terms

    @property
    def description(self) -> str:
        """Kind and moduli."""
        terms = ", ".join(f"μ = {units_now().text(t.mu, 'stress')} with α = {t.alpha:g}" for t in self.terms)
        return f"{self.kind} solid, {terms}, K = {units_now().text(self.bulk_modulus, 'stress')}"

    @property
    def invariants(self) -> dict[str, Invariant]:
        """J and a power sum for each term."""
        return {"J": BASIC["J"]} | {f"T{i}": PowerSum(term.alpha) for i, term in enumerate(self.terms)}

    @property
    def formula(self) -> str:
        terms = (f"mu{i}/alpha{i}*(J**(-alpha{i}/3)*T{i} - 3)" for i in range(len(self.terms)))
        return " + ".join([*terms, VOLUMETRIC])

    @property
    def constants(self) -> dict[str, float]:
        """μ_p, α_p and K."""
        own = {name + str(i): number for i, term in enumerate(self.terms) for name, number in term}
        return {"K": self.bulk_modulus, **own}


Modulus = Annotated[float, Field(gt=0), Dimension("stress")]


class HolzapfelGasserOgden(InvariantMaterial):
    """Neo-Hookean matrix with families of fibres that stiffen exponentially, in tension only.

    Ψ = μ/2 (J^(−2/3) I₁ − 3) + K/4 (J² − 1 − 2 ln J) + Σ_k k₁/(2k₂) (exp(k₂ e_k²) − 1), with e_k = t r(E_k/t),
    E_k = κ (I₁ − 3) + (1 − 3κ)(a_k·C a_k − 1), r(x) = 0 below 0, x³ − x⁴/2 up to 1 and x − ½ beyond. All families share
    μ's units and k₁, k₂, κ. The toe t makes the onset of tension twice continuously differentiable (r ∈ C²), where the
    positive part of the original is not; for t → 0 it is the original. The fibres see the whole deformation, not its
    isochoric part, with which compressible solids behave unphysically (Nolan et al. 2014, J. Mech. Behav. Biomed.
    Mater. 39).

    References
    ----------
    Gasser, Ogden & Holzapfel (2006), J. R. Soc. Interface 3, 15–35.
    """

    kind: Literal["holzapfel-gasser-ogden"]
    """A neo-Hookean matrix with families of fibres that stiffen exponentially, in tension only."""
    shear_modulus: Modulus
    """μ of the matrix at small strains."""
    bulk_modulus: Modulus
    """K at small strains."""
    k1: Modulus
    """Stiffness of the fibres."""
    k2: Annotated[float, Field(gt=0, le=1000)]
    """How fast the fibres stiffen."""
    dispersion: Annotated[float, Field(ge=0, le=1 / 3)] = 0.0
    """κ: 0 for aligned fibres, 1/3 for fibres in all directions."""
    directions: Annotated[tuple[Direction, ...], Field(min_length=1, max_length=6)]
    """Mean direction of the fibres of each family: [a1, a2, a3] of any length but 0, or an angle in a plane, such as
    {plane: xy, angle: 30}."""
    toe: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Within this a·Ca − 1, about twice the strain along the fibres, they come to bear."""

    @property
    def description(self) -> str:
        """Kind, moduli and number of families."""
        count = len(self.directions)
        return (
            f"{self.kind} solid, μ = {units_now().text(self.shear_modulus, 'stress')}, "
            f"K = {units_now().text(self.bulk_modulus, 'stress')}, "
            f"k1 = {units_now().text(self.k1, 'stress')}, k2 = {self.k2:g}, κ = {self.dispersion:g}, "
            f"{count} {'family' if count == 1 else 'families'} of fibres"
        )

    @property
    def isotropic(self) -> bool:
        """True where the fibres have no preferred direction."""
        return self.dispersion == 1 / 3

    def turned(self, Q: IntArray) -> HolzapfelGasserOgden:
        """See :class:`~porocore.cell.materials.material.Material`; the families turn."""
        return self.model_copy(update={"directions": turned(self.directions, Q)})

    def equals(self, other: Material) -> bool:
        """Return whether both are the same up to the order and the signs of the directions."""
        if not isinstance(other, HolzapfelGasserOgden):
            return False
        return self == other.model_copy(update={"directions": self.directions}) and (
            self.isotropic or same_families(self.directions, other.directions)
        )

    @property
    def invariants(self) -> dict[str, Invariant]:
        """I1, J, and I4, I6, … of the families."""
        return BASIC | fibre_invariants(self.directions)

    @property
    def formula(self) -> str:
        families = (
            f"k1/(2*k2)*(exp(k2*(toe*ramp((kappa*(I1 - 3) + (1 - 3*kappa)*(I{4 + 2 * k} - 1))/toe))**2) - 1)"
            for k in range(len(self.directions))
        )
        return " + ".join(["mu/2*(J**(-2/3)*I1 - 3)", VOLUMETRIC, *families])

    @property
    def constants(self) -> dict[str, float]:
        """Parameters by their names in the formula."""
        return {
            "mu": self.shear_modulus,
            "K": self.bulk_modulus,
            "k1": self.k1,
            "k2": self.k2,
            "kappa": self.dispersion,
            "toe": self.toe,
        }


@dataclass(frozen=True)
class Composite:
    """Materials of ``cell.materials`` by the names of their regions."""

    materials: Mapping[str, Material]

    @property
    def isotropic(self) -> bool:
        """True where every material is isotropic."""
        return all(material.isotropic for material in self.materials.values())

    @property
    def mirrored(self) -> bool:
        """True where every material is invariant under the mirrors of the three axes."""
        return all(material.mirrored for material in self.materials.values())

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether a signed permutation Q (3, 3) of the axes leaves the response of the solid unchanged.

        The ``regions`` are mapped as :meth:`~porocore.cell.geometry.pore_geometry.PoreGeometry.regions_after` says.
        """
        if regions is None:
            return False
        for region, material in self.materials.items():
            image, turned = self.materials.get(regions.get(region, region)), material.turned(Q)
            if image is None or turned is None or not turned.equals(image):
                return False
        return True

    @property
    def swells(self) -> bool:
        """True where a material is swollen."""
        return any(material.swells for material in self.materials.values())

    @property
    def description(self) -> str:
        """Short description of the materials by region."""
        return "; ".join(f"{region}: {material.description}" for region, material in self.materials.items())

    @property
    def identity(self) -> str:
        """Materials by region, as text."""
        return json.dumps({region: m.identity for region, m in self.materials.items()}, sort_keys=True)

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Return the strain energy of every element of a mesh of the solid.

        Raises
        ------
        ConfigurationError
            A region has no material, or a material no region.
        """
        for region in self.materials:
            if region not in mesh.region_names:
                advice = suggestion(region, mesh.region_names, "its regions are", "it has no regions")
                raise ConfigurationError(
                    f"cell.materials.{region}: the solid has no region of this name; {advice}"
                )
        if lacking := [region for region in mesh.region_names if region not in self.materials]:
            raise ConfigurationError(
                f"cell.materials: expected a material for each region of the solid, got none for {', '.join(lacking)}; "
                f"add '{lacking[0]}:' below it"
            )
        parts = (
            (region, self.materials[region].on(mesh), np.flatnonzero(mesh.regions == k))
            for k, region in enumerate(mesh.region_names)
        )
        return PlacedMaterials(tuple(part for part in parts if len(part[2])))


@dataclass(frozen=True, eq=False)
class PlacedMaterials(StrainEnergy):
    """Solids on the elements of a mesh, each with its region and its elements; every element has one solid."""

    parts: tuple[tuple[str, StrainEnergy, IntArray], ...]

    @property
    def isotropic(self) -> bool:
        """True where every material is isotropic."""
        return all(material.isotropic for _, material, _ in self.parts)

    def energy_density(self, F: Array) -> Array:
        return self._gathered(F, (), lambda material: material.energy_density)

    def stress(self, F: Array) -> Array:
        return self._gathered(F, (3, 3), lambda material: material.stress)

    def tangent(self, F: Array) -> Array:
        return self._gathered(F, (3, 3, 3, 3), lambda material: material.tangent)

    def _gathered(
        self, F: Array, shape: tuple[int, ...], function: Callable[[StrainEnergy], Callable[[Array], Array]]
    ) -> Array:
        out = np.empty((*F.shape[:-2], *shape))
        for _, material, elements in self.parts:
            out[elements] = function(material)(F[elements])
        return out

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; all elements have the same weight."""
        young = shear = count = 0.0
        for _, material, own in self.parts:
            n = len(own) if elements is None else int(np.isin(own, elements).sum())
            E, G = material.mean_moduli()
            young, shear, count = young + n * E, shear + n * G, count + n
        return young / count, shear / count

    @property
    def mean_stretch(self) -> float:
        """Mean of λ over the elements, all of the same weight."""
        counts = [len(elements) for _, _, elements in self.parts]
        return float(np.average([material.mean_stretch for _, material, _ in self.parts], weights=counts))

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return the slopes by a number of one region, the first of the keys; they are 0 in the others."""
        by_energy, by_stress = np.zeros(F.shape[:-2]), np.zeros(F.shape)
        for region, material, elements in self.parts:
            if region == key[0]:
                by_energy[elements], by_stress[elements] = material.parameter_slopes(key[1:], F[elements])
        return by_energy, by_stress


#: Solid of a cell: one material, or one for each region.
Solid = Material | Composite


DEFAULT = "neo-hookean"


AnyMaterial = Annotated[
    Annotated[NeoHookean, Tag(DEFAULT)]
    | Annotated[MooneyRivlin, Tag("mooney-rivlin")]
    | Annotated[Ogden, Tag("ogden")]
    | Annotated[HolzapfelGasserOgden, Tag("holzapfel-gasser-ogden")]
    | Annotated[ExpressionMaterial, Tag("expression")],
    by_kind(Material, DEFAULT),
]
