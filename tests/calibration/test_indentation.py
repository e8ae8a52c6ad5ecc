"""Indentations in calibrations: curves of an indenter, its numbers as unknowns, messages; on a made-up law."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import Misfit
from porocore.core.console import Console
from porocore.errors import ConfigurationError
from tests.helpers.curve_experiment import ACCURACY, CURVE, STUDY, model_of, planned, starts

pytest.importorskip("skfem")

BALL = {
    "shape": {"kind": "sphere", "radius": 0.8},
    "place": [0, 1, 0],
    "surfaces": ["y+"],
    "under": "sealed",
    "outside": "drained",
    "penalty": 200,
}
FLAT: dict[str, Any] = {
    "body": {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": [4, 2], "grading": [3, 0.5]},
    "boundary": {"y-": {"displacement": [0, 0, 0]}, "side": {"displacement": [0, 0, 0]}},
    "time": {"end": 1.0, "step": 0.8, "ramp_increments": 2, "ramp_step": 0.1, "profiles": []},
    "newton": {"tolerance": 1e-13},
    "loads": [1.0],
}
CREEP = {**BALL, "force": 0.002}
PRESSED = {**BALL, "displacement": {"ramp": 0.06, "until": 0.2}}
SOLID: dict[str, Any] = {
    "radius": {"lower": 0.15, "upper": 0.3, "start": 0.21},
    "poisson_ratio": {"lower": 0.25, "upper": 0.4, "start": 0.33},
    "modulus": {"lower": 0.5, "upper": 2, "start": 1.3},
    "viscosity": {"lower": 0.3, "upper": 3, "start": 0.8},
    "pore": {"lower": 0.5, "upper": 2, "start": 1.2},
    "load": {"lower": 0.5, "upper": 2, "start": 0.9},
}
OF_BALL: dict[str, Any] = {
    "ball": {"of": "contact.ball.radius", "lower": 0.5, "upper": 1.2, "start": 0.7},
    "contact.ball.offset": {"lower": -0.02, "upper": 0, "start": -0.004},
}
OBSERVED = {
    kind: {"quantity": kind, "indenter": "ball", **CURVE} for kind in ("contact_radius", "contact_area")
}
FORCE = {"quantity": "force", "indenter": "ball", **CURVE}
MOVE = {"quantity": "displacement", "indenter": "ball", **CURVE}
#: Indenter, name of what is given of it with bounds, and what is measured.
BY = {
    "displacement": (PRESSED, "contact.ball.displacement.ramp", (0.03, 0.1, 0.055), {"force": FORCE}),
    "force": (CREEP, "contact.ball.force", (0.001, 0.005, 0.0025), {"move": MOVE}),
}


#: Half width of differences, as a share of the bounds.
STEP = 1e-6


def indentation(by: str, **macro: Any) -> CalibrationPlan:
    ball, name, (lower, upper, start), observed = BY[by]
    given = {name: {"lower": lower, "upper": upper, "start": start}}
    return planned(
        {},
        macro={**FLAT, "contact": {"ball": ball}, **macro},
        calibration={"unknowns": {**SOLID, **OF_BALL, **given}, "observations": {**observed, **OBSERVED}},
    )


@pytest.fixture(scope="module", params=BY)
def case(request: pytest.FixtureRequest) -> tuple[CalibrationPlan, ExperimentModel]:
    plan = indentation(request.param)
    return plan, model_of(plan)


def test_slopes_are_limits_of_differences(case: tuple[CalibrationPlan, ExperimentModel]) -> None:
    """Unknowns go in three directions, in each with a share of their bounds."""
    plan, of = case
    at = starts(plan)
    found, count = of.curves(at), CURVE["times"]["count"]
    assert (found.values > 0).all()
    widths, rng = (
        np.array([u.unknown.upper - u.unknown.lower for u in plan.unknowns]),
        np.random.default_rng(0),
    )
    for direction in rng.choice([-1.0, 1.0], (3, len(at))) * widths:
        ends = [of.values(at + sign * STEP * direction) for sign in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2 * STEP)
        for rows in np.split(np.arange(len(wanted)), len(wanted) // count):
            error = np.abs(found.slopes[rows] @ direction - wanted[rows]).max()
            assert error <= ACCURACY * np.abs(wanted[rows]).max()


def test_a_pass_backwards_gives_the_same(case: tuple[CalibrationPlan, ExperimentModel]) -> None:
    plan, of = case
    at = starts(plan)
    found = of.curves(at)
    weights = np.random.default_rng(1).normal(size=len(found.values)) / np.abs(found.values)
    values, gradient = of.gradient(at, lambda _: weights)
    np.testing.assert_array_equal(values, found.values)
    wanted = weights @ found.slopes
    np.testing.assert_allclose(gradient, wanted, rtol=1e-8, atol=1e-9 * np.abs(wanted).max())


PLUG = {
    "body": {"kind": "axisymmetric", "radius": 1, "height": 0.5, "elements": [4, 1], "grading": [0.4, 1]},
    "boundary": {"y-": {"normal": 0}, "y+": {"plate": -0.1}, "side": {"pressure": 0}},
    "fields": {"poisson_ratio": 0.3},
    "time": FLAT["time"],
    "loads": [1.0],
}
FITTED: dict[str, tuple[dict[str, Any], dict[str, float], dict[str, Any]]] = {
    "plug": (
        PLUG,
        {"radius": 0.23, "modulus": 1.2, "viscosity": 1.1},
        {"settlement": {"quantity": "settlement", **CURVE}, "drained": {"quantity": "drained", **CURVE}},
    ),
    "ball": (
        {**FLAT, "contact": {"ball": PRESSED}, "fields": {"poisson_ratio": 0.3, "radius": 0.22}},
        {"modulus": 1.2, "viscosity": 1.1, "contact.ball.offset": -0.003},
        {"force": FORCE, "pressure": {"quantity": "pressure", **CURVE}, "radius": OBSERVED["contact_radius"]},
    ),
}


@pytest.mark.parametrize("name", ["plug", pytest.param("ball", marks=pytest.mark.slow)])
def test_a_fit_finds_the_truth(name: str) -> None:
    """In exact data, of a plug between plates in its meridian and of an indentation."""
    macro, truth, observed = FITTED[name]
    known = {**SOLID, **OF_BALL, "contact.ball.offset": {**OF_BALL["contact.ball.offset"], "start": -0.008}}
    section = {"unknowns": {each: known[each] for each in truth}, "observations": observed}
    plan = planned({}, macro=macro, calibration={**section, "fit": {"starts": 1}})
    experiment = model_of(plan)
    model = StudiesModel([each.unknown for each in plan.unknowns], [experiment])
    exact, at = experiment.values(np.array([*truth.values()])), 0
    curves = []
    for curve in plan.curves:
        values = exact[at : at + len(curve)]
        curves.append(replace(curve, measured=values, spread=0.01 * np.abs(values).max()))
        at += len(curve)
    found = fit(Misfit(model, curve_data(curves)), plan.fit, Console(io.StringIO()))
    values = [one.value(x) for one, x in zip(model.unknowns, found.best.coordinates, strict=True)]
    np.testing.assert_allclose(values, [*truth.values()], rtol=1e-4)


BOUNDS = {"lower": 0.5, "upper": 1.2}
PLANE = {**PRESSED, "shape": {"kind": "plane"}}
PUNCH = {**PRESSED, "shape": {"kind": "punch", "radius": 0.8, "edge": 0.6}}
REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any], str]] = {
    "no indenter of the name": (
        PRESSED, {}, {"force": {**FORCE, "indenter": "bal"}},
        r"observations.force.indenter: expected one with this result, got 'bal'; did you mean 'ball'",
    ),
    "force that is given": (
        CREEP, {}, {"force": FORCE},
        r"observations.force.quantity: .* macro.contact.ball.force prescribes the force of ball; fit another "
        r"quantity, such as its displacement",
    ),
    "displacement that is given": (
        PRESSED, {}, {"move": MOVE},
        r"macro.contact.ball.displacement prescribes the displacement of ball; fit another quantity, such as its force",
    ),
    "radius of a plane's contact": (
        PLANE, {}, {"radius": OBSERVED["contact_radius"]},
        r"observations.radius.quantity: expected an indenter whose contact is a circle, got the plane 'ball'; fit its "
        r"contact_area",
    ),
    "radius without an indenter": (
        PRESSED, {}, {"radius": {"quantity": "contact_radius", **CURVE}},
        r"the quantity 'contact_radius' needs 'indenter:'; add it",
    ),
    "force of an indenter with a component": (
        PRESSED, {}, {"force": {**FORCE, "component": 2}},
        r"the quantity 'force' has no 'component'; remove it",
    ),
    "settlement of an indenter": (
        PRESSED, {}, {"force": {**FORCE, "quantity": "settlement"}},
        r"the quantity 'settlement' has no 'indenter'; remove it",
    ),
    "unknown number of no indenter": (
        PRESSED, {"contact.bal.radius": BOUNDS}, {"force": FORCE},
        r"unknowns.contact.bal.radius: expected a number of the study, .*did you mean 'contact.ball.radius'",
    ),
    "radius of a plane": (
        PLANE, {"contact.ball.radius": BOUNDS}, {"force": FORCE},
        r"unknowns.contact.ball.radius: expected a number of the study",
    ),
    "radius below zero": (
        PRESSED, {"contact.ball.radius": {**BOUNDS, "lower": -1}}, {"force": FORCE},
        r"lower: expected a number above 0, as every value of 'contact.ball.radius' is, got -1",
    ),
    "radius below that of the edge": (
        PUNCH, {"contact.ball.radius": BOUNDS}, {"force": FORCE},
        r"lower: macro.contact.ball.shape: the edge is rounded by more than the radius",
    ),
    "offset into the body": (
        PRESSED, {"contact.ball.offset": {"lower": -0.1, "upper": 0.1}}, {"force": FORCE},
        r"upper: macro.contact.ball: the indenter begins 0.1 deep inside the body",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", REFUSED)
def test_what_is_refused(fault: str) -> None:
    ball, unknowns, observed, said = REFUSED[fault]
    section = {"unknowns": {"modulus": SOLID["modulus"], **unknowns}, "observations": observed}
    with pytest.raises(ConfigurationError, match=said) as refused:
        planned({}, macro={**FLAT, "contact": {"ball": ball}}, calibration=section)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (
            "force",
            "below 0, an indenter presses along its direction, so that the force of ball is never below 0",
        ),
        ("contact_radius", "below 0, but the contact radius of ball is never below 0; give 'factor: -1'"),
    ],
)
def test_values_of_the_wrong_sign_are_noted(
    kind: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("test.csv").write_text(f"time,{kind}\n0,0\n0.2,-0.01\n0.9,-0.02\n", encoding="utf-8")
    curve = {"quantity": kind, "indenter": "ball", "file": "test.csv", "deviation": 1e-3}
    section = {"unknowns": {"load": SOLID["load"]}, "observations": {"ball": curve}}
    settings = {"macro": {**FLAT, "contact": {"ball": PRESSED}}, "calibration": section}
    plan = read_plan({**STUDY, **settings})
    assert any(said in note for note in plan.notes), plan.notes
