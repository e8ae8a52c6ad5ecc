"""Bodies in two dimensions: meshes, measures, files, derivatives of following pressures, refusals."""

from __future__ import annotations

import re

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import sections
from porocore.macro.body.mesh import ELEMENTS, BodyMesh, Facets, boundary_facets
from porocore.macro.boundary.conditions import boundary_data, follower_forces, follower_tangent
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.problem import MacroProblem, body_mesh
from tests.helpers.flat_geometry import write_dome

TUBE = {"kind": "axisymmetric", "radius": 0.5, "inner_radius": 0.2, "height": 0.8, "elements": (2, 3)}
PLUG = {"kind": "axisymmetric", "radius": 0.5, "height": 0.8, "elements": (2, 3)}
PLATE = {"kind": "plane-strain", "size": (0.7, 0.8), "depth": 0.3, "elements": (2, 3), "grading": (2, 0.5)}


def made(body, **more):
    return MacroProblem.model_validate({"body": body, "boundary": {}} | more)


def mesh_of(body):
    return body_mesh(made(body))


# ---- elements and measures -----------------------------------------------------------------------


@pytest.mark.parametrize("nodes", [6, 9])
def test_shape_functions_of_flat_elements(nodes):
    element = ELEMENTS[nodes]
    np.testing.assert_allclose(element.values(element.nodes), np.eye(nodes), atol=1e-14)
    at = element.points
    for values in (element.values(at), element.corner_values(at)):
        np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-14)
    h = 1e-6
    for i in range(3):
        step = h * np.eye(3)[i]
        slope = (element.values(at + step) - element.values(at - step)) / (2 * h)
        np.testing.assert_allclose(element.gradients(at)[..., i], slope, atol=1e-9)
    # x² y of degree three, on both reference elements.
    exact = 1 / 60 if nodes == 6 else 1 / 6
    assert (at[:, 0] ** 2 * at[:, 1]) @ element.weights == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize(
    ("body", "volume", "areas"),
    [
        (
            TUBE,
            np.pi * 0.21 * 0.8,
            {"side": 0.8 * np.pi, "inner": 0.32 * np.pi, "y-": 0.21 * np.pi, "y+": 0.21 * np.pi},
        ),
        (PLUG, 0.2 * np.pi, {"side": 0.8 * np.pi, "y-": 0.25 * np.pi, "y+": 0.25 * np.pi}),
        (PLATE, 0.7 * 0.8 * 0.3, {"x-": 0.24, "x+": 0.24, "y-": 0.21, "y+": 0.21}),
    ],
    ids=["tube", "plug", "plate"],
)
def test_volumes_and_areas_are_those_of_the_whole(body, volume, areas):
    mesh = mesh_of(body)
    assert mesh.weights.sum() == pytest.approx(volume, rel=1e-13)
    assert {name: Facets(mesh, own).areas.sum() for name, own in mesh.surfaces.items()} == pytest.approx(
        areas
    )
    assert mesh.unnamed == 0
    for name, normal in (("y+", (0, 1, 0)), ("side" if mesh.revolved else "x+", (1, 0, 0))):
        assert Facets(mesh, mesh.surfaces[name]).plane("") == pytest.approx(normal)


@pytest.mark.parametrize("body", [TUBE, PLATE], ids=["tube", "plate"])
def test_pressures_on_a_closed_surface_do_the_work_of_its_volume(body):
    """∫ p n·δu da = p δV, with volumes of the deformed mesh."""
    mesh, rng = mesh_of(body), np.random.default_rng(0)
    facets = Facets(mesh, boundary_facets(mesh.cells))
    u, du = 0.01 * rng.standard_normal((2, *mesh.points.shape)) * np.array([1, 1, 0])

    def volume(u):
        return BodyMesh(mesh.points + u, mesh.cells, revolved=mesh.revolved, depth=mesh.depth).weights.sum()

    h = 1e-5
    slope = (volume(u + h * du) - volume(u - h * du)) / (2 * h)
    assert (follower_forces(facets, u, 0.7) * du).sum() == pytest.approx(0.7 * slope, rel=1e-8)


