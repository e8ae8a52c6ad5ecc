"""Rounded ridges: their closed form against a CAD kernel and the sharp limit, and the meshes that follow them."""

from itertools import permutations, product

import gmsh
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import quad
from scipy.spatial import cKDTree

from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.meshing.connectivity import blocked, pieces
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.meshing.tetrahedra import volume
from porocore.errors import PorocoreError

COARSE = MeshSettings(size=0.25, fluid_size=0.25)
LINEAR = MeshSettings(size=0.25, fluid_size=0.25, element="linear")
R3, R2 = OrthogonalChannels(fillet=0.05), OrthogonalChannels(axes="xz", fillet=0.08)


def removed(geometry):
    """Volume of the solid that the fillets take away."""
    return geometry.porosity - geometry.model_copy(update={"fillet": 0.0}).porosity


@pytest.mark.parametrize("radii", [*permutations((0.15, 0.2, 0.25)), (0.12, 0.16, 0.2)])
def test_no_channel_is_lost_where_ridges_meet_in_the_wall_of_another(radii):
    """OpenCASCADE lost one where r₁² + r₂² = r₃²: K along it was 0, and the porosity 0.233 for 0.302."""
    geometry = OrthogonalChannels(radii=radii)
    meshes = [make_mesh(geometry, COARSE, phase, "whole") for phase in ("solid", "fluid")]
    solid, fluid = (volume(mesh.points, mesh.cells) for mesh in meshes)
    assert fluid == pytest.approx(geometry.porosity, rel=2e-3)
    assert solid + fluid == pytest.approx(1, abs=1e-12)
    assert blocked(pieces(meshes[1])) == ""


def test_pores_that_are_drawn_otherwise_than_described_are_refused(monkeypatch):
    geometry = OrthogonalChannels(radii=(0.1, 0.23, 0.31))
    monkeypatch.setattr(OrthogonalChannels, "porosity", 0.3)
    with pytest.raises(PorocoreError, match="the drawn pores are not those that are described"):
        make_mesh(geometry, COARSE, "solid", "whole")


