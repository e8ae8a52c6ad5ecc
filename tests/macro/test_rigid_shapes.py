"""Signed distances of rigid shapes: values by hand, gradients and Hessians by differences, any direction."""

import numpy as np
import pytest
from pydantic import ValidationError

from porocore.macro.boundary.rigid import (
    ConicalIndenter,
    CylindricalIndenter,
    FlatPunch,
    PlaneIndenter,
    SphericalIndenter,
)

AXIS = np.array([0.3, 0.9, -0.2]) / np.linalg.norm([0.3, 0.9, -0.2])
SHAPES = {
    "sphere": SphericalIndenter(kind="sphere", radius=0.7),
    "punch": FlatPunch(kind="punch", radius=0.7, edge=0.2),
    "cylinder": CylindricalIndenter(kind="cylinder", radius=0.7, axis=tuple(np.cross(AXIS, [1.0, 0, 0]))),
    "cone": ConicalIndenter(kind="cone", angle=70.0, radius=0.3),
    "plane": PlaneIndenter(kind="plane"),
}


def shallow(n=400):
    """Points about the tip, at most a tenth within the shapes."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (20 * n, 3))
    near = {name: np.abs(shape.distance(points, AXIS).gap) < 0.1 for name, shape in SHAPES.items()}
    return {name: points[near[name]][:n] for name in SHAPES}


@pytest.mark.parametrize("name", SHAPES)
def test_gradient_and_hessian_are_slopes(name):
    shape, x = SHAPES[name], shallow()[name]
    found, h = shape.distance(x, AXIS), 1e-6
    assert np.allclose(np.linalg.norm(found.normal, axis=1), 1, atol=1e-12)
    for i in range(3):
        step = h * np.eye(3)[i]
        up, down = shape.distance(x + step, AXIS), shape.distance(x - step, AXIS)
        # Beside a seam of two parts the Hessian jumps.
        smooth = np.abs(up.hessian - down.hessian).max(axis=(1, 2)) < 0.1
        assert smooth.mean() > 0.98
        assert np.allclose((up.gap - down.gap) / (2 * h), found.normal[:, i], atol=1e-8)
        slope = (up.normal - down.normal) / (2 * h)
        assert np.allclose(slope[smooth], found.hessian[smooth][:, :, i], atol=2e-7)


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "plane"])
def test_the_radius_has_its_slope(name):
    shape, x, h = SHAPES[name], shallow()[name], 1e-6
    assert shape.has_radius
    found = shape.distance(x, AXIS)
    up, down = (shape.model_copy(update={"radius": shape.radius + d}).distance(x, AXIS) for d in (h, -h))
    assert np.allclose((up.gap - down.gap) / (2 * h), found.by_radius, atol=1e-8)
    smooth = np.abs(up.hessian - down.hessian).max(axis=(1, 2)) < 0.1
    slope = (up.normal - down.normal) / (2 * h)
    assert np.allclose(slope[smooth], found.normal_by_radius[smooth], atol=2e-7)


def at(shape, *places):
    return shape.distance(np.array(places, dtype=float), np.array([0.0, 1.0, 0.0])).gap


def test_distances_by_hand():
    assert np.allclose(
        at(SHAPES["sphere"], (0, 0, 0), (0, -1, 0), (1.7, 0.7, 0), (0, 0.1, 0)), [0, 1, 1, -0.1]
    )
    punch = SHAPES["punch"]
    assert np.allclose(
        at(punch, (0.5, -0.3, 0), (0, 0.1, 0), (1.0, 5, 0), (0, 2, 0.6)), [0.3, -0.1, 0.3, -0.1]
    )
    corner = 0.2 * (np.sqrt(2) - 1)
    assert np.allclose(at(punch, (0.7, 0, 0)), corner)
    flat = CylindricalIndenter(kind="cylinder", radius=0.7)
    assert np.allclose(at(flat, (0, 0, 9), (0.7, 0.7, -3), (0, -1, 2)), [0, 0, 1])
    cone = ConicalIndenter(kind="cone", angle=45.0, radius=0.1)
    # Its sides meet at r (1/sin β − 1) ahead of the rounded tip.
    sharp = 0.1 * (np.sqrt(2) - 1)
    assert np.allclose(at(cone, (0, 0, 0), (0, -1, 0), (1.0 + sharp, 1.0, 0)), [0, 1, 0], atol=1e-12)
    assert np.allclose(at(SHAPES["plane"], (3, -2, 1), (0, 0.5, 0)), [2, -0.5])


def test_on_the_axis_nothing_is_divided_by_zero():
    for shape in SHAPES.values():
        found = shape.distance(np.outer([-0.5, 0.0, 0.05], AXIS), AXIS)
        for each in (found.gap, found.normal, found.hessian, found.normal_by_radius):
            assert np.isfinite(each).all()
        assert np.allclose(found.normal, -AXIS)


@pytest.mark.parametrize(
    ("model", "settings", "said"),
    [
        (SphericalIndenter, {"kind": "sphere", "radius": 0}, "greater than 0"),
        (FlatPunch, {"kind": "punch", "radius": 1, "edge": 2}, "rounded by more"),
        (ConicalIndenter, {"kind": "cone", "angle": 90, "radius": 1}, "less than 90"),
        (ConicalIndenter, {"kind": "cone", "angle": 60}, "radius"),
    ],
)
def test_shapes_that_are_none(model, settings, said):
    with pytest.raises(ValidationError, match=said):
        model(**settings)
