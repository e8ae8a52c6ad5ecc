"""Curves of an experiment as functions of the unknowns: exact slopes, scaling laws, steps; on a made-up law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import porocore.commands.calibration.experiment as forward
from porocore.commands.calibration.cells import _noise, further_data
from porocore.commands.calibration.experiment import (
    ExperimentModel,
    error_of_steps,
    planned_times,
    with_fixed_steps,
)
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import CurvePrediction
from porocore.core.parallel.calls import CallProcesses
from porocore.core.parallel.memory import exactly_one_blas_thread
from porocore.errors import ConfigurationError
from porocore.macro.laws.composed import BoundLaw
from porocore.macro.problem import MacroProblem
from tests.helpers.curve_experiment import (
    ACCURACY,
    BOUNDARY,
    CURVE,
    MACRO,
    OBSERVATIONS,
    TIMES,
    UNKNOWNS,
    law,
    model_of,
    planned,
    starts,
)

pytest.importorskip("skfem")


@pytest.fixture(scope="module")
def plan() -> CalibrationPlan:
    return planned()


@pytest.fixture(scope="module")
def model(plan: CalibrationPlan) -> ExperimentModel:
    return model_of(plan)


@pytest.mark.parametrize("name", UNKNOWNS)
def test_slopes_are_limits_of_differences(name: str, plan: CalibrationPlan, model: ExperimentModel) -> None:
    j, at = [*UNKNOWNS].index(name), starts(plan)
    width = plan.unknowns[j].unknown.upper - plan.unknowns[j].unknown.lower
    step = 1e-4 * width
    ends = [model.curves(at + sign * step * np.eye(len(at))[j]).values for sign in (1, -1)]
    found, wanted = model.curves(at), (ends[0] - ends[1]) / (2 * step)
    count = TIMES["count"]
    for k, curve in enumerate(OBSERVATIONS):
        rows = slice(k * count, (k + 1) * count)
        size = max(np.abs(wanted[rows]).max(), 1e-2 * np.abs(found.values[rows]).max() / width)
        assert np.abs(found.slopes[rows, j] - wanted[rows]).max() <= ACCURACY * size, curve


def in_units(
    modulus: str, viscosity: str, unknowns: dict[str, Any], top: dict[str, Any] | None = None, **macro: Any
) -> CalibrationPlan:
    """A study in SI units; the made-up cell conducts as much in the units of any viscosity."""
    boundary = {**BOUNDARY, "y+": top or {"traction": [0, "25 kPa", 0], "pressure": "1 kPa"}}
    times = {"first": "0.2 s", "last": "8 s", "count": 2}
    settlement = {
        "quantity": "settlement",
        "deviation": "1 um",
        "unit": "um",
        "time_unit": "s",
        "times": times,
    }
    force = {
        "quantity": "force",
        "surface": "y-",
        "deviation": "1 mN",
        "unit": "mN",
        "time_unit": "s",
        "times": times,
    }
    time = {"end": "10 s", "step": "5 s", "ramp_increments": 1, "ramp_step": "0.1 s", "profiles": []}
    return planned(
        {},
        cell={"viscosity": viscosity},
        scales={"length": "1 mm", "pore": "20 nm", "viscosity": viscosity, "modulus": modulus},
        macro={**MACRO, "boundary": boundary, "time": time, **macro},
        calibration={"unknowns": unknowns, "observations": {"settlement": settlement, "force": force}},
    )


def test_a_fitted_modulus_and_viscosity_are_those_of_a_study_with_other_scales() -> None:
    """The curves of a study with 0.5 MPa and 1 mPa s at 0.8 MPa and 2 mPa s, by its texts with units in both."""
    unknowns = {
        "radius": {"lower": 0.15, "upper": 0.3},
        "poisson_ratio": {"lower": 0.25, "upper": 0.4},
        "modulus": {"lower": "0.1 MPa", "upper": "2 MPa", "start": "0.5 MPa"},
        "viscosity": {"lower": "0.1 mPa s", "upper": "9 mPa s"},
    }
    fitted = in_units("0.5 MPa", "1 mPa s", unknowns)
    other = in_units("0.8 MPa", "2 mPa s", {name: unknowns[name] for name in ("radius", "poisson_ratio")})
    at = np.array([0.22, 0.3, 0.8, 2.0])
    mine = model_of(fitted).curves(at).values
    wanted = model_of(other).curves(at[:2]).values
    np.testing.assert_allclose(mine, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    before = model_of(fitted).curves(np.array([0.22, 0.3, 0.5, 1.0])).values
    assert np.abs(mine / before - 1)[:2].min() > 0.05


TOP = {
    "traction": [0, {"table": [["0 s", 0], ["1 s", "25 kPa"], ["5 s", "10 kPa"]]}, 0],
    "pressure": {"ramp": "2 kPa", "until": "3 s"},
}
INSIDE = {"initial": {"pressure": "3 kPa"}, "body_force": [0, "5 kN/m^3", 0]}


def test_functions_of_time_initial_pressure_and_body_force_are_scaled_too() -> None:
    unknowns = {
        "radius": {"lower": 0.15, "upper": 0.3},
        "poisson_ratio": {"lower": 0.25, "upper": 0.4},
        "modulus": {"lower": "0.1 MPa", "upper": "2 MPa"},
        "viscosity": {"lower": "0.1 mPa s", "upper": "9 mPa s"},
    }
    fitted = in_units("0.5 MPa", "1 mPa s", unknowns, TOP, **INSIDE)
    some = {name: unknowns[name] for name in ("radius", "poisson_ratio")}
    other = in_units("0.8 MPa", "2 mPa s", some, TOP, **INSIDE)
    at = np.array([0.22, 0.3, 0.8, 2.0])
    wanted = model_of(other).curves(at[:2]).values
    np.testing.assert_allclose(
        model_of(fitted).curves(at).values, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max()
    )


def test_slopes_by_prescribed_values_with_units_are_limits_of_differences() -> None:
    """The size of a ramp and a component of a traction, while the modulus is another than that of the study."""
    unknowns = {
        "radius": {"lower": 0.15, "upper": 0.3, "prior": {"mean": 0.22, "deviation": 0.01}},
        "poisson_ratio": {"lower": 0.25, "upper": 0.4},
        "modulus": {"lower": "0.1 MPa", "upper": "2 MPa"},
        "boundary.y+.pressure.ramp": {"lower": "1 kPa", "upper": "4 kPa"},
        "boundary.y+.traction.y": {"lower": "10 kPa", "upper": "50 kPa"},
    }
    model = model_of(in_units("0.5 MPa", "1 mPa s", unknowns, {**TOP, "traction": [0, "25 kPa", 0]}))
    at = np.array([0.22, 0.3, 0.8, 2.0, 25.0])
    found = model.curves(at)
    for j in (2, 3, 4):
        step = 1e-4 * at[j] * np.eye(len(at))[j]
        ends = [model.curves(at + sign * step).values for sign in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2e-4 * at[j])
        for rows in (slice(0, 2), slice(2, 4)):
            size = np.abs(wanted[rows]).max()
            # The force bears the load, whatever the modulus is.
            size = max(size, 1e-2 * np.abs(found.values[rows]).max() / at[j])
            assert np.abs(found.slopes[rows, j] - wanted[rows]).max() <= ACCURACY * size, (j, rows)


def test_a_symmetric_part_gives_the_slopes_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of a box under a plate: the force below it is that on the whole plate."""
    few = {"deviation": 0.01, "times": {"first": 0.2, "last": 0.3, "count": 2}}
    curves = {
        "drained": {"quantity": "drained", **few},
        "force": {"quantity": "force", "surface": "y-", **few},
    }
    planes = {name: {"normal": 0} for name in ("x-", "y-", "z-")}
    boundary = {**planes, "x+": {"pressure": 0}, "y+": {"plate": -0.02, "pressure": 0}}
    body = {"kind": "box", "elements": [1, 1, 1], "size": [0.5, 1, 0.5], "symmetry": ["x-", "z-"]}
    unknowns = {
        **{name: UNKNOWNS[name] for name in ("radius", "poisson_ratio")},
        "boundary.y+.plate": {"lower": -0.03, "upper": -0.01},
    }
    time = {"end": 0.3, "step": 0.3, "ramp_increments": 1, "ramp_step": 0.2}
    changes = {"body": body, "boundary": boundary, "probes": {}, "loads": [1.0], "time": time}
    plan = planned(
        unknowns, macro={**MACRO, **changes}, calibration={"unknowns": unknowns, "observations": curves}
    )
    model, at = model_of(plan), starts(plan)
    found = model.curves(at)
    np.testing.assert_allclose(found.values[-1], 0.02, rtol=1e-6)
    step = 1e-4 * abs(at[2]) * np.eye(3)[2]
    ends = [model.curves(at + sign * step).values for sign in (1, -1)]
    wanted = (ends[0] - ends[1]) / (2e-4 * abs(at[2]))
    np.testing.assert_allclose(found.slopes[:, 2], wanted, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(found.slopes[2:, 2], -1, rtol=1e-6)
    back = backwards(monkeypatch, model, at)
    np.testing.assert_allclose(back.slopes, found.slopes, rtol=1e-9, atol=1e-9 * np.abs(found.slopes).max())


def backwards(monkeypatch: pytest.MonkeyPatch, model: ExperimentModel, at: np.ndarray) -> CurvePrediction:
    """Curves whose derivatives are found by a pass backwards."""
    with monkeypatch.context() as patch:
        patch.setattr(forward, "BACKWARDS", -np.inf)
        patch.setattr(forward, "body_sensitivities_of", None)
        return model.curves(at)


def test_a_pass_backwards_gives_the_same_slopes(
    plan: CalibrationPlan, model: ExperimentModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of every quantity by every unknown; modulus, viscosity and pore change the units of the run."""
    at = starts(plan)
    wanted, found = model.curves(at), backwards(monkeypatch, model, at)
    np.testing.assert_allclose(found.values, wanted.values, rtol=1e-12, atol=1e-15)
    count = TIMES["count"]
    for k, curve in enumerate(OBSERVATIONS):
        rows = slice(k * count, (k + 1) * count)
        sizes = np.abs(wanted.slopes[rows]).max(axis=0)
        apart = np.abs(found.slopes[rows] - wanted.slopes[rows]).max(axis=0)
        # A force that bears the load does not depend on the cell: that is round-off both ways.
        assert (apart <= 1e-9 * np.maximum(sizes, 1e-3 * sizes.max())).all(), curve


def test_many_control_values_of_few_data_are_gone_back_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve values on six elements, which four data and a prior tell: twelve solves a step would be too many."""
    field = {"along": "y", "at": np.linspace(0.0, 1.5, 12).tolist()}
    unknowns = {"radius": {"lower": 0.15, "upper": 0.3, "field": {**field, "smoothing": 0.05}}}
    curves = {
        name: {**OBSERVATIONS[name], "times": {**TIMES, "count": 2}} for name in ("settlement", "inflow")
    }
    body = {"kind": "box", "elements": [1, 6, 1], "size": [0.5, 1.5, 0.5]}
    plan = planned(
        unknowns, macro={**MACRO, "body": body}, calibration={"unknowns": unknowns, "observations": curves}
    )
    model = ExperimentModel(plan.experiments[0], plan.unknowns, BoundLaw(law(), {"poisson_ratio": 0.33}))
    monkeypatch.setattr(forward, "body_sensitivities_of", None)
    found = model.curves(starts(plan))
    monkeypatch.undo()
    monkeypatch.setattr(forward, "BACKWARDS", np.inf)
    wanted = model.curves(starts(plan))
    np.testing.assert_allclose(found.slopes, wanted.slopes, rtol=0, atol=1e-9 * np.abs(wanted.slopes).max())


def test_steps_meet_the_data_and_do_not_depend_on_the_unknowns(plan: CalibrationPlan) -> None:
    without = planned({name: value for name, value in UNKNOWNS.items() if name != "delay"})
    model = model_of(without)
    steps = np.array([*model.config.macro.time.profiles, model.config.macro.time.end])
    data = without.curves[0].times
    assert np.abs(steps[:, None] - data).min(axis=0).max() < 1e-12
    at = starts(without)
    found = model.solve(at * 1.01)
    body, solution = found.body, found.solution
    np.testing.assert_allclose(solution.history.time[1:] * body.scales.factor("time"), steps, rtol=1e-9)
    shifted = np.array(model_of(plan).config.macro.time.profiles)
    assert np.abs(shifted[:, None] - data).min(axis=0).max() > 1e-3


def test_planned_times_are_those_of_a_run() -> None:
    problem = MacroProblem.model_validate({key: value for key, value in MACRO.items() if key != "loads"})
    np.testing.assert_allclose(planned_times(problem), [0.2, 1.0])
    chosen: Callable[[], np.ndarray] = lambda: np.array([0.0, 0.2, 0.4, 0.7, 1.0])  # noqa: E731
    adaptive = problem.model_copy(update={"time": problem.time.model_copy(update={"tolerance": 1e-3})})
    plan = with_fixed_steps(adaptive, np.array([0.38, 0.95]), chosen)
    np.testing.assert_allclose(plan.profiles, [0.2, 0.38, 0.7, 0.95])
    assert plan.tolerance is None


def test_formulas_of_time_are_refused_where_its_scale_is_unknown() -> None:
    moving = {**BOUNDARY, "y+": {"traction": [0, {"expression": "0.05*sin(t)"}, 0], "pressure": 0}}
    changes = {"macro": {**MACRO, "boundary": moving}}
    some = {name: UNKNOWNS[name] for name in ("radius", "poisson_ratio", "modulus")}
    with pytest.raises(
        ConfigurationError, match=r"the formula '0.05\*sin\(t\)' goes by a dimensionless time"
    ):
        model_of(planned(some, **changes))
    del some["modulus"]
    model_of(planned(some, **changes))


def test_a_macro_solver_without_sensitivities_is_refused(
    plan: CalibrationPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    from porocore.macro.integration.solver import TimeSteppingMacroSolver

    monkeypatch.setattr(TimeSteppingMacroSolver, "sensitivities", False)
    with pytest.raises(
        ConfigurationError, match=r"macro\.backend: the macro solver 'skfem' gives no sensitivities"
    ):
        model_of(plan)


def test_curves_name_what_a_solution_lacks(plan: CalibrationPlan, tmp_path: Path) -> None:
    experiment = plan.experiments[0]
    curve = experiment.curves[1]
    lacking = replace(curve, series=replace(curve.series, probe="insde"))
    model = ExperimentModel(replace(experiment, curves=(lacking,)), plan.unknowns, law())
    with pytest.raises(ConfigurationError, match="did you mean 'inside'"):
        model.curves(starts(plan))


def test_further_measurements_are_those_of_the_models_that_make_them() -> None:
    some = {name: UNKNOWNS[name] for name in ("radius", "poisson_ratio", "modulus")}
    few = {**CURVE, "deviation": 0.002}
    plan = planned(
        some,
        calibration={"unknowns": some, "observations": {"settlement": {"quantity": "settlement", **few}}},
    )
    at = starts(plan)
    exact = model_of(plan).curves(at)
    experiment = plan.experiments[0]
    curve = replace(experiment.curves[0], measured=exact.values)
    plan = replace(plan, experiments=(replace(experiment, curves=(curve,)),))
    share = 0.002 / np.abs(exact.values).max()
    told: list[str] = []
    found = {each.name: each.rows for each in further_data([model_of(plan)], plan, at, tell=told.append)}
    assert "the settlement" not in found
    assert told == ["other quantities", "larger load"]
    by_coordinate = np.array([1.0, 1.0, at[2]])  # the modulus is searched in ln x
    every = model_of(planned(some, calibration={"unknowns": some, "observations": OBSERVATIONS})).curves(at)
    names, count = [*OBSERVATIONS], int(TIMES["count"])
    for name, words in {
        "largest": "the largest pore pressure",
        "drained": "the drained volume",
        "pressure": "the pore pressure of the probe 'inside'",
        "move": "the displacement 2 of the probe 'inside'",
    }.items():
        rows = slice(names.index(name) * count, (names.index(name) + 1) * count)
        wanted = every.slopes[rows] * by_coordinate / (share * np.abs(every.values[rows]).max())
        np.testing.assert_allclose(found[words], wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())
    (larger,) = (words for words in found if "times the load" in words)
    factor = float(larger.split(" under ")[1].split(" ")[0])
    other = replace(plan, experiments=(replace(plan.experiments[0], load=-factor),))
    wanted = model_of(other).curves(at)
    np.testing.assert_allclose(
        found[larger], wanted.slopes * by_coordinate / (share * np.abs(wanted.values).max()), rtol=1e-8
    )


def test_curves_of_zeros_tell_no_noise(plan: CalibrationPlan) -> None:
    """A drained surface has no pressure; a share of nothing is no deviation of other measurements."""
    (experiment,), count = plan.experiments, int(TIMES["count"])
    zeros = [replace(curve, measured=np.zeros(count)) for curve in experiment.curves[:2]]
    empty = replace(plan, experiments=(replace(experiment, curves=tuple(zeros)),))
    assert further_data([model_of(empty)], empty, starts(plan)) == []
    curves = (zeros[0], replace(zeros[1], measured=np.full(count, -0.5)))
    some = replace(plan, experiments=(replace(experiment, curves=curves),))
    assert _noise(some.experiments[0]) == pytest.approx(0.01 / 0.5)


def test_curves_that_stay_zero_under_every_load_suggest_no_larger_one() -> None:
    """A body that is pulled does not settle, however much it is pulled."""
    some = {name: UNKNOWNS[name] for name in ("radius", "poisson_ratio")}
    curves = {"settlement": {"quantity": "settlement", **CURVE}}
    boundary = {**BOUNDARY, "y+": {"traction": [0, 0.05, 0], "pressure": 0}}
    plan = planned(
        some,
        macro={**MACRO, "boundary": boundary, "loads": [1.0]},
        calibration={"unknowns": some, "observations": curves},
    )
    (experiment,), count = plan.experiments, int(TIMES["count"])
    assert not model_of(plan).curves(starts(plan)).values.any()
    measured = tuple(replace(curve, measured=np.full(count, 0.01)) for curve in experiment.curves)
    plan = replace(plan, experiments=(replace(experiment, curves=measured),))
    found = [each.name for each in further_data([model_of(plan)], plan, starts(plan))]
    assert "the drained volume" in found
    assert not [name for name in found if "times the load" in name]


def test_a_load_that_is_unknown_is_not_enlarged() -> None:
    some = {name: UNKNOWNS[name] for name in ("radius", "poisson_ratio", "load")}
    plan = planned(
        some, calibration={"unknowns": some, "observations": {"drained": {"quantity": "drained", **CURVE}}}
    )
    curve = replace(plan.curves[0], measured=np.ones(int(TIMES["count"])))
    plan = replace(plan, experiments=(replace(plan.experiments[0], name="", curves=(curve,)),))
    found = [each.name for each in further_data([model_of(plan)], plan, starts(plan))]
    assert "the settlement" in found
    assert not [name for name in found if "load" in name]
    # Another process finds the same.
    with CallProcesses(1) as processes:
        twice = further_data([model_of(plan)] * 2, plan, starts(plan), processes)
    assert [each.name for each in twice] == [*found, *found]
    with exactly_one_blas_thread():
        here = further_data([model_of(plan)], plan, starts(plan))
    for one, other in zip(twice, [*here, *here], strict=True):
        np.testing.assert_array_equal(one.rows, other.rows)


def test_halved_steps_lie_between_the_others_and_the_data_are_met(plan: CalibrationPlan) -> None:
    model = model_of(plan)
    problem = model.config.macro.problem(-1.0)
    steps, halved = (planned_times(each.config.macro.problem(-1.0)) for each in (model, model.halved(1)))
    np.testing.assert_allclose(halved[1::2], steps, rtol=1e-12)
    np.testing.assert_allclose(np.diff(halved, prepend=0.0)[::2], np.diff(halved, prepend=0.0)[1::2])
    assert len(planned_times(model.halved(3).config.macro.problem(-1.0))) == 8 * len(steps)
    assert model.config.macro.problem(-1.0) == problem


def test_curves_without_slopes_are_the_same(plan: CalibrationPlan) -> None:
    model = model_of(plan)
    np.testing.assert_allclose(model.values(starts(plan)), model.curves(starts(plan)).values, rtol=1e-12)


def test_the_error_of_steps_is_that_of_ever_shorter_ones(plan: CalibrationPlan) -> None:
    """But for the inflow, which jumps where the ramp ends, between two steps where the clock is shifted."""
    model = model_of(plan).halved(1)
    lengths = [len(curve) for curve in plan.curves]
    kept = np.repeat([curve.series.kind != "inflow" for curve in plan.curves], lengths)
    first, *others = (each.values(starts(plan))[kept] for each in (model, *map(model.halved, (1, 2, 5, 6))))
    curves, exact = [first, *others[:2]], 2 * others[3] - others[2]
    error, ones = first - exact, np.ones(len(exact))
    assert np.abs(error).max() > 1e-4
    for count, share in ((2, 0.3), (3, 0.15)):
        found = error_of_steps(curves[:count], ones)
        assert np.linalg.norm(found - error) < share * np.linalg.norm(error)


def test_the_error_of_backward_euler_is_extrapolated() -> None:
    """Of y' = −y at t = 1, with 8, 16 and 32 steps."""
    curves = [np.array([(1 + 1 / n) ** -n]) for n in (8, 16, 32)]
    error = curves[0] - np.exp(-1)
    assert error_of_steps(curves[:2], np.ones(1)) == pytest.approx(error, rel=0.06)
    assert error_of_steps(curves, np.ones(1)) == pytest.approx(error, rel=0.02)
    # Steps that are far too long tell nothing but that; the error stays finite.
    wild = error_of_steps([np.zeros(1), np.ones(1), np.full(1, 3.0)], np.ones(1))
    assert wild == pytest.approx(-3 - 2 * 0.8 / 0.2)
    assert error_of_steps([np.ones(2)] * 3, np.ones(2)).tolist() == [0.0, 0.0]
