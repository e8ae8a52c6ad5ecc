"""Measured fields: values of a film in a run, exact slopes by unknowns, clocks and cameras; on a made-up law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.calibrate import _with_points_inside
from porocore.commands.calibration.cells import _noise
from porocore.commands.calibration.clouds import (
    CAMERA_PARTS,
    FilmComponent,
    PointCloud,
    rotation,
    rotation_slopes,
)
from porocore.commands.calibration.expectations import opposite_note, scale_note
from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.minimum import LinearPrecision
from porocore.commands.calibration.observations import ObservedCurve, by_curve, curve_data
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import Misfit
from porocore.commands.calibration.settings import FitSettings
from porocore.core.console import Console
from porocore.core.files.yaml_document import YamlDocument
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.macro.laws.composed import BoundLaw
from porocore.study.config.config import RunConfig
from tests.helpers.curve_experiment import ACCURACY, MACRO, UNKNOWNS, law, model_of, planned, starts

pytest.importorskip("skfem")

FILM: dict[str, Any] = {
    "grid": [2, 4, 2],
    "times": {"first": 0.15, "last": 0.9, "count": 3},
    "quantities": ["u1", "u2", "p"],
    "deviation": 0.001,
    "pressure_deviation": 0.002,
}
CAMERA = {"unknown": [*CAMERA_PARTS], "rotation": [10, -20, 30], "offset": [0.01, -0.02, 0.01]}
#: A column that is pulled at one side, so that fields vary across it.
BENT: dict[str, Any] = {
    **MACRO,
    "boundary": {
        **MACRO["boundary"],
        "x+": {"displacement": [None, None, None], "traction": [0.01, 0, 0]},
    },
}
RADIUS = {"radius": UNKNOWNS["radius"]}
GRID: dict[str, Any] = {
    "radius": {
        "lower": 0.15,
        "upper": 0.3,
        "field": {
            "grid": {"y": [0.0, 0.5, 1.5], "x": [0.0, 0.5]},
            "start": [0.2, 0.21, 0.22, 0.24, 0.25, 0.23],
            "smoothing": 0.02,
        },
    },
    "poisson_ratio": UNKNOWNS["poisson_ratio"],
}


def filmed(film: dict[str, Any], unknowns: dict[str, Any] = UNKNOWNS, **changes: Any) -> CalibrationPlan:
    section = {"unknowns": unknowns, "points": {"film": film}}
    return planned(unknowns, **{"macro": BENT, **changes}, calibration=section)


def test_rotations_have_slopes() -> None:
    for vector in (np.array([0.3, -1.1, 0.4]), np.array([1e-6, 2e-6, 0.0])):
        R, step = rotation(vector), 1e-6
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(R @ vector, vector, atol=1e-14)
        for k, found in enumerate(rotation_slopes(vector)):
            ends = [rotation(vector + s * step * np.eye(3)[k]) for s in (1, -1)]
            np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * step), atol=1e-9)


@pytest.mark.parametrize("place", ["reference", "deformed"])
def test_slopes_of_fields_are_limits_of_differences(place: str) -> None:
    """By all kinds of unknowns along a few directions, then by the six of the camera."""
    plan = filmed({**FILM, "place": place, "camera": CAMERA})
    model, at, count = model_of(plan), starts(plan), len(UNKNOWNS)
    assert [each.unknown.name for each in plan.unknowns][count:] == [f"film.camera.{p}" for p in CAMERA_PARTS]
    at[count:] = [0.004, -0.01, 0.007, 1.0, -2.0, 3.0]
    width = np.array([each.unknown.upper - each.unknown.lower for each in plan.unknowns])
    found, draws = model.curves(at), np.random.default_rng(1)
    moves = [1e-4 * width * draws.uniform(-1, 1, len(at)), np.zeros(len(at))]
    moves[1][count:] = 1e-4 * width[count:] * [1, 1, -1, 1, -1, 1]
    for move in moves:
        wanted = (model.curves(at + move).values - model.curves(at - move).values) / 2
        for part, slopes in zip(
            by_curve(wanted, plan.curves), by_curve(found.slopes, plan.curves), strict=True
        ):
            assert np.abs(slopes @ move - part).max() <= ACCURACY * np.abs(part).max()


FLAT: dict[str, dict[str, Any]] = {
    "axisymmetric": {"kind": "axisymmetric", "radius": 0.5, "height": 1.5, "elements": [2, 3]},
    "plane strain": {"kind": "plane-strain", "size": [0.5, 1.5], "elements": [2, 3]},
}


@pytest.mark.parametrize("kind", FLAT)
def test_films_of_bodies_in_two_dimensions_have_slopes(kind: str) -> None:
    """A film of the meridian or of the section, at deformed places."""
    sides = {"y-": MACRO["boundary"]["y-"], "y+": MACRO["boundary"]["y+"]}
    if kind == "plane strain":
        sides["x-"] = {"normal": 0}
    macro = {**MACRO, "body": FLAT[kind], "boundary": sides, "probes": {}}
    plan = filmed({**FILM, "grid": [3, 4, 1], "place": "deformed"}, GRID, macro=macro)
    assert len(plan.curves[0]) == 3 * 12
    model, at = model_of(plan), starts(plan)
    move = 2e-5 * np.array([1.0, -0.6, 0.7, 0.2, -0.9, 0.5, 0.3])
    found, wanted = model.curves(at), (model.curves(at + move).values - model.curves(at - move).values) / 2
    for part, slopes in zip(by_curve(wanted, plan.curves), by_curve(found.slopes, plan.curves), strict=True):
        assert np.abs(slopes @ move - part).max() <= ACCURACY * np.abs(part).max()


def test_a_field_at_a_probe_is_the_probe() -> None:
    """The place of the probe is a point of the film."""
    film = {**FILM, "grid": [1, 1, 1], "fixed": {"x": 0.2, "y": 0.6, "z": 0.3}, "quantities": ["u2", "p"]}
    times = film["times"]
    curve = {"probe": "inside", "times": times, "deviation": 0.01}
    observations = {
        "move": {"quantity": "displacement", "component": 2, **curve},
        "pressure": {"quantity": "pressure", **curve},
    }
    section = {"unknowns": UNKNOWNS, "observations": observations, "points": {"film": film}}
    plan = planned(calibration=section)
    found = model_of(plan).curves(starts(plan))
    move, pressure, u2, p = by_curve(np.column_stack([found.values, found.slopes]), plan.curves)
    np.testing.assert_allclose(u2, move, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(p, pressure, rtol=1e-9, atol=1e-12)


def test_deformed_places_have_the_values_of_their_particles() -> None:
    """The film at the places to which the particles of another film have come has its values."""
    plan = filmed({**FILM, "quantities": ["u1", "u2", "u3", "p"]}, RADIUS)
    bound, at = BoundLaw(law(), {"poisson_ratio": 0.33}), starts(plan)
    model = ExperimentModel(plan.experiments[0], plan.unknowns, bound)
    wanted = by_curve(model.curves(at).values, plan.curves)
    cloud = plan.curves[0].series.cloud
    moved = replace(cloud, places=cloud.places + np.stack(wanted[:3], axis=1), place="deformed")
    curves = tuple(replace(curve, series=FilmComponent(moved, i)) for i, curve in enumerate(plan.curves))
    other = ExperimentModel(replace(plan.experiments[0], curves=curves), plan.unknowns, bound)
    for found, each in zip(by_curve(other.curves(at).values, curves), wanted, strict=True):
        np.testing.assert_allclose(found, each, rtol=1e-8, atol=1e-11)


@pytest.mark.parametrize("place", ["reference", "deformed"])
def test_gradients_go_back_from_the_points(place: str) -> None:
    """The gradient of half the sum of squares, by one pass back over the steps, is that of the slopes."""
    plan = filmed({**FILM, "place": place, "camera": CAMERA}, {**GRID, "delay": UNKNOWNS["delay"]})
    model, at = model_of(plan), starts(plan)
    at[-6:] = [0.004, -0.01, 0.007, 1.0, -2.0, 3.0]
    found, measured = (
        model.curves(at),
        np.random.default_rng(2).normal(scale=0.01, size=len(plan.curves) * 48),
    )
    values, gradient = model.gradient(at, lambda values: values - measured)
    np.testing.assert_allclose(values, found.values, rtol=1e-12)
    wanted = (found.values - measured) @ found.slopes
    sizes = np.abs(found.values - measured) @ np.abs(found.slopes)
    assert (np.abs(gradient - wanted) <= 1e-8 * sizes).all()


def test_slopes_by_values_on_a_grid_are_limits_of_differences() -> None:
    plan = filmed(FILM, GRID)
    assert [each.unknown.name for each in plan.unknowns] == [
        *(f"radius[{i}]" for i in range(6)),
        "poisson_ratio",
    ]
    model, at = model_of(plan), starts(plan)
    move = 2e-5 * np.array([1.0, -0.6, 0.7, 0.2, -0.9, 0.5, 0.3])
    found, wanted = model.curves(at), (model.curves(at + move).values - model.curves(at - move).values) / 2
    assert np.abs(found.slopes @ move - wanted).max() <= ACCURACY * np.abs(wanted).max()


def test_neighbours_on_a_grid_are_smoothed() -> None:
    """A prior of each difference along x, which runs fastest, and along y."""
    plan = filmed(FILM, GRID)
    unknowns = [each.unknown for each in plan.unknowns]
    assert [one.neighbours for one in unknowns[:6] if one.smoothing] == [(1,), (2,), (1, 2), (2,), (1, 2)]
    data = curve_data([replace(curve, measured=np.zeros(len(curve))) for curve in plan.curves])
    misfit = Misfit(StudiesModel(unknowns, [model_of(plan)]), data)
    offsets, rows = misfit._priors
    assert len(rows) == 3 * 1 + 2 * 2
    x = starts(plan)
    lines = x[:6].reshape(3, 2) / 0.02
    wanted = np.concatenate([np.diff(lines, axis=1).ravel(), np.diff(lines, axis=0).ravel()])
    np.testing.assert_allclose(np.sort(rows @ x - offsets), np.sort(wanted))


def test_a_component_that_shows_nothing_is_no_reason_to_doubt_its_unit() -> None:
    """Noise beside a prediction of zero: no note on its size, and no share by which further data are noisy."""
    plan = filmed(FILM, RADIUS)
    u1, u2, _ = plan.curves
    draws = np.random.default_rng(3).normal(scale=0.001, size=48)
    noise, shown = replace(u1, measured=draws), replace(u2, measured=draws - 0.05)
    assert noise.is_noise
    assert not shown.is_noise
    assert scale_note(noise, np.full(48, 1e-9), 1, 1, "at the start values") is None
    assert "check the unit" in (scale_note(shown, np.full(48, 1e-9), 1, 1, "at the start values") or "")
    experiment = replace(plan.experiments[0], curves=(noise, shown))
    assert _noise(experiment) == pytest.approx(0.001 / np.abs(shown.measured).max())


def test_fields_that_run_against_the_study_are_noted() -> None:
    """Signs and sizes of films are held against the values of the study at the same places and times."""
    plan = filmed(FILM)
    predicted = by_curve(model_of(plan).curves(starts(plan)).values, plan.curves)
    _, u2, p = plan.curves
    for curve, values, what in ((u2, predicted[1], "'camera.rotation:'"), (p, predicted[2], "suction")):
        note = opposite_note(replace(curve, measured=-values), values) or ""
        assert "opposite sign of those of the study" in note
        assert what in note
        assert opposite_note(replace(curve, measured=1.3 * values), values) is None
    large = (
        scale_note(replace(p, measured=1e3 * predicted[2]), predicted[2], 1, 1, "at the start values") or ""
    )
    assert (
        "check the unit of the values ('pressure_unit:' or the heading), and the units of the study" in large
    )


def test_the_whole_place_of_a_camera_maps_its_places_to_the_body() -> None:
    """Known and unknown parts together: x = offset + R x'."""
    own = np.random.default_rng(4).uniform(size=(5, 3))
    known, origin = rotation(np.deg2rad([10.0, -20.0, 30.0])), np.array([0.1, -0.2, 0.3])
    cloud = PointCloud("film", own @ known.T + origin, np.zeros(5), axes=known, origin=origin)
    unknown = np.array([0.02, 0.01, -0.03, 2.0, -1.0, 4.0])
    offset, vector = cloud.camera_place(unknown)
    np.testing.assert_allclose(
        own @ rotation(np.deg2rad(vector)).T + offset, cloud.moved(unknown), atol=1e-14
    )


