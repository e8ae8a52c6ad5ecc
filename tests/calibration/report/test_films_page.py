"""Measured fields and grids of unknown values in the report and the tables of a calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.figures import _shown_times, field_figure, film_figure
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.page import data_rows
from porocore.commands.calibration.results import _places_entry, _point_rows
from tests.calibration.test_full_field import FILM, GRID, filmed


@pytest.fixture(scope="module")
def done() -> Any:
    """A calibration of a film, of which the fit is half the measured values."""
    plan = filmed(FILM, GRID)
    draws = np.random.default_rng(0)
    curves = tuple(replace(curve, measured=draws.normal(size=len(curve))) for curve in plan.curves)
    plan = replace(plan, experiments=(replace(plan.experiments[0], curves=curves),))
    data = curve_data(plan.curves)
    ends = [(0.19, 0.21), (0.2, 0.22), (None, 0.23), (0.23, 0.25), (0.24, 0.26), (0.22, 0.24), (0.3, 0.35)]
    inference = SimpleNamespace(
        best=SimpleNamespace(prediction=SimpleNamespace(values=data.values / 2)),
        values=np.array([0.2, 0.21, 0.22, 0.24, 0.25, 0.23, 0.33]),
        intervals=[SimpleNamespace(values=pair) for pair in ends],
        unknowns=[each.unknown for each in plan.unknowns],
    )
    return SimpleNamespace(plan=plan, data=data, inference=inference, truth=None, path=Path())


def test_a_film_is_shown_beside_fit_and_residuals(done: Any) -> None:
    figure = film_figure(done, 1)
    panels = figure.axes[:9]
    assert [axes.get_title() for axes in panels[:3]] == [
        "measured\n$t$ = 0.15",
        "fitted\n",
        "residual\n",
    ]
    measured, fitted, residual = (axes.collections[0].get_array() for axes in panels[:3])
    assert len(measured) == 16
    np.testing.assert_allclose(fitted, measured / 2)
    np.testing.assert_allclose(residual, measured / 2 / 0.001)
    rows = done.data.rows(1)[:16]
    np.testing.assert_allclose(measured, done.data.values[rows])
    x, y = panels[0].collections[0].get_offsets().T
    places = done.plan.curves[1].series.places[:16]
    np.testing.assert_allclose(np.stack([x, y]), places[:, :2].T)
    assert (panels[-1].get_xlabel(), panels[0].get_ylabel()) == ("x [–]", "y [–]")


def test_a_constant_field_has_one_colour(done: Any) -> None:
    """Rounding errors of the fit have none of their own."""
    rows, values = done.data.rows(0), done.data.values.copy()
    fitted = done.inference.best.prediction.values.copy()
    for constant in (0.0, 5.0):
        values[rows], fitted[rows] = constant, constant * (1 + 1e-15)
        fitted[rows[0]] += 1e-17
        prediction = SimpleNamespace(prediction=SimpleNamespace(values=fitted))
        inference = SimpleNamespace(**{**vars(done.inference), "best": prediction})
        one = SimpleNamespace(
            **{**vars(done), "data": replace(done.data, values=values), "inference": inference}
        )
        figure = film_figure(one, 0)
        figure.canvas.draw()
        panels = [axes.collections[0] for axes in figure.axes[:9]]
        colours = np.concatenate(
            [each.to_rgba(each.get_array()) for k, each in enumerate(panels) if k % 3 < 2]
        )
        assert np.ptp(colours, axis=0).max() < 0.01


def test_the_displacements_of_a_turned_camera_are_named_by_its_axes(done: Any) -> None:
    (experiment,) = done.plan.experiments
    cloud = replace(experiment.curves[1].series.cloud, axes=np.eye(3)[[1, 0, 2]])
    curves = tuple(replace(one, series=replace(one.series, cloud=cloud)) for one in experiment.curves)
    plan = replace(done.plan, experiments=(replace(experiment, curves=curves),))
    turned = SimpleNamespace(**{**vars(done), "plan": plan})
    labels = [film_figure(turned, c).axes[-2].get_ylabel() for c in (1, 2)]
    assert labels == ["film: u2 along camera axis 2 [–]", "film: p [–]"]


def test_the_frame_of_the_largest_value_is_shown() -> None:
    times = np.arange(1.0, 8.0)
    assert [_shown_times(times, each).tolist() for each in (3.0, 7.0)] == [[1, 3, 7], [1, 4, 7]]
    assert _shown_times(times[:1], 1.0).tolist() == [1]


def test_values_on_a_grid_have_a_map_and_crosses_where_an_end_is_open(done: Any) -> None:
    (field,) = done.plan.fields
    assert field.lines == {"x": (0.0, 0.5), "y": (0.0, 0.5, 1.5)}
    assert _places_entry(field) == {"grid": dict(field.lines)}
    panels = [axes for axes in field_figure(done, field).axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["fit", "half of the 95 % interval"]
    crosses = panels[1].lines[1]
    assert (crosses.get_xdata().tolist(), crosses.get_ydata().tolist()) == ([0.0], [0.5])


def test_the_rows_of_points_have_places_times_and_values(done: Any) -> None:
    rows = list(_point_rows(done))
    assert len(rows) == 3 * 48
    name, x, y, z, unit, time, _, measured, deviation, fitted, _ = rows[16]
    assert (name, unit, time, deviation) == ("film: u1", "-", pytest.approx(0.3674, rel=1e-3), 0.001)
    np.testing.assert_allclose([x, y, z], done.plan.curves[0].series.places[16])
    assert fitted == measured / 2


def test_the_table_of_data_names_the_points(done: Any) -> None:
    words = [row[1] for row in data_rows(done.plan)]
    assert words[0] == "displacement 1 at 48 points and times of the undeformed body"
    assert words[2] == "pressure at 48 points and times of the undeformed body"
