"""Material of Holzapfel, Gasser and Ogden: neo-Hookean with fibres that stiffen in tension."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from porocore.cell.invariants.by_invariants import BASIC, VOLUMETRIC, InvariantMaterial
from porocore.cell.invariants.invariants import Invariant
from porocore.cell.materials.fibres import Direction, fibre_invariants, same_families, turned
from porocore.cell.materials.material import Material
from porocore.core.units.dimensions import Dimension
from porocore.core.units.results import spoken
from porocore.states import IntArray

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
            f"{self.kind} solid, μ = {spoken().text(self.shear_modulus, 'stress')}, "
            f"K = {spoken().text(self.bulk_modulus, 'stress')}, "
            f"k1 = {spoken().text(self.k1, 'stress')}, k2 = {self.k2:g}, κ = {self.dispersion:g}, "
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
