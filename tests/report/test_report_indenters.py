"""Indenters in the report: their outline by closed forms, figures, sentences and figures with units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.macro.boundary.rigid import RigidIndenter
from porocore.macro.problem import MacroSetup
from porocore.report.context import LoadingMode
from porocore.report.figures import indentation_figure, series_figure
from porocore.report.figures.curves import panels
from porocore.report.figures.indenters import SHOWN, across, front_of, section_of
from porocore.report.metrics import LoadCase
from porocore.report.text import indenter_sentences


def indenter(**shape):
    return RigidIndenter(shape=shape, place=(0.0, 1.0, 0.0), displacement=0.1, surfaces=("y+",))


def test_the_front_of_a_ball_is_drawn_where_the_ball_is():
    found = front_of(
        indenter(kind="sphere", radius=0.5), 0.1, across(indenter(radius=0.5), np.arange(7.0)), 2.0
    )
    centre = np.array([0.0, 1.0 - 0.1 + 0.5, 0.0])
    np.testing.assert_allclose(np.linalg.norm(found - centre, axis=-1), 0.5, atol=1e-5)
    np.testing.assert_allclose(found[:, 0], [[0.0, 0.9, 0.0]] * 7, atol=1e-9)
    # The front ends a little before the flank stands upright.
    assert found[..., 1].max() == pytest.approx(0.9 + min(0.5, SHOWN * 2.0), abs=0.02)


def test_the_section_of_a_punch_has_its_wall_and_ends_on_the_axis():
    found = section_of(indenter(kind="punch", radius=0.4, edge=0.1), 0.0, 2.0, revolved=True)
    assert found[:, 0].max() == pytest.approx(0.4, abs=1e-4)
    np.testing.assert_allclose(found[[0, -1]], [[0, 1], [0, 1 + SHOWN * 2]], atol=1e-6)
    face = found[found[:, 0] < 0.29]
    np.testing.assert_allclose(face[:-1, 1], 1.0, atol=1e-5)


def test_the_section_of_a_cone_has_its_angle():
    found = section_of(indenter(kind="cone", angle=60.0, radius=0.01), 0.0, 2.0, revolved=False)
    right = found[found[:, 0] > 0.1]
    slope = np.polyfit(*right.T, 1)[0]
    assert slope == pytest.approx(1 / np.tan(np.radians(60)), rel=1e-3)
    assert found[:, 0].min() == pytest.approx(-found[:, 0].max(), rel=1e-6)


def pressed(solution):
    t = solution.history.time
    rise = np.minimum(t / t[2], 1.0)
    force = rise * (1.0 + np.exp(-np.maximum(t - t[2], 0.0) / t[-1] * 8))
    series = np.stack([force, 0.1 * rise, rise, np.sqrt(rise / np.pi), 2 * rise, 1e-4 * rise, 0 * t], axis=1)
    return replace(solution, contact={"ball": series})


def test_forces_radii_and_pressures_of_indenters_have_figures(column):
    solution = pressed(column())
    found = {panel.plain: panel for panel in panels(solution)}
    for plain, row in (
        ("forces of indenters", 0),
        ("displacement of indenters", 1),
        ("contact radius of indenters", 3),
        ("largest contact pressure of indenters", 4),
    ):
        np.testing.assert_array_equal(found[plain].curves["ball"], solution.contact["ball"][:, row])
        assert series_figure(solution, solution, plain).axes[0].lines
    axes = indentation_figure(solution, solution).axes[0]
    np.testing.assert_allclose(axes.lines[0].get_xydata(), solution.contact["ball"][:, [1, 0]])


def test_the_summary_tells_the_force_of_an_indenter(column):
    solution = pressed(column())
    said = " ".join(indenter_sentences(LoadCase(solution, solution)))
    for part in (
        "force of the indenter ball (load −0.2) is 2",
        "with the radius 0.564",
        "contact pressure of 2",
        "linear",
    ):
        assert part in said, said


def test_an_indenter_that_is_moved_prescribes_the_settlement():
    given = {"shape": {"radius": 1}, "place": [0, 7.5, 0], "surfaces": ["y+"]}
    by = {
        kind: LoadingMode.from_setup(
            MacroSetup.model_validate({"boundary": {}, "contact": {"ball": given | {kind: 0.1}}})
        )
        for kind in ("displacement", "force")
    }
    assert by["displacement"].pressed == ("ball",)
    assert not by["displacement"].settles
    assert by["force"].settles
