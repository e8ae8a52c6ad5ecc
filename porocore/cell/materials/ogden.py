"""Material of Ogden in principal stretches, compressible."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from porocore.cell.invariants.by_invariants import BASIC, VOLUMETRIC, InvariantMaterial
from porocore.cell.invariants.invariants import Invariant, PowerSum
from porocore.core.models.strict import StrictModel
from porocore.core.units.dimensions import Dimension
from porocore.core.units.results import spoken

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
        terms = ", ".join(f"μ = {spoken().text(t.mu, 'stress')} with α = {t.alpha:g}" for t in self.terms)
        return f"{self.kind} solid, {terms}, K = {spoken().text(self.bulk_modulus, 'stress')}"

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
