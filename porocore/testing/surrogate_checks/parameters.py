"""Checks of surrogates of cells with parameters, or their refusal: slopes, missing ones, order, range, rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, MacroState
from porocore.testing.expect import (
    RESPONSES,
    STEPS,
    central_difference,
    holds,
    near,
    refused,
    require,
    states_text,
)
from porocore.testing.surrogate_checks.training import Fitting
from porocore.testing.synthetic.porous_family import INPUTS, PARAMETERS, porous_training_set, respond

NAMES = tuple(PARAMETERS)
#: The same inputs with the parameters in the other order.
SWAPPED = InputSpace.from_ranges(
    dict(zip(INPUTS.names[:-2], zip(INPUTS.lower, INPUTS.upper, strict=True), strict=False)),
    dict(reversed(PARAMETERS.items())),
)


class Parameters(Fitting):
    """Part of :class:`porocore.testing.surrogate_checks.base.SurrogateSuite`, for one that ``learns_parameters``.

    The family is that of :mod:`porocore.testing.synthetic.porous_family`. No study asks another one for it.
    """

    @classmethod
    def family_data(cls, inputs: InputSpace = INPUTS) -> TrainingSet:
        """Training states of the made-up family."""
        return porous_training_set(40, seed=1, inputs=inputs)

    @pytest.fixture(scope="class")
    @classmethod
    def of_family(cls) -> Surrogate:
        """The surrogate of the family; the check is skipped where it learns none."""
        surrogate = cls.make_surrogate()
        cls.needs(surrogate.learns_parameters, "this surrogate learns no cells with parameters")
        return surrogate.fit(cls.family_data(), seed=cls.seed)

    def test_a_cell_with_parameters_is_learned(self, of_family: Surrogate) -> None:
        """The inputs of the trained surrogate have the parameters."""
        found = of_family.inputs.parameters
        holds(found == NAMES, "trained on the family", f"inputs with the parameters {NAMES}", found)

    def test_learns_every_member(self, of_family: Surrogate) -> None:
        """Unseen states of unseen members are predicted within the declared accuracy."""
        unseen = porous_training_set(200, seed=2)
        predicted = of_family.predict(unseen.states, tangent=False)
        for name in RESPONSES:
            values, truth = getattr(predicted, name), getattr(unseen.responses, name)
            if values is not None:
                values, truth = _sampled(name, values), _sampled(name, truth)
                error = np.sqrt(((values - truth) ** 2).mean(axis=0)).max()
                allowed = self.accuracy(of_family) * np.ptp(truth, axis=0).max()
                state = f"{len(values)} unseen states"
                holds(error <= allowed, state, f"an error of {name} of at most {allowed:.2e}", f"{error:.2e}")

    def test_slopes_by_parameters_match_differences(self, of_family: Surrogate) -> None:
        """Derivatives by the parameters match differences of the predictions, sheared states included."""
        states = porous_training_set(12, seed=3).states
        shear = 0.02 * np.random.default_rng(4).uniform(-1, 1, states.grad_u.shape)
        states = replace(states, grad_u=states.grad_u + shear)
        slopes = of_family.slopes(states)
        predicted = of_family.predict(states, tangent=False)
        for name in (*RESPONSES, "conductivity"):
            if getattr(predicted, name) is None:
                continue
            slope = require(f"slopes of {name}", getattr(slopes, name), states_text(states))
            shape = (*getattr(predicted, name).shape, len(NAMES))
            holds(slope.shape == shape, states_text(states), f"d{name}/dθ of shape {shape}", slope.shape)
            for k, parameter in enumerate(NAMES):
                h = 1e-3 * INPUTS.parameter_ranges[k].mean()
                ends = [of_family.predict(_moved(states, k, i * h), tangent=False) for i in STEPS]
                difference = central_difference((getattr(end, name) for end in ends), h)
                within = 1e-6 * max(float(np.abs(difference).max()), 1e-3)
                near(f"d{name}/d{parameter}", slope[..., k], difference, states_text(states), within=within)

    def test_missing_parameters_are_refused(self, of_family: Surrogate) -> None:
        """States without parameters, or with some of them, are refused by name, in predictions and in slopes."""
        states = porous_training_set(4, seed=3).states
        for count in (0, 1, 3):
            values = None if not count else np.full((len(states), count), 0.25)
            for ask in (of_family.predict, of_family.slopes):
                with refused(ConfigurationError, state=f"{count} of {len(NAMES)} parameters", naming=NAMES):
                    ask(states.with_parameters(values))

    def test_the_order_of_the_parameters_is_that_of_the_inputs(self, of_family: Surrogate) -> None:
        """Trained with the parameters in the other order it answers the same, its slopes in that order."""
        other = self.make_surrogate().fit(self.family_data(SWAPPED), seed=self.seed)
        unseen = porous_training_set(50, seed=2)
        assert unseen.states.parameters is not None
        swapped = replace(unseen.states, parameters=unseen.states.parameters[:, ::-1].copy())
        found = other.predict(swapped, tangent=False)
        slopes, truth = other.slopes(swapped), require("slopes", unseen.responses.slopes, "the family")
        for name in ("potential", "fluid_volume"):
            values, known = getattr(found, name), getattr(unseen.responses, name)
            if values is None:
                continue
            share = 10 * self.accuracy(of_family)
            near(name, values, known, "in the other order", within=share * float(np.ptp(known)))
            known = getattr(truth, name)[:, ::-1]
            for k, parameter in enumerate(SWAPPED.parameters):
                slope = require(f"slopes of {name}", getattr(slopes, name), "in the other order")[:, k]
                within = 10 * share * float(np.ptp(known[:, k]))
                near(f"d{name}/d{parameter}", slope, known[:, k], "in the other order", within=within)

    def test_parameters_out_of_range_are_flagged(self, of_family: Surrogate) -> None:
        """Members beyond the sampled ranges are flagged, and members within are not."""
        inside = INPUTS.parameter_ranges.mean(axis=1)
        states = INPUTS.scatter(np.array([[-0.04, 0.05, *inside]]))
        low, high = INPUTS.parameter_ranges.T
        for k, parameter in enumerate(NAMES):
            for end, value in (
                ("below", low[k] - 0.3 * (high - low)[k]),
                ("above", high[k] + 0.3 * (high - low)[k]),
            ):
                theta = inside.copy()
                theta[k] = value
                asked = of_family.predict(states.with_parameters(theta), tangent=False).doubt
                flagged = bool(require("doubt", asked, f"{parameter} {end} its range")[0])
                holds(flagged, f"{parameter} = {value:.4g}, {end} its range", "a flag", "none")
        asked = of_family.predict(states, tangent=False).doubt
        flagged = bool(require("doubt", asked, "the middle of the ranges")[0])
        holds(not flagged, "the middle of the ranges", "no flag", "one")

    def test_every_member_is_exact_at_rest(self, of_family: Surrogate) -> None:
        """No stress, and derivatives within 1e-4, for members between the solved ones; if it is ``exact_at_rest``."""
        self.needs(type(of_family).exact_at_rest, "this surrogate is not exact at rest")
        low, high = INPUTS.parameter_ranges.T
        theta = low + (high - low) * np.random.default_rng(7).random((30, len(NAMES)))
        rest = MacroState.zeros(30).with_parameters(theta)
        found, truth = of_family.predict(rest), respond(rest)
        state = "undeformed members between the solved ones"
        assert truth.tangent is not None
        tangent = require("derivatives", found.tangent, state)
        if found.stress is not None:
            near("stress", found.stress, 0.0, state, within=1e-10)
        for name, known in vars(truth.tangent).items():
            slope = getattr(tangent, name)
            if slope is not None and known is not None:
                near(name, slope, known, state, within=1e-4 * float(np.abs(known).max()))

    def test_a_saved_family_is_the_same(self, of_family: Surrogate, tmp_path: Path) -> None:
        """Loaded from its file it gives the same predictions and slopes, for the same parameters."""
        path = tmp_path / "family.h5"
        of_family.save(path)
        loaded = type(of_family).load(path)
        holds(loaded.inputs == of_family.inputs, "loaded", f"{of_family.inputs}", loaded.inputs)
        states = porous_training_set(10, seed=3).states
        near("potential", _potential(loaded, states), _potential(of_family, states), "loaded", within=1e-13)
        found, known = loaded.slopes(states), of_family.slopes(states)
        for name in RESPONSES:
            if getattr(known, name) is not None:
                near(f"slopes of {name}", getattr(found, name), getattr(known, name), "loaded", within=1e-12)


def _potential(surrogate: Surrogate, states: MacroState) -> Array:
    response = surrogate.predict(states, tangent=False)
    found: Array = response.mean_grad if response.potential is None else response.potential
    return found


def _sampled(name: str, values: Array) -> Array:
    """The component of a stress that works on the sampled inputs, others as they are."""
    return values[:, 1, 1] if name == "stress" else values


def _moved(states: MacroState, k: int, step: float) -> MacroState:
    """The states with one parameter moved."""
    assert states.parameters is not None
    theta = states.parameters.copy()
    theta[:, k] += step
    return replace(states, parameters=theta)
