"""Material whose strain energy is a formula in the configuration (ExpressionMaterial)."""

from __future__ import annotations

import keyword
import re
from functools import cached_property
from itertools import combinations
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from porocore.cell.invariants.by_invariants import BASIC, InvariantMaterial, formula_of
from porocore.cell.invariants.formula import FUNCTIONS, stress_at_rest
from porocore.cell.invariants.generated import derivatives
from porocore.cell.invariants.invariants import Invariant, Third
from porocore.cell.materials.fibres import Direction, Directions, fibre_invariants, same_in_order, turned
from porocore.cell.materials.material import Material
from porocore.core.files.yaml_document import Location
from porocore.core.formulas.expressions import CONSTANTS, Expression
from porocore.core.units.dimensions import Dimension
from porocore.states import IntArray

#: Parameters up to which the dimension of each is found; the work doubles with each.
MOST_PARAMETERS = 8
#: Deformation gradients at which energies are compared.
STRETCHED = np.eye(3) + np.array(
    [[[0.11, 0.03, 0.02], [0.01, -0.07, 0.04], [-0.02, 0.05, 0.06]], np.diag([0.05, 0.02, 0.09])]
)
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")


class ExpressionMaterial(InvariantMaterial):
    """Ψ as a formula of I1, I2, J (and I3 = J²), of the fibre invariants I4, I5, … and of named parameters.

    Its first and second derivatives are generated, so any smooth formula with a stress-free and stiff reference is a
    material. A constant in it has no effect: Ψ = 0 at F = I. The k-th direction a has the invariants a·Ca and
    a·C²a, named I4 and I5 for the first one, I6 and I7 for the second.
    """

    kind: Literal["expression"]
    """A strain energy that is written as a formula."""
    parameters: Annotated[dict[str, float], Dimension("stress")] = Field(default={})
    """Values by the names that the energy uses, every one of which must occur in it; one with a unit is a stress."""
    directions: Annotated[tuple[Direction, ...], Field(max_length=4)] = ()
    """Directions of fibres in the undeformed solid: [a1, a2, a3] of any length but 0, or an angle in a plane, such as
    {plane: xy, angle: 30}."""
    energy: Annotated[str, Field(max_length=1000)]
    """Ψ as a formula of I1, I2, I3, J, of I4, I5, … for directions, and of parameters, with ``+ - * / **``, numbers,
    brackets, exp, log, sqrt, sinh, cosh, tanh, sin, cos and ramp."""

    @field_validator("parameters")
    @classmethod
    def _names(cls, parameters: dict[str, float]) -> dict[str, float]:
        for name in parameters:
            if not NAME.fullmatch(name) or keyword.iskeyword(name):
                raise ValueError(
                    f"'{name}' cannot be the name of a parameter; expected a letter, then letters, digits or "
                    "underscores, and no word of Python such as lambda"
                )
            if name in FUNCTIONS or name in CONSTANTS or re.fullmatch(r"I\d+|J", name):
                raise ValueError(f"'{name}' has a meaning already; choose another name for the parameter")
        return parameters

    @field_validator("energy")
    @classmethod
    def _is_an_energy(cls, energy: str, info: ValidationInfo) -> str:
        if "parameters" not in info.data or "directions" not in info.data:
            return energy  # their own errors are reported
        known, parameters = _invariants(info.data["directions"]), info.data["parameters"]
        try:
            used = Expression.parse(energy, [*known, *parameters], FUNCTIONS).names
        except ValueError as error:
            wanted = re.match(r"'I([4-9]|1[01])' at", str(error))
            needs = f"; I{wanted[1]} needs a fibre, such as directions: [[1, 0, 0]]" if wanted else ""
            raise ValueError(f"{error}{needs}") from None
        if idle := [name for name in parameters if name not in used]:
            raise ValueError(
                f"the parameter '{idle[0]}' does not occur; remove it from parameters, or use it"
            )
        for k in range(len(info.data["directions"])):
            pair = f"I{4 + 2 * k}", f"I{5 + 2 * k}"
            if not used.intersection(pair):
                raise ValueError(
                    f"of direction {k + 1} neither {pair[0]} nor {pair[1]} occurs; remove the direction, or use them"
                )
        derivatives(formula_of(energy, known, parameters))
        return energy

    @property
    def description(self) -> str:
        """Formula and parameters."""
        values = ", ".join(f"{name} = {value:g}" for name, value in self.parameters.items())
        return f"solid with the energy {self.energy}" + (f", {values}" if values else "")

    @property
    def isotropic(self) -> bool:
        """True without fibres."""
        return not self.directions

    def turned(self, Q: IntArray) -> ExpressionMaterial:
        """See :class:`~porocore.cell.materials.material.Material`; the directions turn."""
        return self.model_copy(update={"directions": turned(self.directions, Q)})

    def equals(self, other: Material) -> bool:
        """Return whether both have the same formula, parameters and directions up to sign, in the same order."""
        if not isinstance(other, ExpressionMaterial):
            return False
        return self == other.model_copy(update={"directions": self.directions}) and same_in_order(
            self.directions, other.directions
        )

    @property
    def invariants(self) -> dict[str, Invariant]:
        """I1, I2, I3, J and those of the fibres."""
        return _invariants(self.directions)

    @property
    def formula(self) -> str:
        return self.energy

    @property
    def constants(self) -> dict[str, float]:
        return self.parameters

    def quantity_of(self, below: Location, declared: str) -> str:
        """Return '' for a parameter that is no stress, such as an exponent; see :attr:`stresses`."""
        plain = below[0] == "parameters" and below[-1] not in self.stresses
        return "" if plain else declared

    @cached_property
    def stresses(self) -> frozenset[str]:
        """Names of the parameters that are stresses, since Ψ is one.

        They are in every set of parameters which, doubled together, double Ψ. Of too many parameters none is known.
        """
        names = list(self.parameters)
        if len(names) > MOST_PARAMETERS:
            return frozenset()
        doubling = [
            chosen
            for count in range(1, len(names) + 1)
            for chosen in map(frozenset, combinations(names, count))
            if self._doubled_by(chosen)
        ]
        return frozenset.intersection(*doubling) if doubling else frozenset()

    def _doubled_by(self, names: frozenset[str]) -> bool:
        doubled = {name: (2 if name in names else 1) * value for name, value in self.parameters.items()}
        energy = self.energy_density(STRETCHED)
        found = self.model_copy(update={"parameters": doubled}).energy_density(STRETCHED)
        return bool(np.allclose(found, 2 * energy, rtol=1e-9, atol=0))

    def stress_hint(self) -> str:
        """Return the missing term, in the names of the configuration."""
        of_volume, of_fibres = stress_at_rest(
            formula_of(self.energy, self.invariants, self.parameters),
            {name: i.gradient_at_rest for name, i in self.invariants.items()},
            set(fibre_invariants(self.directions)),
            self.parameters,
        )
        if of_fibres:
            return "let the terms of the fibres have no slope at I4 = 1 (I5 = 1, …), as (I4 - 1)**2 has none"
        return f"add {of_volume}"


def _invariants(directions: Directions) -> dict[str, Invariant]:
    return {**BASIC, "I3": Third(), **fibre_invariants(directions)}
