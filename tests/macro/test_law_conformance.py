"""The macroscopic laws of this repository obey the kit's laws of macroscopic laws."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.verify.xie_leo import ClayLaw
from porocore.interfaces.law import CellLaw, Interval, LawWrapper, MacroLaw
from porocore.macro.analytic import XieLeo
from porocore.macro.laws.charges import ChargedLaw
from porocore.macro.laws.closure import PotentialClosure
from porocore.macro.laws.composed import BoundLaw, RegionLaw, TurnedLaw
from porocore.macro.laws.evolution import EvolvingLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.laws.rates import Rate
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.states import BodyPlace
from porocore.testing import MacroLawSuite
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.cell import parametric_law
from porocore.testing.synthetic.porous_family import PARAMETERS
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION, linear_law, mean_gradient_law
from tests.helpers import sensitivity_bodies


class TestLinear(MacroLawSuite):
    kit_version = "5"

    @classmethod
    def make_law(cls):
        return linear_law()


class TestMeanGradient(MacroLawSuite):
    kit_version = "5"
    derivatives = True

    @classmethod
    def make_law(cls):
        return mean_gradient_law()


class PotentialCell(CellLaw):
    """The made-up cell with a potential."""

    identity = potential_cell.IDENTITY

    def predict(self, states, *, tangent=True):
        return potential_cell.respond(states)


class TestPotential(MacroLawSuite):
    kit_version = "5"
    derivatives = True

    @classmethod
    def make_law(cls):
        return ClosedLaw(PotentialCell(), PotentialClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY))


class TestParametric(MacroLawSuite):
    kit_version = "5"
    values: ClassVar[dict[str, tuple[float, float]]] = PARAMETERS
    derivatives = True

    @classmethod
    def make_law(cls):
        return sensitivity_bodies.law(*PARAMETERS)


#: Two branches, one of which has relaxed by a third within the step.
BRANCHES = {
    "relaxation.1.strength": (0.5, 1.5),
    "relaxation.1.time": (0.5, 2.0),
    "relaxation.2.strength": (0.1, 0.4),
    "relaxation.2.time": (5.0, 9.0),
}


class TestRelaxing(MacroLawSuite):
    kit_version = "5"
    values = TestParametric.values | BRANCHES
    step = Interval(1.0, 1.4)
    derivatives = True

    @classmethod
    def make_law(cls):
        return RelaxingLaw(sensitivity_bodies.law(*PARAMETERS), 2)


class TestRelaxingAtOnce(TestRelaxing):
    step = Interval(1.0, 1.0)


class TestRelaxed(TestRelaxing):
    step = None
    unchanged = tuple(f"{kind}_{i}" for i in (1, 2) for kind in ("overstress", "overpressure"))


class TestRelaxingMeanGradient(MacroLawSuite):
    kit_version = "5"
    values: ClassVar[dict[str, tuple[float, float]]] = BRANCHES
    step = Interval(1.0, 1.4)
    derivatives = True

    @classmethod
    def make_law(cls):
        return RelaxingLaw(mean_gradient_law(), 2)


class TestRelaxingLinear(TestRelaxingMeanGradient):
    @classmethod
    def make_law(cls):
        return RelaxingLaw(linear_law(), 2, small_strain=True)


class TestRelaxingInItsAxes(TestRelaxing):
    @classmethod
    def make_law(cls):
        return TurnedLaw(RelaxingLaw(sensitivity_bodies.law(*PARAMETERS), 2))

    @classmethod
    def random(cls, seed):
        states, grad_p = super().random(seed)
        axes = np.linalg.qr(np.random.default_rng(99).normal(size=(len(states), 3, 3)))[0]
        axes[:, :, 0] *= np.linalg.det(axes)[:, None]
        return replace(states, place=BodyPlace(np.zeros(len(states), int), axes)), grad_p


class TestRelaxingInRegions(TestRelaxing):
    """Beside a law that remembers something else; parameters are those of both."""

    @classmethod
    def make_law(cls):
        return RegionLaw([RelaxingLaw(sensitivity_bodies.law(*PARAMETERS), 2), mean_gradient_law()])

    @classmethod
    def random(cls, seed):
        states, grad_p = super().random(seed)
        return replace(states, place=BodyPlace(np.arange(len(states)) % 2)), grad_p


RATE = {"evolution.radius.a": (0.01, 0.03)}
CHARGES = {"charges.density": (0.1, 0.3), "charges.bath": (0.1, 0.2)}


def evolving_law():
    """A cell whose pores grow with the flux and the pressure."""
    rate = Rate("a*flux*(1 + p)", tuple(PARAMETERS), ["a"])
    return EvolvingLaw(sensitivity_bodies.law(*PARAMETERS), {"radius": rate}, {"radius": (0.1, 0.4)})


class TestEvolving(MacroLawSuite):
    kit_version = "5"
    values = TestParametric.values | RATE
    step = Interval(1.0, 1.4)
    derivatives = True

    @classmethod
    def make_law(cls):
        return evolving_law()


class TestCharged(MacroLawSuite):
    kit_version = "5"
    values = TestParametric.values | CHARGES
    step = Interval(1.0, 1.4)
    derivatives = True
    unchanged = ("charge",)

    @classmethod
    def make_law(cls):
        return ChargedLaw(sensitivity_bodies.law(*PARAMETERS), 0.25)


class TestChargedRelaxingAndEvolving(TestCharged):
    values = TestParametric.values | RATE | BRANCHES | CHARGES

    @classmethod
    def make_law(cls):
        return ChargedLaw(RelaxingLaw(evolving_law(), 2), 0.25)


class TestClay(MacroLawSuite):
    kit_version = "5"

    @classmethod
    def make_law(cls):
        return ClayLaw(XieLeo())


class TestBound(MacroLawSuite):
    kit_version = "5"

    @classmethod
    def make_law(cls):
        return BoundLaw(parametric_law(closure="mean-gradient"), {"radius": 0.22, "stiffness": 1.3})


class TestWrapped(MacroLawSuite):
    kit_version = "5"

    @classmethod
    def make_law(cls):
        return LawWrapper(mean_gradient_law())


def test_a_wrapper_passes_on_all_that_a_law_can_be_asked():
    """A method that the interface gains and the wrapper does not would answer for the wrong law."""
    asked = {name for name, found in vars(MacroLaw).items() if callable(found) and not name.startswith("_")}
    assert asked >= {"respond", "initial_at", "before_accept", "reasons"}
    assert asked - set(vars(LawWrapper)) == set()
    law = mean_gradient_law()
    wrapped = LawWrapper(law)
    for name in (*MacroLaw.__annotations__, "identity", "name"):
        assert getattr(wrapped, name) == getattr(law, name)
