"""Suite of macroscopic laws (MacroLawSuite): exact tangent, promise of a constant one, stored fluid.

.. code-block:: python

    class TestMyLaw(MacroLawSuite):
        kit_version = "3"

        @classmethod
        def make_law(cls):
            return MyLaw()
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

import numpy as np
import pytest

from porocore.interfaces.law import LawMemory, MacroLaw, MacroTangent
from porocore.states import Array, MacroState
from porocore.testing.expect import holds, near, require, states_text
from porocore.testing.suite import Suite

#: Points of the states that are tried.
POINTS = 12
#: Step of the differences, as a share of the sizes of the states.
STEP = 1e-4
#: Differences of sums in another order, as a share of the largest entry.
ROUND_OFF = 1e-12
#: Responses that the macro solver integrates.
INTEGRATED = ("stress", "storage", "flux")


class MacroLawSuite(Suite):
    """Subclass it, name the class ``Test…`` and give it ``make_law``.

    Attributes
    ----------
    sizes
        Largest H, p and ∇p of the states that are tried.
    accuracy
        Difference between the tangent and differences of the response, as a share of the largest entry.
    """

    sizes: ClassVar[tuple[float, float, float]] = (0.02, 0.02, 0.02)
    accuracy: ClassVar[float] = 1e-6

    @classmethod
    def make_law(cls) -> MacroLaw:
        """The law under test."""
        raise cls.undefined("make_law(cls)", "MyLaw()", "a new porocore.MacroLaw")

    @pytest.fixture(scope="class")
    @classmethod
    def law(cls) -> MacroLaw:
        return cls.make_law()

    @classmethod
    def random(cls, seed: int) -> tuple[MacroState, Array]:
        """Return states and gradients of the pressure without any symmetry."""
        rng = np.random.default_rng(seed)
        H, p, grad_p = cls.sizes
        return (
            MacroState(rng.uniform(-H, H, (POINTS, 3, 3)), rng.uniform(-p, p, POINTS)),
            rng.uniform(-grad_p, grad_p, (POINTS, 3)),
        )

    @classmethod
    def before(cls, law: MacroLaw, seed: int) -> LawMemory:
        """Return the memory of random states."""
        return law.respond(*cls.random(seed), law.initial(POINTS), tangent=False).memory

    @classmethod
    def tangent(cls, law: MacroLaw, states: MacroState, grad_p: Array, memory: LawMemory) -> MacroTangent:
        """Return the tangent, which has to be there."""
        response = law.respond(states, grad_p, memory)
        return require("a tangent", response.tangent, states_text(states))

    def test_the_tangent_is_the_derivative_of_the_response(self, law: MacroLaw) -> None:
        """Along random directions of (H, p, ∇p), from a memory that is not at rest."""
        (states, grad_p), (along, along_grad), memory = self.random(1), self.random(2), self.before(law, 3)

        def at(share: float) -> Any:
            moved = MacroState(states.grad_u + share * along.grad_u, states.p + share * along.p)
            return law.respond(moved, grad_p + share * along_grad, memory, tangent=False)

        tangent = self.tangent(law, states, grad_p, memory)
        ends = at(STEP), at(-STEP)
        for name in INTEGRATED:
            slope = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * STEP)
            by_H, by_p = getattr(tangent, f"{name}_grad_u"), getattr(tangent, f"{name}_p")
            found = np.einsum("n...kl,nkl->n...", by_H, along.grad_u) + np.einsum(
                "n...,n->n...", by_p, along.p
            )
            if name == "flux":
                found = found + np.einsum("nij,nj->ni", tangent.flux_grad_p, along_grad)
            within = self.accuracy * float(np.abs(slope).max())
            near(f"the tangent of the {name}", found, slope, states_text(states), within=within)

    def test_a_tangent_that_is_said_to_be_constant_is_so(self, law: MacroLaw) -> None:
        """The same at all points, for all states, gradients and memories: ``constant_tangent``."""
        self.needs(law.constant_tangent, "constant_tangent = False: the tangent may change")
        n = POINTS
        rest = self.tangent(law, MacroState.zeros(n), np.zeros((n, 3)), law.initial(n))
        for seed in (1, 4):
            states, grad_p = self.random(seed)
            tangent = self.tangent(law, states, grad_p, self.before(law, seed + 1))
            for field in fields(MacroTangent):
                wanted = getattr(rest, field.name)[:1]
                within = ROUND_OFF * float(np.abs(wanted).max(initial=0.0))
                state = f"{states_text(states)}, constant_tangent = True"
                found = getattr(tangent, field.name)
                near(field.name, found, np.broadcast_to(wanted, found.shape), state, within=within)

    def test_what_is_taken_up_is_the_change_of_the_stored_fluid(self, law: MacroLaw) -> None:
        """The next step counts from the fluid volume of the memory, whatever axes and parameters it has."""
        (states, grad_p), memory = self.random(9), self.before(law, 10)
        found = law.respond(states, grad_p, memory, tangent=False)
        stored = found.memory.fluid_volume
        within = ROUND_OFF * float(np.abs(stored).max())
        near("the storage", found.storage, stored - memory.fluid_volume, states_text(states), within=within)

    def test_points_do_not_depend_on_one_another(self, law: MacroLaw) -> None:
        """Each alone, and in another order."""
        (states, grad_p), memory = self.random(5), self.before(law, 6)
        whole, state = law.respond(states, grad_p, memory), states_text(states)
        for rows in (np.array([3]), np.arange(POINTS)[::-1]):
            part = law.respond(states[rows], grad_p[rows], memory[rows])
            for name in INTEGRATED:
                wanted = getattr(whole, name)[rows]
                within = ROUND_OFF * float(np.abs(getattr(whole, name)).max())
                near(
                    f"{name} of {len(rows)} of the points", getattr(part, name), wanted, state, within=within
                )

    def test_without_the_tangent_the_response_is_the_same(self, law: MacroLaw) -> None:
        (states, grad_p), memory = self.random(7), self.before(law, 8)
        whole = law.respond(states, grad_p, memory)
        plain, state = law.respond(states, grad_p, memory, tangent=False), states_text(states)
        holds(plain.tangent is None, state, "no tangent where none is wanted", "a tangent")
        for name in INTEGRATED:
            wanted = getattr(whole, name)
            near(name, getattr(plain, name), wanted, state, within=ROUND_OFF * float(np.abs(wanted).max()))
