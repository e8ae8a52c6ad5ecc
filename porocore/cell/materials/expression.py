"""Materials by a formula of invariants (InvariantMaterial), one from text (ExpressionMaterial); fibres."""

from __future__ import annotations

import keyword
import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo, field_validator

from porocore.cell.materials.invariants import (
    FUNCTIONS,
    Derivatives,
    Fibre,
    Formula,
    Invariant,
    Kinematics,
    Second,
    SecondFibre,
    Third,
    Trace,
    Volume,
    add_outer,
    derivatives,
    stress_at_rest,
)
from porocore.cell.materials.material import Material
from porocore.core.files.yaml_document import Location
from porocore.core.formulas import CONSTANTS, Expression
from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension, Unit
from porocore.states import Array, IntArray

Vector = tuple[float, float, float]
#: Tolerance of the product of parallel unit vectors.
SAME = 1e-12


def _unit(direction: Vector) -> Vector:
    length = float(np.linalg.norm(direction))
    if not 1e-6 < length < 1e6:
        raise ValueError(f"expected a direction [a1, a2, a3] other than 0, got {list(direction)}")
    if abs(length - 1) <= 4e-16:  # so that a normalised vector stays the same
        return direction
    a1, a2, a3 = (float(a) / length for a in direction)
    return a1, a2, a3


class FibreAngle(StrictModel):
    """Direction of fibres by an angle in a plane of two axes."""

    plane: Literal["xy", "yz", "zx"]
    """The two axes, from the first of which the angle is measured towards the second."""
    angle: Annotated[float, Field(ge=-360, le=360), Unit("°")]
    """Angle in degrees: 0 is along the first axis, 90 along the second."""

    @property
    def vector(self) -> Vector:
        """Unit vector (3,)."""
        turn = self.angle * np.pi / 180
        along = dict.fromkeys("xyz", 0.0) | {self.plane[0]: np.cos(turn), self.plane[1]: np.sin(turn)}
        return along["x"], along["y"], along["z"]


def _form(direction: Any) -> str:
    return "in-plane" if isinstance(direction, Mapping | FibreAngle) else "vector"


#: Vector of any length but 0, normalised; or an angle in a plane.
Direction = Annotated[
    Annotated[Vector, AfterValidator(_unit), Tag("vector")] | Annotated[FibreAngle, Tag("in-plane")],
    Discriminator(_form),
]
Directions = tuple[Vector | FibreAngle, ...]


def vectors(directions: Directions) -> tuple[Vector, ...]:
    """Return the unit vectors of all directions."""
    return tuple(d.vector if isinstance(d, FibreAngle) else d for d in directions)


def fibre_invariants(directions: Directions) -> dict[str, Invariant]:
    """Return I4 and I5 of the first direction, I6 and I7 of the second, and so on."""
    found: dict[str, Invariant] = {}
    for k, direction in enumerate(vectors(directions)):
        found |= {f"I{4 + 2 * k}": Fibre(direction), f"I{5 + 2 * k}": SecondFibre(direction)}
    return found


def turned(directions: Directions, Q: IntArray) -> tuple[Vector, ...]:
    """Return Q a of each direction a, for a signed permutation Q (3, 3)."""
    images = ((Q @ np.array(direction)).tolist() for direction in vectors(directions))
    return tuple((a1, a2, a3) for a1, a2, a3 in images)


def same_in_order(directions: Directions, others: Directions) -> bool:
    """Return whether the k-th directions of both are parallel, for all k."""
    return len(directions) == len(others) and all(
        _parallel(a, b) for a, b in zip(vectors(directions), vectors(others), strict=True)
    )


def same_families(directions: Directions, others: Directions) -> bool:
    """Return whether both have the same directions up to sign and order, with the same multiplicities."""

    def counts(among: Directions) -> list[int]:
        return [sum(_parallel(a, b) for b in vectors(among)) for a in vectors(directions)]

    return len(directions) == len(others) and counts(directions) == counts(others)


def _parallel(a: Vector, b: Vector) -> bool:
    return abs(abs(float(np.dot(a, b))) - 1) < SAME