def test_the_place_of_a_camera_is_found_again() -> None:
    """Offset and rotation in the plane of the film, beside the radius, from exact values."""
    film = {**FILM, "grid": [3, 8, 1], "camera": {"unknown": ["x", "y", "rz"]}}
    plan, truth = filmed(film, RADIUS), np.array([0.23, 0.02, -0.03, 4.0])
    model = ExperimentModel(plan.experiments[0], plan.unknowns, BoundLaw(law(), {"poisson_ratio": 0.33}))
    exact = by_curve(model.curves(truth).values, plan.curves)
    curves = [replace(curve, measured=part) for curve, part in zip(plan.curves, exact, strict=True)]
    misfit = Misfit(StudiesModel([each.unknown for each in plan.unknowns], [model]), curve_data(curves))
    found = fit(misfit, FitSettings(starts=1), Console(StringIO()))
    assert found.converged
    np.testing.assert_allclose(found.best.coordinates, truth, rtol=1e-4)


class Known:
    """Cells that are known already, as far as a plan asks for them."""

    experiments = ("",)

    @staticmethod
    def laws() -> Callable[[RunConfig], MacroLaw]:
        return lambda config: BoundLaw(law(), {"poisson_ratio": 0.33})


def test_points_outside_the_deformed_body_are_left_out(tmp_path: Path) -> None:
    """The column settles by some 5 %, so a point near the top of the undeformed body is none of the deformed one."""
    film = {**FILM, "grid": [2, 24, 2], "place": "deformed", "outside": 0.2}
    plan, told = filmed(film, RADIUS), StringIO()
    measured = [replace(curve, measured=np.arange(1.0, len(curve) + 1)) for curve in plan.curves]
    plan = replace(plan, experiments=(replace(plan.experiments[0], curves=tuple(measured)),))
    file = tmp_path / "study.yaml"
    file.write_text("calibration:\n  points:\n    film:\n      outside: 0.01\n", encoding="utf-8")
    document = YamlDocument.read(file)
    found = _with_points_inside(plan, [Known()], tmp_path, Console(told), document)
    cloud, before = found.curves[0].series.cloud, plan.curves[0].series.cloud
    assert 0 < len(before) - len(cloud) < 0.2 * len(before)
    last = cloud.places[cloud.times == cloud.times[-1]]
    assert last[:, 1].max() < before.places[:, 1].max()
    kept = _numbers(before)[np.isin(_numbers(before), _numbers(cloud))]
    for curve in found.curves:
        assert len(curve) == len(curve.measured) == len(curve.deviations) == len(cloud)
        np.testing.assert_array_equal(curve.measured, np.searchsorted(_numbers(before), kept) + 1)
    assert "values lie outside the body and were left out" in told.getvalue()
    again = _with_points_inside(plan, [], tmp_path, Console(StringIO()), document)
    assert again.curves[0].series.cloud.identity == cloud.identity
    few = replace(plan.experiments[0], curves=tuple(_less(curve) for curve in plan.curves))
    with pytest.raises(
        ConfigurationError,
        match=r"study.yaml:4: calibration.points.film.outside: .* values of 'film' lie outside the body",
    ):
        _with_points_inside(
            replace(plan, experiments=(few,)), [Known()], tmp_path / "other", Console(StringIO()), document
        )


