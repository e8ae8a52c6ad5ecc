"""Surrogates that break one law of what they answer each; the class attribute says which."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.testing.wrong.polynomials import Altered, Law, with_slopes


class TestFine(Law):
    caught_by = ""


class TestFlatDerivatives(Law):
    caught_by = "test_shapes"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_p=lambda values: values.reshape(-1, 9))


class TestLearnsNothing(Law):
    caught_by = "test_learns_the_map"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, mean_grad=0 * response.mean_grad)


class TestWrongSlopes(Law):
    caught_by = "test_learns_the_derivatives"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, fluid_volume_p=lambda values: 0.9 * values)


class TestWrongSign(Law):
    caught_by = "test_derivatives_match_differences"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, mean_grad_p=lambda values: -values)


class TestRowsKnowEachOther(Law):
    caught_by = "test_rows_do_not_depend_on_the_batch_or_its_order"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, potential=response.potential + 1e-6 * len(states))


class TestValuesDependOnDerivatives(Law):
    caught_by = "test_derivatives_only_where_they_are_wanted"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-9 * (response.tangent is None))


class TestChangesStates(Law):
    caught_by = "test_inputs_are_not_changed"

    class surrogate(Altered):
        def alter(self, response, states):
            states.grad_u[:] *= 1.01
            return response


class TestChangesItsTrainingSet(Law):
    caught_by = "test_inputs_are_not_changed"

    class surrogate(Altered):
        def fit(self, data, **how):
            super().fit(data, **how)
            data.responses.stress[:] *= 2
            return self


class TestProvidesLess(Law):
    caught_by = "test_it_provides_what_it_says"

    class surrogate(Altered):
        provides = ("mean_grad", "stress", "conductivity")


class TestRestIsNotExact(Law):
    caught_by = "test_reference_state_is_exact"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, fluid_volume=response.fluid_volume + 1e-6)


class TestNeverOutside(Law):
    caught_by = "test_outside_is_flagged"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, doubt=np.zeros(len(states), np.int64))


class TestSwallowsOptions(Law):
    caught_by = "test_invalid_options_are_refused"

    class surrogate(Altered):
        def __init__(self, degree=None, model=None, **ignored):
            super().__init__(degree=degree)


class TestNoise(Law):
    """Of 1e-13, which every tolerance bears."""

    caught_by = "test_two_calls_give_the_same_to_the_last_bit"

    class surrogate(Altered):
        noise = np.random.default_rng(0)

        def alter(self, response, states):
            return replace(response, mean_grad=response.mean_grad * (1 + 1e-13 * self.noise.random()))


class TestPromisesTooMuch(Law):
    """It declares an error that it does not keep."""

    caught_by = "test_learns_the_map"

    class surrogate(Altered):
        expected_error = 1e-9


# ---- a training that can be resumed ---------------------------------------------------------------


class TestNoFluidVolume(Law):
    caught_by = "test_it_provides_a_potential"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, fluid_volume=None)


class TestEnergyAtRest(Law):
    caught_by = "test_rest_is_free_of_energy_and_stress"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, potential=response.potential + 1e-9)


class TestSkewTangent(Law):
    caught_by = "test_the_tangent_is_symmetric"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_grad_u=lambda A: A + 1e-6 * np.triu(np.ones((3, 3))))


class TestNotReciprocal(Law):
    caught_by = "test_reciprocity"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_p=lambda values: 1.001 * values)


class TestNotObjective(Law):
    caught_by = "test_objectivity"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-3 * states.grad_u)


class TestMakesEnergy(Law):
    caught_by = "test_a_closed_cycle_does_no_work"

    class surrogate(Altered):
        def alter(self, response, states):
            stress = response.stress.copy()
            stress[:, 0, 1] += 0.1 * states.grad_u[:, 0, 0]
            return replace(response, stress=stress)
