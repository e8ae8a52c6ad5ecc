"""Macro solvers that break one law of histories each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.testing.synthetic.response import AlteredLaw
from tests.testing.wrong.skfem_macro import Altered, Elements, Law, Loaded, with_fields, with_history


class Flows(Elements):
    """With the flux times a factor, and its derivatives too."""

    factor = 1.0

    def contributions(self, response):
        return super().contributions(replace(response, flux=self.factor * response.flux))

    def system(self, tangent, dt, follower=None):
        slopes = {
            f"flux_{by}": self.factor * getattr(tangent, f"flux_{by}") for by in ("grad_u", "p", "grad_p")
        }
        return super().system(replace(tangent, **slopes), dt, follower)


class TestFine(Law):
    caught_by = ""


class TestFirstOrderInSpace(Law):
    """A flux that is too large by a share of the element's size."""

    caught_by = "test_pressure_converges_with_the_square_of_the_element_size"
    slow = True

    class elements(Flows):
        @property
        def factor(self):
            return 1 + 0.1 / len(self.elements)


class TestOtherLengthOfTheStep(Law):
    caught_by = "test_time_steps_converge_with_order_one"
    slow = True

    class elements(Flows):
        factor = 1.02


class TestAbsoluteTolerance(Law):
    """What is small is taken for nothing."""

    caught_by = "test_a_small_load_gives_linear_poroelasticity"
    slow = True

    class elements(Elements):
        def residual(self, response, dt, loads, x=None):
            found = super().residual(response, dt, loads, x)
            return replace(found, values=np.where(np.abs(found.values) < 1e-7, 0.0, found.values))


class TestWeightThatNobodyAskedFor(Law):
    caught_by = "test_axial_stress_is_uniform"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            down = (np.arange(len(loads.external)) % 3 == 1) & self.is_force
            return replace(loads, external=loads.external + 1e-6 * down)


class TestLoadsTwice(Law):
    caught_by = "test_steady_state_is_the_drained_uniaxial_one"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            return replace(loads, external=2 * loads.external)


class TestSettlesUpwards(Law):
    caught_by = "test_histories_are_what_they_say"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            return with_history(solution, settlement=lambda values: -values)


class TestConductivityAtRest(Law):
    """In the profiles."""

    caught_by = "test_histories_are_what_they_say"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            return with_fields(solution, conductivity=lambda K: np.broadcast_to(1.94 * np.eye(3), K.shape))


class TestLosesFluid(Law):
    caught_by = "test_fluid_is_conserved"
    slow = True

    class elements(Elements):
        def contributions(self, response):
            forces, stored, moved = super().contributions(response)
            return forces, 0.9 * stored, moved


class TestFlagsAllWhereAnyIsOutside(Law):
    caught_by = "test_share_outside_the_trained_range_is_a_volume"
    slow = True

    class solver(Altered):
        def law(self, law):
            return AlteredLaw(
                law,
                lambda r, states, memory: replace(
                    r,
                    doubt=np.full_like(r.doubt, r.flagged.any()),
                ),
            )


class TestNoFlags(Law):
    caught_by = "test_share_outside_the_trained_range_is_a_volume"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            return with_history(solution, flagged=np.zeros_like)