@pytest.mark.parametrize(
    ("axes", "radius", "fillet"), [("xyz", 0.25, 0.02), ("xyz", 0.4, 0.05), ("yz", 0.25, 0.02)]
)
def test_porosity_is_that_of_the_fillets_of_opencascade(axes, radius, fillet):
    """Which fits splines, to some parts in a thousand of what it takes away."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        channels = [(3, occ.addCylinder(0, 0, 0, *np.eye(3)["xyz".index(axis)], radius)) for axis in axes]
        ((_, solid),), _ = occ.cut([(3, occ.addBox(0, 0, 0, 0.5, 0.5, 0.5))], channels)
        sharp = occ.getMass(3, solid)
        occ.synchronize()
        ellipses = [tag for _, tag in gmsh.model.getEntities(1) if gmsh.model.getType(1, tag) == "Ellipse"]
        ((_, rounded),) = occ.fillet([solid], ellipses, [fillet])
        volume = occ.getMass(3, rounded)
    finally:
        gmsh.finalize()
    geometry = OrthogonalChannels(radius=radius, axes=axes, fillet=fillet)
    assert 1 - 8 * sharp == pytest.approx(geometry.model_copy(update={"fillet": 0.0}).porosity, rel=1e-6)
    assert 8 * (sharp - volume) == pytest.approx(removed(geometry), rel=4e-3)


@pytest.mark.parametrize(("axes", "arcs", "end"), [("xyz", 24, np.pi / 4), ("xy", 8, np.pi / 2)])
def test_small_fillets_remove_their_square_along_the_ridges(axes, arcs, end):
    """Between two faces with normals θ apart a fillet takes f² (tan θ/2 − θ/2), (1 − π/4) f² at a right angle.

    Along the ridge (r cos t, r cos t, r sin t) of two channels cos θ = sin² t, and what follows is of order f³.
    """
    r = 0.25

    def section(t):
        half = np.arccos(np.sin(t) ** 2) / 2
        return np.tan(half) - half

    assert section(0.0) == pytest.approx(1 - np.pi / 4)
    limit = arcs * quad(lambda t: section(t) * r * np.sqrt(1 + np.sin(t) ** 2), 0, end)[0]
    f = np.array([0.04, 0.02, 0.01])
    share = [removed(OrthogonalChannels(radius=r, axes=axes, fillet=x)) / x**2 for x in f]
    errors = np.abs(np.array(share) / limit - 1)
    assert errors[-1] < 0.02
    orders = np.log2(errors[:-1] / np.maximum(errors[1:], 1e-12))
    assert (orders > 0.9).all()


@pytest.mark.parametrize("geometry", [R3, R2, OrthogonalChannels(radius=0.1, fillet=0.1)], ids=str)
@pytest.mark.parametrize("phase", ["solid", "fluid"])
def test_curved_meshes_fill_the_rounded_phases(geometry, phase):
    mesh = make_mesh(geometry, COARSE, phase, "eighth")
    volume = 8 * _enclosed(mesh)
    expected = geometry.porosity if phase == "fluid" else 1 - geometry.porosity
    assert volume == pytest.approx(expected, abs=3e-5)


def _enclosed(mesh):
    """∮ x·N dA / 3 over the curved facets."""
    x, weights = np.polynomial.legendre.leggauss(5)
    s, t = np.meshgrid((x + 1) / 2, (x + 1) / 2)
    w = np.outer(weights, weights) / 4 * (1 - s)
    a, b = s.ravel(), (t * (1 - s)).ravel()
    c = 1 - a - b
    N = np.array([c * (2 * c - 1), a * (2 * a - 1), b * (2 * b - 1), 4 * c * a, 4 * a * b, 4 * b * c])
    zero = 0 * a
    by_a = np.array([1 - 4 * c, 4 * a - 1, zero, 4 * (c - a), 4 * b, -4 * b])
    by_b = np.array([1 - 4 * c, zero, 4 * b - 1, -4 * a, 4 * a, 4 * (c - b)])
    X = mesh.points[mesh.boundary]
    place, d_a, d_b = (np.einsum("aq,kai->kqi", S, X) for S in (N, by_a, by_b))
    return float(np.einsum("kqi,kqi,q->", place, np.cross(d_a, d_b), w.ravel())) / 3


def test_wall_nodes_lie_on_channels_or_fillets():
    """The fillet is where balls that touch two channels or three touch the solid."""
    r, f = R3.radius, R3.fillet
    mesh = make_mesh(R3, COARSE, "solid", "eighth")
    wall = mesh.points[np.unique(mesh.wall)]
    t = np.linspace(0, np.pi / 4, 20001)
    arc = (r + f) * np.stack([np.cos(t), np.cos(t), np.sin(t)], axis=1)
    centres = cKDTree(np.concatenate([arc, arc[:, [0, 2, 1]], arc[:, [2, 0, 1]]]))
    to_fillet = np.abs(centres.query(wall)[0] - f)
    to_axes = np.stack([np.linalg.norm(np.delete(wall, i, axis=1), axis=1) for i in range(3)])
    to_channel = np.abs(to_axes - r).min(axis=0)
    assert to_axes.min() > r - 1e-9
    assert (to_fillet < 1e-8).sum() > 100
    assert np.minimum(to_fillet, to_channel).max() < 1e-8


@pytest.mark.parametrize("fillet", [0.02, 0.05, 0.15])
def test_two_or_three_elements_go_around_a_fillet(fillet):
    geometry = OrthogonalChannels(fillet=fillet)
    mesh = make_mesh(geometry, LINEAR, "solid", "eighth")
    on_arc = np.abs(mesh.points[:, 2]) == 0.0
    R = geometry.radius + fillet
    away = mesh.points - [R, R, 0.0]
    on_arc &= np.abs(np.linalg.norm(away, axis=1) - fillet) < 1e-9
    assert 2 <= on_arc.sum() - 1 <= 3
    assert len(mesh.points) > len(make_mesh(OrthogonalChannels(), LINEAR, "solid", "eighth").points)


@pytest.mark.parametrize("geometry", [R3, R2], ids=str)
@pytest.mark.parametrize("phase", ["solid", "fluid"])
def test_opposite_faces_of_the_whole_cell_match(geometry, phase):
    mesh = make_mesh(geometry, COARSE, phase, "whole")
    assert np.abs(mesh.points).max() == 0.5
    stored = {tuple(point) for point in mesh.points}
    for axis, signs in product(range(3), (-1.0, 1.0)):
        face = mesh.points[mesh.points[:, axis] == signs * 0.5].copy()
        assert len(face) or (phase == "fluid" and "xyz"[axis] not in geometry.axes)
        face[:, axis] *= -1
        assert {tuple(point) for point in face} <= stored
    # No facet of the outer boundary was taken for a wall: none lies flat on a plane near a face of the cell.
    corners = mesh.points[mesh.wall[:, :3]]
    assert not (np.ptp(corners, axis=1) < 1e-9).any()


def test_the_mesh_has_the_symmetry_of_the_cube():
    mesh = make_mesh(R3, LINEAR, "solid", "whole")
    stored = {tuple(point) for point in mesh.points}
    for order in permutations(range(3)):
        assert {tuple(point) for point in -mesh.points[:, order] + 0.0} == stored


def test_straight_elements_keep_their_middles_between_the_corners():
    settings = COARSE.model_copy(update={"element": "quadratic-straight"})
    mesh = make_mesh(R3, settings, "solid", "eighth")
    pairs = mesh.cells[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]]
    np.testing.assert_allclose(mesh.points[mesh.cells[:, 4:]], mesh.points[pairs].mean(axis=2), atol=1e-15)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"fillet": -0.01}, "expected 0"),
        ({"fillet": 0.26}, "that of the channels, 0.25"),
        ({"radius": 0.4, "fillet": 0.1}, "radius \\+ fillet < 0.5"),
        ({"fillet": 0.001}, "from 0.005"),
        ({"fillet": float("nan")}, "finite number"),
        ({"axes": "z", "fillet": 0.05}, "one channel has no ridges"),
    ],
)
def test_fillets_that_do_not_fit_are_refused(settings, text):
    with pytest.raises(ValidationError, match=text):
        OrthogonalChannels(**settings)
