"""A made-up cell with any point group, and no more symmetry: what a law that is learned from it must keep.

W is a random polynomial in ln U and p with exactly that group, <∇u¹>_s and ln K_ref are random polynomials of second
order that turn with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.tensors import PointGroup
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import CellResponse, IntArray, MacroState
from porocore.surrogates.conductivity import ConductivityModel
from porocore.surrogates.family.joint import JointPolynomial
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.polynomial.monomials import Polynomial, exponents_up_to, invariant
from porocore.surrogates.rest import SingleRest
from porocore.surrogates.symmetry import Action, Equivariance, on_places, on_triangle, on_variables
from porocore.surrogates.training_box import TrainingBox

#: All nine components of H and p.
INPUTS = InputSpace.from_ranges(
    {f"H{i}{j}": (-0.1, 0.1) for i in (1, 2, 3) for j in (1, 2, 3)} | {"p": (0.0, 0.1)}
)
SEVEN = tuple(range(7))
POROSITY, CONDUCTIVITY = 0.4, 2.0


@dataclass(frozen=True, eq=False)
class GroupedCell:
    """A law with a given point group.

    Attributes
    ----------
    group
        Its point group.
    potential, conductivity
        W with <∇u¹>_s, and K_ref.
    """

    group: PointGroup
    potential: PotentialModel
    conductivity: ConductivityModel

    @classmethod
    def random(cls, group: PointGroup, *, degree: int = 4, seed: int = 0) -> GroupedCell:
        """Return one whose W is of a degree, 3 or more, in the strains; its coefficients depend on the seed."""
        random = np.random.default_rng(seed)
        y, places = on_variables(group), on_places(group)

        def turning(outputs: Action, exponents: IntArray) -> Polynomial:
            ties = Equivariance(y, outputs).ties(exponents)
            return Polynomial(exponents, ties.coefficients(random.normal(size=ties.count)))

        A = random.normal(size=(7, 7))
        A = y.mean(y, A @ A.T / 7 + np.eye(7))
        A[6, 6] = -abs(A[6, 6])
        rest = SingleRest.from_numbers(
            group,
            np.eye(3),
            np.log(CONDUCTIVITY) * np.eye(3),
            porosity=np.array(POROSITY),
            gradient=np.array([0, 0, 0, 0, 0, 0, -POROSITY]),
            matrix=A,
            mean=places.mean(y, random.normal(size=(9, 7))),
        )
        terms = invariant(group)
        exponents = terms.monomials(3, degree)
        everywhere = TrainingBox(SEVEN, np.full(7, -9.0), np.full(7, 9.0))
        sampled = SampledRange.around(INPUTS, np.array([INPUTS.lower, INPUTS.upper]))
        potential = PotentialModel(
            rest,
            JointPolynomial(terms, Polynomial(exponents, random.normal(size=(1, len(exponents))))),
            None,
            turning(places, exponents_up_to((1,) * 7, 2, 2)),
            SEVEN,
            sampled,
            everywhere,
        )
        conductivity = ConductivityModel(
            rest,
            turning(on_triangle(group), exponents_up_to((1,) * 7, 1, 2)),
            SEVEN,
            everywhere,
            sampled,
        )
        return cls(group, potential, conductivity)

    def respond(self, states: MacroState) -> CellResponse:
        """Return all responses of n states with their derivatives."""
        found = self.potential.predict(states, tangent=True)
        K, by_H, by_p = self.conductivity.predict(states, tangent=True)
        assert found.tangent is not None
        return replace(
            found,
            conductivity=K,
            doubt=None,
            min_fluid_jacobian=np.ones(len(states)),
            tangent=replace(found.tangent, conductivity_grad_u=by_H, conductivity_p=by_p),
        )

    def training_set(self, n: int = 60, *, inputs: InputSpace = INPUTS, seed: int = 3) -> TrainingSet:
        """Return ``n`` states, uniform at random in the box of ``inputs`` by ``seed``, with the group of the cell."""
        low, high = np.array(inputs.lower), np.array(inputs.upper)
        states = inputs.scatter(low + (high - low) * np.random.default_rng(seed).random((n, len(inputs))))
        rest = self.respond(MacroState.zeros(1))
        return TrainingSet(states, self.respond(states), inputs, rest, "grouped cell", {}, self.group)
