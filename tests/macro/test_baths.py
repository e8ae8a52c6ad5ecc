"""Baths that differ from surface to surface: profiles between them, courses in time, runs."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.baths import BathsField, shares_of_surfaces
from porocore.macro.composition.fields import Points
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.macro_checks.bodies import write_tetrahedra

KEY = "macro.charges.bath"
BOX = {"kind": "box", "elements": (2, 5, 1), "size": (0.5, 1.5, 0.4)}
BODIES = {
    "hexahedra": BOX,
    "cylinder": {"kind": "cylinder", "radius": 1.2, "height": 1.5, "elements": (2, 3, 2)},
    "meridian": {"kind": "axisymmetric", "radius": 1.2, "height": 1.5, "elements": (3, 4)},
    "section": {"kind": "plane-strain", "size": (0.5, 1.5), "elements": (2, 4)},
}


def mesh_of(body, *drained):
    faces = {name: {"pressure": 0} for name in drained}
    return body_mesh(MacroProblem.model_validate({"body": body, "boundary": faces}))


def concentrations(mesh, baths, time=0.0):
    return BathsField(surfaces=baths).reached(Points.of(mesh), time, KEY)


@pytest.mark.parametrize("name", BODIES)
def test_between_two_ends_the_profile_is_linear(name):
    mesh = mesh_of(BODIES[name], "y-", "y+")
    y = mesh.quadrature_points[..., 1].ravel()
    found = concentrations(mesh, {"y-": 0.15, "y+": 0.6})
    np.testing.assert_allclose(found, 0.15 + 0.45 * y / 1.5, rtol=1e-12)


def test_the_profile_of_an_annulus_goes_to_the_logarithm_with_order_two():
    errors = []
    for count in (8, 16, 32):
        body = {
            "kind": "axisymmetric",
            "radius": 2.0,
            "inner_radius": 0.5,
            "height": 0.3,
            "elements": (count, 1),
        }
        mesh = mesh_of(body, "inner", "side")
        r = mesh.quadrature_points[..., 0].ravel()
        exact = 0.1 + 0.9 * np.log(r / 0.5) / np.log(4.0)
        found = concentrations(mesh, {"side": 1.0, "inner": 0.1})
        errors.append(np.sqrt(mesh.weights.ravel() @ (found - exact) ** 2))
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.1)


def test_tetrahedra_have_the_profile_of_the_hexahedra(tmp_path):
    write_tetrahedra(tmp_path / "box.msh", Box(size=(0.5, 1.5, 0.4), elements=(2, 3, 2)), bend=0.02)
    mesh = mesh_of({"kind": "file", "path": str(tmp_path / "box.msh")}, "y-", "y+")
    y = mesh.quadrature_points[..., 1].ravel()
    found = concentrations(mesh, {"y-": 0.15, "y+": 0.6})
    np.testing.assert_allclose(found, 0.15 + 0.45 * y / 1.5, rtol=1e-12)


def test_a_piece_of_a_body_without_a_bath_is_refused():
    one = mesh_of(BOX, "y+")
    cells = np.concatenate([one.cells, one.cells + len(one.points)])
    both = BodyMesh(np.concatenate([one.points, one.points + np.array([1.0, 0, 0])]), cells, one.surfaces)
    with pytest.raises(
        ConfigurationError, match=r"bath: a piece of the body, at \(1, 0, 0\), touches none of"
    ):
        shares_of_surfaces(both, ("y-", "y+"), KEY)


@pytest.mark.parametrize("name", BODIES)
def test_equal_baths_are_one_bath(name):
    """They touch on every edge of the body."""
    mesh = mesh_of(BODIES[name], "y-", "y+")
    found = concentrations(mesh, dict.fromkeys(mesh.surfaces, 0.15))
    np.testing.assert_allclose(found, 0.15, rtol=1e-12)


def test_concentrations_stay_between_the_baths_where_elements_are_flat():
    """Without a limit one would lie below both, since the elements are 40 times as long as they are thick."""
    body = {"kind": "plane-strain", "size": (4.0, 0.1), "elements": (2, 2)}
    mesh = mesh_of(body, "x-", "y+")
    found = concentrations(mesh, {"x-": 1e-3, "y+": 1.0})
    assert found.min() >= 1e-3
    assert found.max() <= 1.0


def test_a_node_of_two_baths_has_the_mean():
    mesh = mesh_of(BODIES["section"], "x-", "y-")
    shares = shares_of_surfaces(mesh, ("x-", "y-"), KEY)
    assert shares.shape == (mesh.weights.size, 2)
    element, first = mesh.element, np.zeros((1, 3))
    nodal = np.linalg.lstsq(element.corner_values(element.points), shares[: len(element.points)], rcond=None)[
        0
    ]
    np.testing.assert_allclose(element.corner_values(first) @ nodal, [[0.5, 0.5]], atol=1e-12)


def test_a_bath_may_change_with_time_at_some_points():
    mesh = mesh_of(BOX, "y-", "y+")
    field = BathsField(surfaces={"y-": 0.2, "y+": {"table": [[1.0, 0.2], [3.0, 1.0]]}})
    assert (field.varies, field.by_formula, field.corners) == (True, False, (1.0, 3.0))
    assert not BathsField(surfaces={"y-": 0.2, "y+": 0.3}).varies
    assert BathsField(surfaces={"y-": 0.2, "y+": {"expression": "1 + t"}}).by_formula
    points = Points.of(mesh, np.array([7, 2]))[5::3]
    expected = 0.2 + 0.4 * points.places[:, 1] / 1.5
    np.testing.assert_allclose(field.reached(points, 2.0, KEY), expected, rtol=1e-12)


def test_a_surface_that_there_is_not_is_named():
    with pytest.raises(ConfigurationError, match=r"macro\.charges\.bath\.top: the body has no surface 'top'"):
        concentrations(mesh_of(BOX, "y+"), {"y+": 0.2, "top": 0.3})