def _numbers(cloud: PointCloud) -> np.ndarray:
    """A number of each point that grows with its time, then with its place."""
    return cloud.times * 1e9 + cloud.places @ [1e6, 1e3, 1.0]


def _less(curve: ObservedCurve) -> ObservedCurve:
    """The curve of a film of which hardly any point may lie outside."""
    series = curve.series
    assert isinstance(series, FilmComponent)
    return replace(curve, series=replace(series, cloud=replace(series.cloud, outside=0.01)))


@pytest.mark.slow
def test_a_stiffness_profile_is_found_again_from_a_film() -> None:
    """A twin experiment: five control values over the depth from displacements at many points, with noise."""
    truth = [0.18, 0.2, 0.24, 0.27, 0.22]
    field = {"along": "y", "at": [0.0, 0.4, 0.8, 1.1, 1.5], "start": truth}
    unknowns = {"radius": {"lower": 0.15, "upper": 0.3, "field": field}}
    film = {
        "grid": [6, 30, 1],
        "times": {"first": 0.05, "last": 2.0, "count": 8},
        "quantities": ["u1", "u2"],
        "deviation": 5e-4,
    }
    macro = {
        **BENT,
        "body": {"kind": "box", "elements": [1, 4, 1], "size": [0.5, 1.5, 0.5]},
        "time": {"end": 2.0, "step": 0.4, "ramp_increments": 1, "ramp_step": 0.05, "profiles": []},
    }
    plan = filmed(film, unknowns, macro=macro)
    model = ExperimentModel(plan.experiments[0], plan.unknowns, BoundLaw(law(), {"poisson_ratio": 0.33}))
    exact = by_curve(model.curves(np.array(truth)).values, plan.curves)
    curves = [
        curve.made_up(part, [1, i]) for i, (curve, part) in enumerate(zip(plan.curves, exact, strict=True))
    ]
    misfit = Misfit(StudiesModel([each.unknown for each in plan.unknowns], [model]), curve_data(curves))
    found = fit(misfit, FitSettings(starts=1), Console(StringIO()), [np.full(5, 0.22)])
    deviations = LinearPrecision.from_jacobian(found.best.jacobian).deviations
    assert found.converged
    assert deviations.max() < 0.01
    assert (np.abs(found.best.coordinates - truth) < 3 * deviations).all()
