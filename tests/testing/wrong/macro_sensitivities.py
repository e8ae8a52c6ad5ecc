"""Macro solvers that break one law of sensitivities each."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np

from porocore.interfaces.law import ResponseChanges
from porocore.macro.sensitivities.adjoint import MemoryWeights, UnitDerivatives
from porocore.macro.sensitivities.changes import Directions
from tests.testing.wrong.skfem_macro import Altered, Law, with_history

MOVED, LOADS = ResponseChanges.moved, Directions.loads


class TestFine(Law):
    caught_by = ""


class TestForgetsWhatWasStored(Law):
    """Each step begins as if the fluid stored before it did not depend on the unknowns."""

    caught_by = "test_sensitivities_are_limits_of_differences"
    slow = True

    class solver(Altered):
        def solve_with_sensitivities(self, *given, **how):
            def moved(self, *given):
                total, memory = MOVED(self, *given)
                return total, replace(memory, fluid_volume=np.zeros_like(memory.fluid_volume))

            with patch.object(ResponseChanges, "moved", moved):
                return super().solve_with_sensitivities(*given, **how)


class TestPrescribedValuesThatStay(Law):
    """Prescribed values do not change with the unknowns."""

    caught_by = "test_sensitivities_are_limits_of_differences"
    slow = True

    class solver(Altered):
        def solve_with_sensitivities(self, *given, **how):
            def loads(self, time):
                return [replace(each, values=0.0 * each.values) for each in LOADS(self, time)]

            with patch.object(Directions, "loads", loads):
                return super().solve_with_sensitivities(*given, **how)


class TestDrainsMoreWithSensitivities(Law):
    """More drains where derivatives are wanted."""

    caught_by = "test_a_run_with_sensitivities_is_the_run_without"
    slow = True

    class solver(Altered):
        def solve_with_sensitivities(self, prepared, *given, **how):
            solution, found = super().solve_with_sensitivities(prepared, *given, **how)
            return with_history(solution, drained=lambda values: 1.001 * values), found


class TestGradientsOfTheLastStepAlone(Law):
    """A pass backwards forgets what a step has taken over from the one before."""

    caught_by = "test_gradients_are_sums_of_sensitivities"
    slow = True

    class solver(Altered):
        def solve_with_gradients(self, *given, **how):
            def nothing(self, weights):
                return MemoryWeights.zeros(len(weights.storage))

            with patch.object(UnitDerivatives, "of_memory", nothing):
                return super().solve_with_gradients(*given, **how)


class TestHeaveOfNothing(Law):
    """The heave has no derivatives, as if it were always zero."""

    caught_by = "test_sensitivities_are_limits_of_differences"
    slow = True

    class solver(Altered):
        def solve_with_sensitivities(self, *given, **how):
            solution, found = super().solve_with_sensitivities(*given, **how)
            return solution, replace(found, heave=0.0 * found.heave)


class TestProfilesOneStepLate(Law):
    """The derivatives of the profiles are those of the state before each."""

    caught_by = "test_sensitivities_of_profiles_are_those_of_probes"
    slow = True

    class solver(Altered):
        def solve_with_sensitivities(self, *given, **how):
            solution, found = super().solve_with_sensitivities(*given, **how)
            if found.profiles is None:
                return solution, found
            return solution, replace(found, profiles=np.roll(found.profiles, 1, axis=0))