#: Points in one batch, so that their tangents fit into the cache of the processor.
TOGETHER = 1024
#: Invariants by their names in a formula.
BASIC: dict[str, Invariant] = {"I1": Trace(), "I2": Second(), "J": Volume()}
#: Volumetric energy of the presets: convex in J, with a barrier at J = 0 and the bulk modulus K (Simo & Taylor 1991,
#: Comput. Methods Appl. Mech. Eng. 85, eq. 3.1).
VOLUMETRIC = "K/4*(J**2 - 1 - 2*log(J))"


class InvariantMaterial(Material):
    """Ψ = W(I_1, …, I_m) − W at rest, with the invariants I_a(F) that the formula names.

    P = Σ_a W_a ∂I_a/∂F and A = Σ_a W_a ∂²I_a/∂F² + Σ_ab W_ab ∂I_a/∂F ⊗ ∂I_b/∂F.
    """

    @property
    @abstractmethod
    def invariants(self) -> dict[str, Invariant]:
        """Invariants that the formula may use, by name."""

    @property
    @abstractmethod
    def formula(self) -> str:
        """Formula of W as text."""

    @property
    @abstractmethod
    def constants(self) -> dict[str, float]:
        """Parameters of the formula, by name."""

    @property
    def isotropic(self) -> bool:
        """True, unless a kind has fibres."""
        return True

    def energy_density(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            (rest,) = d.value(*(float(i.rest) for i in used), *self.constants.values())
            (energy,) = d.value(*(i.value(at) for i in used), *self.constants.values())
            out[:] = energy - rest

        return self._computed(F, (), compute)

    def stress(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            first = d.first(*(i.value(at) for i in used), *self.constants.values())
            out[:] = sum(W_a * i.gradient(at) for W_a, i in zip(first, used, strict=True))

        return self._computed(F, (3, 3), compute)

    def tangent(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            m = len(used)
            found = d.second(*(i.value(at) for i in used), *self.constants.values())
            gradients = [i.gradient(at) for i in used]
            second = np.empty((m, m), dtype=object)
            for (a, b), value in zip(np.transpose(np.triu_indices(m)), found[m:], strict=True):
                second[a, b] = second[b, a] = value
            for a in range(m):
                mixed = sum(second[a, b] * gradients[b] for b in range(m) if not _vanishes(second[a, b]))
                if not isinstance(mixed, int):
                    add_outer(out, gradients[a], mixed)
            for W_a, invariant in zip(found[:m], used, strict=True):
                if not _vanishes(W_a):
                    invariant.add_hessian(out, np.asarray(W_a), at)

        return self._computed(F, (3, 3, 3, 3), compute)

    def _kind_of_numbers(self, F: Array) -> np.dtype[Any]:
        """Return complex numbers where F or a number of the material is complex, as in a complex step."""
        directions = [i.direction for i in self.invariants.values() if isinstance(i, Fibre)]
        return np.result_type(F, *self.constants.values(), *map(np.asarray, directions))

    def _computed(self, F: Array, shape: tuple[int, ...], compute: Callable[..., None]) -> Array:
        """Return a quantity computed in batches of points, with components first in memory and last in its shape."""
        own = self.invariants
        generated = derivatives(formula_of(self.formula, own, self.constants))
        used = [tuple(own.values())[i] for i in generated.used]
        points = F.shape[:-2]
        flat = np.moveaxis(F.reshape(-1, 3, 3), 0, -1)
        n = flat.shape[-1]
        kind = self._kind_of_numbers(F)
        out = np.zeros((*shape, n), dtype=kind)
        # At unphysical strains an energy may overflow; the solver then shortens its step.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for start in range(0, n, TOGETHER):
                part = slice(start, start + TOGETHER)
                block = np.zeros((*shape, len(range(n)[part])), dtype=kind)
                compute(Kinematics(np.ascontiguousarray(flat[..., part])), generated, used, block)
                out[..., part] = block
        components = tuple(range(len(shape)))
        last = out.reshape((*shape, *points))
        return np.asarray(np.moveaxis(last, components, tuple(i - len(shape) for i in components)))


def formula_of(energy: str, invariants: Mapping[str, Invariant], constants: Iterable[str]) -> Formula:
    """Return the formula of an energy in the invariants and constants of these names."""
    return Formula(energy, tuple((name, i.rest) for name, i in invariants.items()), tuple(constants))


def _vanishes(value: Any) -> bool:
    """Return whether the generated code returned the number 0 instead of an array."""
    return np.ndim(value) == 0 and value == 0


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
