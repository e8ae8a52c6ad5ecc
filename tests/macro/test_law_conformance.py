"""The macroscopic laws of this repository obey the kit's laws of macroscopic laws."""

from __future__ import annotations

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.verify.xie_leo import ClayLaw
from porocore.interfaces.law import CellLaw, LawWrapper, MacroLaw
from porocore.macro.analytic import XieLeo
from porocore.macro.laws.closure import PotentialClosure
from porocore.macro.laws.composed import BoundLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.testing import MacroLawSuite
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.cell import parametric_law
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION, linear_law, mean_gradient_law


class TestLinear(MacroLawSuite):
    kit_version = "4"

    @classmethod
    def make_law(cls):
        return linear_law()


class TestMeanGradient(MacroLawSuite):
    kit_version = "4"

    @classmethod
    def make_law(cls):
        return mean_gradient_law()


class PotentialCell(CellLaw):
    """The made-up cell with a potential."""

    identity = potential_cell.IDENTITY

    def predict(self, states, *, tangent=True):
        return potential_cell.respond(states)


class TestPotential(MacroLawSuite):
    kit_version = "4"

    @classmethod
    def make_law(cls):
        return ClosedLaw(PotentialCell(), PotentialClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY))


class TestClay(MacroLawSuite):
    kit_version = "4"

    @classmethod
    def make_law(cls):
        return ClayLaw(XieLeo())


class TestBound(MacroLawSuite):
    kit_version = "4"

    @classmethod
    def make_law(cls):
        return BoundLaw(parametric_law(closure="mean-gradient"), {"radius": 0.22, "stiffness": 1.3})


class TestWrapped(MacroLawSuite):
    kit_version = "4"

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
