"""Contact with the mirror planes: derivatives against differences of the energy, and of two walls by themselves."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.pairs import pore_surface
from porocore.cell.contact.wall_contact import (
    DEEPEST,
    ContactModel,
    ContactSettings,
    facet_edge,
    make_contact_model,
)
from porocore.cell.geometry.pore_geometry import unit_sides
from porocore.cell.meshing.mesh import CellMesh, MeshSettings

H = np.diag([0.02, -0.25, 0.01])
ELEMENTS = ("linear", "quadratic-curved")


@pytest.fixture(scope="module", params=[*ELEMENTS, "box"])
def mesh(request):
    element = "linear" if request.param == "box" else request.param
    found = Cell(mesh=MeshSettings(size=0.2, element=element)).make_mesh("solid", "eighth")
    if request.param == "box":
        sides = unit_sides((4, 5, 7))
        return replace(found, points=found.points * sides, sides=sides)
    return found


@pytest.fixture(scope="module")
def pressed(mesh):
    """A contact and a made-up field that pushes the wall through all six planes, at random."""
    contact = ContactModel(mesh, stiffness=100.0, deepest=1.0)
    rng = np.random.default_rng(3)
    x = mesh.points @ (np.eye(3) + H)
    outwards = x / (np.diag(np.eye(3) + H) * mesh.high) - 0.5  # −½ at X_a = 0, ½ at half of the side
    return contact, 0.08 * outwards + rng.normal(size=x.shape) * 2e-3


def directions(mesh, count=3):
    rng = np.random.default_rng(4)
    return [(rng.normal(size=mesh.points.shape), np.diag(rng.normal(size=3))) for _ in range(count)]


def test_every_plane_is_touched(pressed):
    state = pressed[0].at(H, pressed[1])
    assert state.active
    assert len({(axis, sign) for axis, sign, facets, _ in state._sides if len(facets)}) == 6
    assert 0 < state.forces.share < 1
    assert state.depth > 1e-3


def test_forces_are_the_slope_of_the_energy(mesh, pressed):
    contact, u = pressed
    n, h = len(mesh.points), 1e-6
    forces = contact.at(H, u).forces
    assert forces.energy > 0
    for du, dH in directions(mesh):
        above, below = (contact.at(H + k * h * dH, u + k * h * du).forces.energy for k in (1, -1))
        slope = (forces.by_displacement(n) * du).sum() + (forces.by_load * dH).sum()
        assert (above - below) / (2 * h) == pytest.approx(slope, rel=1e-7)
        above, below = (contact.at(H + k * h * dH, u).forces.energy for k in (1, -1))
        assert (above - below) / (2 * h) == pytest.approx((forces.by_load * dH).sum(), rel=1e-6)


def test_blocks_are_the_slope_of_the_forces(mesh, pressed):
    """In u by u and H, and in H by H at fixed u."""
    contact, u = pressed
    n, h = len(mesh.points), 1e-6
    blocks = contact.at(H, u).blocks("")
    rows, columns, values = blocks.entries
    for du, dH in directions(mesh):
        above, below = (contact.at(H, u + k * h * du).forces.by_displacement(n) for k in (1, -1))
        product = np.zeros(3 * n)
        np.add.at(product, rows, values * du.ravel()[columns])
        assert np.abs(product).max() > 1e-3
        np.testing.assert_allclose(
            (above - below).ravel() / (2 * h), product, atol=1e-5 * np.abs(product).max()
        )
        above, below = (contact.at(H + k * h * dH, u).forces for k in (1, -1))
        change = blocks.load_change(n, dH)
        assert np.abs(change).max() > 1e-3
        np.testing.assert_allclose(
            (above.by_displacement(n) - below.by_displacement(n)) / (2 * h),
            change,
            atol=1e-5 * np.abs(change).max(),
        )
        other = np.diag([0.3, -1.0, 0.5])
        curvature = ((above.by_load - below.by_load) / (2 * h) * other).sum()
        assert blocks.second(dH, other) == pytest.approx(curvature, rel=1e-5, abs=1e-8)


@pytest.fixture(scope="module")
def flattened(mesh):
    """A contact and a field that lays what is near a plane flat against it, a little beyond."""
    x = mesh.points @ (np.eye(3) + H)
    edge = np.diag(np.eye(3) + H) * mesh.high
    distance = np.minimum(x, edge - x)
    near, beyond, left = 0.12, 0.01, 0.1
    pressed = np.where(distance < near, left * distance - beyond, distance - (1 - left) * near - beyond)
    u = (pressed - distance) * np.where(x < edge / 2, 1.0, -1.0)
    u += np.random.default_rng(5).normal(size=u.shape) * 1e-4
    return ContactModel(mesh, stiffness=100.0, deepest=0.03), u


@pytest.mark.parametrize("parity", ["", "xy", "x", "xyz", "|xyz"])
def test_blocks_are_symmetric(flattened, parity):
    blocks = flattened[0].at(H, flattened[1]).blocks(parity)
    assert len(blocks.matrices)
    np.testing.assert_allclose(
        blocks.matrices,
        blocks.matrices.transpose(0, 2, 1),
        rtol=0,
        atol=1e-12 * np.abs(blocks.matrices).max(),
    )


@pytest.mark.parametrize("parity", ["x", "y", "z"])
def test_a_wall_and_its_reflection_move_together(mesh, flattened, parity):
    """A uniform motion along the normal of the odd planes carries both; along that of even ones it presses them."""
    n = len(mesh.points)
    blocks = flattened[0].at(H, flattened[1]).blocks(parity)
    rows, columns, values = blocks.entries
    for axis in range(3):
        motion = np.zeros((n, 3))
        motion[:, axis] = 1.0
        forces = np.zeros(3 * n)
        np.add.at(forces, rows, values * motion.ravel()[columns])
        if "xyz"[axis] == parity:
            assert np.abs(forces).max() < 1e-9 * np.abs(values).max()
        else:
            assert motion.ravel() @ forces > 0.1 * np.abs(values).max()
    assert (blocks.nodes[:, -2] >= 0).any()  # a triangle of the reflected wall: odd planes took part


def test_only_the_distance_counts(mesh, pressed):
    """The forces on the wall and on the planes, which move with it, cancel; along a plane nothing acts."""
    contact, u = pressed
    state = contact.at(H, u)
    gradient = state.forces.gradient
    np.testing.assert_allclose(gradient.sum(axis=1), 0, atol=1e-14)
    assert ((gradient != 0).any(axis=1).sum(axis=1) <= 1).all()
    # Even perturbations: of all nodes of a facet and of the plane together.
    blocks = state.blocks("")
    k = blocks.nodes.shape[1]
    together = np.tile(np.eye(3), (k, 1))
    np.testing.assert_allclose(blocks.matrices @ together, 0, atol=1e-12)


def test_uniform_deformation_touches_nothing(mesh):
    """Planes and wall move alike, however the cell is squeezed."""
    contact = ContactModel(mesh, stiffness=100.0, deepest=1.0)
    for squeeze in (np.diag([0.0, -0.6, 0.0]), np.diag([-0.5, 0.3, -0.7]), np.zeros((3, 3))):
        assert not contact.at(squeeze, np.zeros_like(mesh.points)).active


def test_energy_of_a_flat_wall(flat):
    """ε d² A / 2 of a facet that has passed its plane by d."""
    mesh, area, u = flat(1e-3)
    state = ContactModel(mesh, stiffness=50.0, deepest=1.0).at(np.zeros((3, 3)), u)
    assert state.forces.energy == pytest.approx(50.0 * 1e-6 * area / 2, rel=1e-12)
    assert state.depth == pytest.approx(1e-3, rel=1e-12)
    assert state.forces.share == pytest.approx(area / pore_surface(mesh).area, rel=1e-12)


@pytest.fixture(params=[0.0, 0.5])
def flat(request):
    """A tetrahedron above the plane Z = 0, or below Z = ½, whose face has passed it by d: mesh, area and u."""

    def make(d):
        points = np.array([[0.1, 0.1, 0.1], [0.15, 0.3, 0.1], [0.3, 0.12, 0.1], [0.2, 0.2, 0.3]])
        u = np.zeros((4, 3))
        u[:, 2] = -0.1 - d
        cells = np.array([[0, 2, 1, 3]])
        if request.param:
            points[:, 2], u = 0.5 - points[:, 2], -u
            cells = cells[:, [1, 0, 2, 3]]
        corners = points[:3]
        area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2
        return CellMesh("solid", "eighth", points, cells), area, u

    return make


@pytest.mark.parametrize("parity", ["xz", "yz", "z", "xyz"])
def test_odd_perturbations_slide_and_tilt(flat, parity):
    """Two flat walls pressed together, the upper moved by δ and the lower, its image, oppositely along the plane.

    Of δ = (δ_t, δ_n) the image takes (−δ_t, δ_n). The energy is ε/8 g² dA of the upper one with the distance g of its
    points from the lower; its second difference is what the class adds to the tangent.
    """
    depth, stiffness = 1e-3, 40.0
    mesh, area, u = flat(depth)
    contact = ContactModel(mesh, stiffness, deepest=1.2 * depth)
    x = (mesh.points + u)[:3]
    plane = 0.0 if mesh.points[:, 2].mean() < 0.25 else 0.5
    reflection = np.diag([1.0, 1.0, -1.0])
    image = (x - [0, 0, plane]) @ reflection + [0, 0, plane]
    # Mid-points of a fine subdivision of the facet, of equal area.
    n = 200
    i, j = np.mgrid[:n, :n]
    first, second = i + j < n, i + j < n - 1
    places = np.concatenate(
        [
            np.stack([i[first] + 1 / 3, j[first] + 1 / 3], 1),
            np.stack([i[second] + 2 / 3, j[second] + 2 / 3], 1),
        ]
    )
    barycentric = np.column_stack([n - places.sum(axis=1), places]) / n

    def energy(delta):
        wall = barycentric @ (x + delta)
        lower = image - delta @ reflection
        normal = np.cross(lower[1] - lower[0], lower[2] - lower[0])
        g = (wall - lower[0]) @ normal / np.linalg.norm(normal)
        return stiffness / 8 * np.mean(g**2) * area

    blocks = contact.at(np.zeros((3, 3)), u).blocks(parity)
    rows, columns, values = blocks.entries
    K = np.zeros((12, 12))
    np.add.at(K, (rows, columns), values)
    rng = np.random.default_rng(7)
    for _ in range(4):
        delta, h = rng.normal(size=(4, 3)), 2e-5
        moves = [energy(k * h * delta[:3]) for k in (-1, 0, 1)]
        expected = (moves[0] - 2 * moves[1] + moves[2]) / h**2
        assert delta.ravel() @ K @ delta.ravel() == pytest.approx(expected, rel=2e-4)
    # A slide by δ_t along a wall that tilts by ∇δ_n brings the two together by 2 δ_t·∇δ_n, against the pressure t.
    slide, tilt = np.zeros((4, 3)), np.zeros((4, 3))
    slide[:, 0] = 1.0
    tilt[:3, 2] = x[:, 0] - x[:, 0].mean()
    up = 1.0 if plane == 0 else -1.0
    share = up * stiffness * depth * area  # t δ_t·∇δ_n of one wall, with δ_t = 1 and ∂δ_n/∂x = 1
    assert slide.ravel() @ K @ tilt.ravel() == pytest.approx(share, rel=1e-6)


def test_odd_classes_have_even_planes_too(flat):
    """Under xy the plane of z is even: the penalty itself resists δ_n."""
    mesh, area, u = flat(1e-3)
    rows, columns, values = ContactModel(mesh, 40.0, 0.1).at(np.zeros((3, 3)), u).blocks("xy").entries
    K = np.zeros((12, 12))
    np.add.at(K, (rows, columns), values)
    lift = np.zeros((4, 3))
    lift[:3, 2] = 1.0
    assert lift.ravel() @ K @ lift.ravel() == pytest.approx(40.0 * area, rel=1e-12)


def test_settings_choose_the_model(mesh):
    assert make_contact_model(mesh, ContactSettings(kind="none")) is None
    contact = make_contact_model(mesh, ContactSettings(stiffness=3.0))
    assert contact.stiffness == pytest.approx(3.0 / facet_edge(mesh))
    assert contact.deepest == pytest.approx(DEEPEST * facet_edge(mesh))
