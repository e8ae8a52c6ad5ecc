"""Surrogates of cells with parameters that break one law each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.testing.wrong.polynomials import Altered, Law


class TestFine(Law):
    caught_by = ""


class TestNamesInReverse(Law):
    """It names the parameters in the reverse order."""

    caught_by = "test_a_cell_with_parameters_is_learned"
    slow = True

    class surrogate(Altered):
        def fit(self, data, **how):
            super().fit(data, **how)
            last = self.inputs.parameters[::-1]
            names = (*self.inputs.names[: -len(last)], *last)
            self.inputs = replace(self.inputs, names=names, parameters=last)
            return self


class TestOneMember(Law):
    """Every member responds as that in the middle."""

    caught_by = "test_learns_every_member"

    class surrogate(Altered):
        def predict(self, states, *, tangent=True):
            middle = self.inputs.parameter_ranges.mean(axis=1)
            return super().predict(states.with_parameters(middle), tangent=tangent)


class TestSlopesPerRange(Law):
    """Derivatives by the parameters divided by their ranges."""

    caught_by = "test_slopes_by_parameters_match_differences"

    class surrogate(Altered):
        def slopes(self, states):
            found = super().slopes(states)
            low, high = self.inputs.parameter_ranges.T
            return replace(found, potential=found.potential * (high - low))


class TestFillsInParameters(Law):
    """Missing parameters are the middles of their ranges."""

    caught_by = "test_missing_parameters_are_refused"

    class surrogate(Altered):
        def predict(self, states, *, tangent=True):
            if states.parameters is None:
                states = states.with_parameters(self.inputs.parameter_ranges.mean(axis=1))
            return super().predict(states, tangent=tangent)


class TestOrderOfNames(Law):
    """Slopes in the order of the alphabet."""

    caught_by = "test_the_order_of_the_parameters_is_that_of_the_inputs"
    slow = True

    class surrogate(Altered):
        def slopes(self, states):
            found = super().slopes(states)
            order = np.argsort(self.inputs.parameters)[::-1]
            return replace(
                found, potential=found.potential[:, order], fluid_volume=found.fluid_volume[:, order]
            )


class TestTakesAnyParameters(Law):
    """Flags look at H and p only."""

    caught_by = "test_parameters_out_of_range_are_flagged"

    class surrogate(Altered):
        def predict(self, states, *, tangent=True):
            low, high = self.inputs.parameter_ranges.T
            within = states.with_parameters(np.clip(states.parameters, low, high))
            found = super().predict(states, tangent=tangent)
            flags = super().predict(within, tangent=False).doubt
            return replace(found, doubt=flags)


class TestRestOfTheMiddle(Law):
    """Derivatives at rest of the member in the middle."""

    caught_by = "test_every_member_is_exact_at_rest"

    class surrogate(Altered):
        def predict(self, states, *, tangent=True):
            found = super().predict(states, tangent=tangent)
            if not tangent or states.grad_u.any():
                return found
            middle = states.with_parameters(self.inputs.parameter_ranges.mean(axis=1))
            return replace(found, tangent=super().predict(middle, tangent=True).tangent)


class TestForgetsTheKinds(Law):
    """Loaded, the slopes of the first parameter are those of the second."""

    caught_by = "test_a_saved_family_is_the_same"

    class surrogate(Altered):
        loaded = False

        @classmethod
        def load(cls, path):
            found = super().load(path)
            found.loaded = True
            return found

        def slopes(self, states):
            found = super().slopes(states)
            return replace(found, stress=found.stress[..., ::-1]) if self.loaded else found
