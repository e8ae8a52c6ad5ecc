"""Distances from triangles, their derivatives, and the contact of a wall with itself that is made of them."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.pairs import FACE, VERTEX, Pairs, distance_derivatives, nearest, nearest_only
from porocore.cell.contact.wall_contact import ContactModel


def random_pairs(n=3000, seed=0):
    random = np.random.default_rng(seed)
    return random.normal(size=(n, 3)), random.normal(size=(n, 3, 3))


def test_distance_is_that_of_the_nearest_of_many_points():
    points, triangles = random_pairs(60)
    found, where, _ = nearest(points, triangles)
    weights = np.random.default_rng(1).dirichlet([0.4, 0.4, 0.4], 40_000)
    for point, triangle, distance in zip(points, triangles, found, strict=True):
        best = np.linalg.norm(weights @ triangle - point, axis=1).min()
        assert best - 0.05 < abs(distance) <= best + 1e-12
    assert {FACE, 1, 2, 3, VERTEX, 5, 6} == set(where)


def test_sign_is_the_side_of_the_normal():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.array([[0.2, 0.2, 0.3], [0.2, 0.2, -0.3], [-0.3, 0.2, 0.4], [-0.3, 0.2, -0.4]])
    distance, where, cosine = nearest(points, np.broadcast_to(triangle, (4, 3, 3)))
    np.testing.assert_allclose(distance, [0.3, -0.3, 0.5, -0.5])
    np.testing.assert_array_equal(where, [0, 0, 3, 3])
    np.testing.assert_allclose(cosine, [1, 1, 0.8, 0.8])


def test_derivatives_against_differences():
    points, triangles = random_pairs()
    z = np.concatenate([points, triangles.reshape(-1, 9)], axis=1)
    _, where, _ = nearest(points, triangles)

    def at(z):
        return distance_derivatives(z[:, :3], z[:, 3:].reshape(-1, 3, 3), where)

    g, slope, bend = at(z)
    np.testing.assert_allclose(g, nearest(points, triangles)[0], atol=1e-13)
    # Slivers and points next to a vertex have derivatives too large for a difference.
    fair = np.abs(bend).max(axis=(1, 2)) < 50
    assert fair.mean() > 0.8
    h = 1e-6
    for k in range(12):
        step = h * np.eye(12)[k]
        up, down = at(z + step), at(z - step)
        np.testing.assert_allclose(((up[0] - down[0]) / (2 * h) - slope[:, k])[fair], 0, atol=2e-8)
        np.testing.assert_allclose(((up[1] - down[1]) / (2 * h) - bend[:, k])[fair], 0, atol=1e-5)
    np.testing.assert_allclose(bend, bend.swapaxes(1, 2), atol=1e-9 * np.abs(bend).max())


def test_distance_is_continuous_over_a_groove():
    """Seen from inside the solid a groove of the wall is convex: the distance goes over its edge smoothly."""
    edge = [[0.0, -1, 0], [0.0, 1, 0]]
    left = np.array([edge[0], edge[1], [-1.0, 0, 0.3]])
    right = np.array([edge[1], edge[0], [1.0, 0, 0.3]])
    x = np.linspace(-0.05, 0.05, 4001)
    points = np.column_stack([x, 0 * x, -0.1 + 0 * x])
    one, other = (nearest(points, np.broadcast_to(t, (len(x), 3, 3)))[0] for t in (left, right))
    distance = np.minimum(np.abs(one), np.abs(other))
    slope = np.diff(distance) / np.diff(x)
    assert np.abs(np.diff(distance)).max() < 2e-5
    assert np.abs(np.diff(slope)).max() < 5e-3


def pairs_of(number, distance):
    m = len(number)
    empty = np.zeros((m, 3), dtype=np.int64)
    zero = np.zeros(m, dtype=np.int64)
    return Pairs(np.zeros((m, 3)), np.ones(m), empty, empty, zero, np.array(number), np.array(distance))


def test_a_point_touches_once_however_many_images_it_is_near():
    one, other = pairs_of([3, 5, 8], [0.2, 0.1, 0.3]), pairs_of([5, 3, 9], [0.05, 0.4, 0.1])
    first, second = nearest_only([one, other])
    assert list(first.number) == [3, 8]
    assert sorted(second.number) == [5, 9]


@pytest.fixture(scope="module")
def folded():
    """The whole cell compressed until its ridges overlap by a made-up displacement; the walls then touch."""
    cell = Cell(mesh={"size": 0.3, "element": "linear"})
    mesh = cell.make_mesh("solid", "whole")
    H = np.diag([0.0, -0.75, 0.0])
    random = np.random.default_rng(3)
    u = 1e-3 * random.normal(size=mesh.points.shape)
    u = u[np.unique(mesh.periodic_class, return_index=True)[1]][mesh.periodic_class]
    # A bulge of the lower and upper walls of the channels towards each other.
    u[:, 1] -= 0.16 * np.sin(2 * np.pi * mesh.points[:, 1]) * np.cos(np.pi * mesh.points[:, 0]) ** 2
    contact = ContactModel(mesh, stiffness=40.0, deepest=0.05)
    state = contact.at(H, u)
    assert state.active
    return contact, state, H, u


def test_forces_and_second_derivatives_of_walls(folded):
    contact, state, H, u = folded
    n, h = len(u), 1e-6
    direction = np.random.default_rng(5).normal(size=u.shape)
    dH = np.random.default_rng(6).normal(size=(3, 3))
    up, down = (contact.at(H + s * h * dH, u + s * h * direction, state.pairs) for s in (1, -1))
    slope = (state.forces.by_displacement(n) * direction).sum() + (state.forces.by_load * dH).sum()
    assert (up.forces.energy - down.forces.energy) / (2 * h) == pytest.approx(slope, rel=1e-6)
    change = (up.forces.by_displacement(n) - down.forces.by_displacement(n)) / (2 * h)
    rows, columns, values = state.blocks("").entries
    bent = np.bincount(rows, values * direction.ravel()[columns], 3 * n).reshape(n, 3)
    bent += state.blocks("").load_change(n, dH)
    np.testing.assert_allclose(change, bent, atol=1e-5 * np.abs(bent).max())
    np.testing.assert_allclose(state.blocks("").matrices, state.blocks("").matrices.swapaxes(1, 2), atol=1e-9)


def test_walls_push_each_other_apart(folded):
    """Action and reaction: the forces add up to nothing, and so do their moments but for the periodic images."""
    contact, state, _, u = folded
    forces = state.forces.by_displacement(len(u))
    assert np.abs(forces).max() > 0
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-12 * np.abs(forces).sum())
    moved = contact.at(folded[2], u + np.array([0.1, -0.2, 0.3]), state.pairs)
    assert moved.forces.energy == pytest.approx(state.forces.energy, rel=1e-10)


def test_the_undeformed_wall_touches_nothing():
    mesh = Cell(mesh={"size": 0.3, "element": "linear"}).make_mesh("solid", "whole")
    state = ContactModel(mesh, 40.0, 0.05).at(np.zeros((3, 3)), np.zeros_like(mesh.points))
    assert not state.active
    assert state.depth == 0