@pytest.mark.parametrize("body", [TUBE, PLATE], ids=["tube", "plate"])
def test_the_derivative_of_following_pressures(body):
    mesh, rng = mesh_of(body), np.random.default_rng(1)
    facets = Facets(mesh, mesh.surfaces["y+"])
    u, du = 0.01 * rng.standard_normal((2, *mesh.points.shape)) * np.array([1, 1, 0])
    h = 1e-6
    slope = (follower_forces(facets, u + h * du, 0.7) - follower_forces(facets, u - h * du, 0.7)) / (2 * h)
    found = (follower_tangent(facets, u, 0.7) @ du.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(found, slope, atol=1e-9 * np.abs(slope).max() + 1e-12)


def test_the_gradient_in_a_meridian_is_that_of_the_revolved_displacement():
    """u = (f(r) e_r, g(r, y)) turned into three dimensions and derived there by differences."""
    mesh = mesh_of(TUBE)

    def displacement(x, y, z):
        r = np.hypot(x, z)
        radial = 0.1 * r**2 + 0.05 * y
        return np.stack([radial * x / r, 0.2 * r * y + 0.1 * y**2, radial * z / r], axis=-1)

    x, y, _ = mesh.points.T
    found = mesh.displacement_gradients(displacement(x, y, 0 * x)).reshape(-1, 3, 3)
    at, h = mesh.quadrature_points.reshape(-1, 3), 1e-5
    steps = h * np.eye(3)
    exact = np.stack(
        [(displacement(*(at + s).T) - displacement(*(at - s).T)) / (2 * h) for s in steps], axis=-1
    )
    np.testing.assert_allclose(found, exact, atol=1e-9)


@pytest.mark.parametrize("body", [TUBE, PLATE], ids=["tube", "plate"])
def test_probes_and_the_section(body):
    mesh = mesh_of(body)
    field = np.array([0.3, 0.2, 0.0]) + mesh.points @ np.array([[0.1, 0.2, 0], [0.3, -0.1, 0], [0, 0, 0]]).T
    x = np.concatenate([field.ravel(), mesh.points[mesh.p_nodes] @ [1, 2, 0]])
    at = np.array([0.41, 0.33, 0])
    found = interpolation(mesh, {"a": tuple(at)}) @ x
    wanted = [0.3 + 0.1 * at[0] + 0.2 * at[1], 0.2 + 0.3 * at[0] - 0.1 * at[1], 0, at[0] + 2 * at[1]]
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    with pytest.raises(ConfigurationError, match="lies outside the body"):
        interpolation(mesh, {"a": (0.41, 0.33, 0.1)})
    (section,) = sections(mesh.points, mesh.cells)
    assert section.across == 2
    right, up = section.places()
    columns, rows = np.meshgrid(right, up)
    centres = section.image(mesh.centres)
    assert np.isfinite(centres).all()
    assert np.abs(centres[..., 0] - columns).max() < 0.3
    assert np.abs(centres[..., 1] - rows).max() < 0.25


# ---- files ---------------------------------------------------------------------------------------


def test_a_geometry_is_the_meridian_or_the_section(tmp_path):
    path = write_dome(tmp_path)
    body = {"kind": "file", "path": str(path), "size": 0.15}
    meridian, section = (mesh_of(body | {"flat": flat}) for flat in ("axisymmetric", "plane-strain"))
    assert meridian.cells.shape[1] == 6
    assert meridian.weights.sum() == pytest.approx(2 / 3 * np.pi * 0.5**3, rel=2e-4)
    assert section.weights.sum() == pytest.approx(np.pi / 4 * 0.5**2, rel=2e-4)
    assert set(meridian.surfaces) == {"base", "dome"}
    assert Facets(meridian, meridian.surfaces["dome"]).areas.sum() == pytest.approx(np.pi / 2, rel=2e-4)
    with pytest.raises(ConfigurationError, match="axis: it lies on the axis of revolution"):
        meridian.surface("axis", "macro.boundary.axis")
    assert len(section.surfaces["axis"])
    (found,) = sections(section.points, section.cells)
    assert (found.element >= 0).mean() == pytest.approx(np.pi / 4, rel=0.02)


@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_of_quadrilaterals(tmp_path, order):
    path = write_dome(tmp_path, order)
    mesh = mesh_of({"kind": "file", "path": str(path), "flat": "axisymmetric", "scale": 2.0})
    assert mesh.cells.shape[1] == 9
    assert mesh.weights.sum() == pytest.approx(8 * 2 / 3 * np.pi * 0.5**3, rel=2e-2 if order == 1 else 2e-4)
    assert mesh.straight == (order == 1)


def test_files_that_are_no_section_are_refused(tmp_path):
    path = write_dome(tmp_path)
    body = {"kind": "file", "path": str(path), "size": 0.2}
    with pytest.raises(ConfigurationError, match="expected a geometry with a volume"):
        mesh_of(body)
    for move, said in (("{-0.1, 0, 0}", "beyond the axis of revolution"), ("{0, 0, 1}", None)):
        moved = tmp_path / "moved.geo"
        moved.write_text(path.read_text() + f"Translate {move} {{ Surface{{1}}; }}\n", encoding="utf-8")
        given = body | {"path": str(moved), "flat": "axisymmetric"}
        if said is None:
            assert not mesh_of(given).points[:, 2].any()
            continue
        with pytest.raises(ConfigurationError, match=said):
            mesh_of(given)
    turned = tmp_path / "turned.geo"
    turned.write_text(
        path.read_text() + "Rotate {{1, 0, 0}, {0, 0, 0}, 1} { Surface{1}; }\n", encoding="utf-8"
    )
    with pytest.raises(ConfigurationError, match="expected a mesh in the plane z = 0"):
        mesh_of(body | {"path": str(turned), "flat": "plane-strain"})
    other = tmp_path / "mesh.vtu"
    other.write_text("<VTKFile></VTKFile>", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"is read from a \.msh file of gmsh, or meshed"):
        mesh_of({"kind": "file", "path": str(other), "flat": "plane-strain"})


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "more", "said"),
    [
        (
            PLUG,
            {"boundary": {"z-": {"normal": 0}}},
            "the body has no surface 'z-'; its surfaces are y-, y+, side",
        ),
        (PLUG, {"boundary": {"inner": {"pressure": 0}}}, "the body has no surface 'inner'"),
        (
            PLUG,
            {"boundary": {"y+": {"traction": (0, 0, 1)}}},
            "macro.boundary.y+.traction: got a third component; an axisymmetric body has none around the axis",
        ),
        (
            PLATE,
            {"boundary": {"y+": {"displacement": (None, None, 0.1)}}},
            "macro.boundary.y+.displacement: got a third component; a body in plane strain has none along z",
        ),
        (PLATE, {"body_force": (0, 0, 1)}, "macro.body_force: got a third component"),
        (
            PLUG,
            {"initial": {"gradient": ((0.1, 0, 0), (0, 0, 0), (0, 0, 0))}},
            "macro.initial.gradient: expected [[a, 0, 0], [0, b, 0], [0, 0, a]]",
        ),
        (PLUG, {"boundary": {"side": {"normal": 0}}}, "nothing holds the body in direction 2; prescribe u_2"),
        (PLATE, {"boundary": {"y-": {"normal": 0}}}, "nothing holds the body in direction 1"),
    ],
)
def test_what_two_dimensions_do_not_have_is_refused(body, more, said):
    given = made(body, **more)
    with pytest.raises(ConfigurationError, match=re.escape(said)):
        boundary_data(body_mesh(given), given)


def test_the_side_of_a_revolution_is_no_symmetry_plane():
    from porocore.macro.boundary.symmetry import Symmetry

    given = made(PLUG | {"symmetry": ["side"]}, boundary={"side": {"normal": 0}, "y-": {"normal": 0}})
    with pytest.raises(ConfigurationError, match="it goes around the axis of revolution"):
        Symmetry.of(given)
    half = made(PLUG | {"symmetry": ["y-"]}, boundary={"y-": {"normal": 0}})
    assert Symmetry.of(half).copies == 2


def test_no_wall_is_refused():
    with pytest.raises(ValueError, match=r"inner_radius = 0\.5 leaves nothing"):
        made(TUBE | {"inner_radius": 0.5})
