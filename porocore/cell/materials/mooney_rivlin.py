"""Material of Mooney and Rivlin, compressible."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from porocore.cell.invariants.by_invariants import BASIC, VOLUMETRIC, InvariantMaterial
from porocore.cell.invariants.invariants import Invariant
from porocore.core.units.dimensions import Dimension
from porocore.core.units.results import spoken


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
            f"{self.kind} solid, c10 = {spoken().text(self.c10, 'stress')}, c01 = {spoken().text(self.c01, 'stress')}, "
            f"K = {spoken().text(self.bulk_modulus, 'stress')}"
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
