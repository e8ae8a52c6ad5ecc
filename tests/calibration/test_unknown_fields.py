"""Unknowns that are a field: the control values of a profile along an axis of the body, on a made-up law."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.minimum import LinearPrecision
from porocore.commands.calibration.problem import CurveData, Misfit
from porocore.commands.calibration.settings import FitSettings
from porocore.core.console import Console
from porocore.macro.laws.composed import BoundLaw
from tests.helpers.curve_experiment import ACCURACY, MACRO, UNKNOWNS, law, model_of, planned, starts

pytest.importorskip("skfem")

GRADED: dict[str, Any] = {
    "radius": {
        "lower": 0.15,
        "upper": 0.3,
        "field": {"along": "y", "at": [0.0, 0.6, 1.5], "start": [0.2, 0.24, 0.22]},
    },
    "poisson_ratio": UNKNOWNS["poisson_ratio"],
}


def test_slopes_by_control_values_of_a_field_are_limits_of_differences() -> None:
    plan = planned(GRADED)
    model, at = model_of(plan), starts(plan)
    assert [each.unknown.name for each in plan.unknowns] == [
        *(f"radius[{i}]" for i in range(3)),
        "poisson_ratio",
    ]
    found, step = model.curves(at), 2e-5 * np.array([1.0, -0.6, 0.7, 0.0])
    wanted = (model.curves(at + step).values - model.curves(at - step).values) / 2
    assert np.abs(found.slopes @ step - wanted).max() <= ACCURACY * np.abs(wanted).max()


def test_equal_control_values_are_one_value_of_the_whole_body() -> None:
    plan, plain = planned(GRADED), planned({name: UNKNOWNS[name] for name in GRADED})
    graded, whole = (
        model_of(plan).curves(np.array([*[0.21] * 3, 0.33])),
        model_of(plain).curves(np.array([0.21, 0.33])),
    )
    np.testing.assert_allclose(graded.values, whole.values, rtol=1e-10, atol=1e-14)
    by_radius = graded.slopes[:, :3].sum(axis=1)
    np.testing.assert_allclose(by_radius, whole.slopes[:, 0], rtol=1e-9, atol=1e-9 * np.abs(by_radius).max())


@pytest.mark.slow
def test_a_graded_radius_is_found_again_from_curves_at_several_depths() -> None:
    """A twin experiment: four control values over the depth from settlement, displacements and pressures."""
    wide, depths = {"deviation": 1e-4, "times": {"first": 0.05, "last": 2.0, "count": 6}}, (0.3, 0.7, 1.1)
    curves: dict[str, Any] = {"settlement": {"quantity": "settlement", **wide}}
    for i in range(len(depths)):
        curves[f"move {i}"] = {"quantity": "displacement", "probe": f"at {i}", "component": 2, **wide}
        curves[f"pressure {i}"] = {"quantity": "pressure", "probe": f"at {i}", **wide}
    truth = [0.18, 0.2, 0.24, 0.27]
    field = {"along": "y", "at": [0.0, 0.5, 1.0, 1.5], "start": truth}
    unknowns = {"radius": {"lower": 0.15, "upper": 0.3, "field": field}}
    macro = {
        **MACRO,
        "body": {"kind": "box", "elements": [1, 4, 1], "size": [0.5, 1.5, 0.5]},
        "probes": {f"at {i}": [0.2, depth, 0.3] for i, depth in enumerate(depths)},
        "time": {"end": 2.0, "step": 0.4, "ramp_increments": 1, "ramp_step": 0.05, "profiles": []},
    }
    plan = planned(unknowns, macro=macro, calibration={"unknowns": unknowns, "observations": curves})
    model = ExperimentModel(plan.experiments[0], plan.unknowns, BoundLaw(law(), {"poisson_ratio": 0.33}))
    exact = model.curves(np.array(truth)).values
    made = exact + 1e-4 * np.random.default_rng(1).normal(size=len(exact))
    data = CurveData(made, np.full(len(made), 1e-4), np.zeros(len(made), int), np.zeros(len(made)), ("all",))
    misfit = Misfit(StudiesModel([each.unknown for each in plan.unknowns], [model]), data)
    found = fit(misfit, FitSettings(starts=1), Console(StringIO()), [np.full(4, 0.22)])
    deviations = LinearPrecision.from_jacobian(found.best.jacobian).deviations
    assert found.converged
    assert deviations.max() < 0.01
    assert (np.abs(found.best.coordinates - truth) < 3 * deviations).all()


def test_first_control_values_are_those_of_the_study() -> None:
    """A formula of the depth, read at the control places."""
    bare = {"lower": 0.15, "upper": 0.3, "field": {"along": "y", "at": [0, 0.6, 1.5]}}
    plan = planned({"radius": bare}, macro={**MACRO, "fields": {"radius": "0.2 + 0.04*y"}})
    np.testing.assert_allclose(starts(plan), [0.2, 0.224, 0.26], rtol=1e-12)
