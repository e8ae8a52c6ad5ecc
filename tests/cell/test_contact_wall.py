"""The pore wall as points with weights: the rule on triangles, shape functions, areas."""

from math import factorial

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.pairs import pore_surface
from porocore.cell.contact.wall_contact import facet_edge
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.meshing.tetrahedra import LARGEST_DEGREE, shape_functions, triangle_rule

RADIUS = 0.25
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
NODES = {3: CORNERS, 6: np.concatenate([CORNERS, [[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]]])}


@pytest.mark.parametrize("degree", range(1, LARGEST_DEGREE + 1))
def test_rule_is_exact(degree):
    """∫ xⁱ yʲ over the unit triangle is i! j! / (i + j + 2)!."""
    points, weights = triangle_rule(degree)
    assert (weights > 0).all()
    assert (points > 0).all()
    assert (points.sum(axis=1) < 1).all()
    for i in range(degree + 1):
        for j in range(degree + 1 - i):
            exact = factorial(i) * factorial(j) / factorial(i + j + 2)
            assert weights @ (points[:, 0] ** i * points[:, 1] ** j) == pytest.approx(exact, rel=1e-13)


def test_rule_is_no_better_than_it_says():
    """So that the test above is one of the degree: with n² points x^(2n) is missed."""
    points, weights = triangle_rule(3)
    assert abs(weights @ points[:, 0] ** 4 - 2 * factorial(4) / factorial(6) / 2) > 1e-4


@pytest.mark.parametrize("degree", [0, LARGEST_DEGREE + 1])
def test_rule_refuses_other_degrees(degree):
    with pytest.raises(ValueError, match=f"expected a degree from 1 to {LARGEST_DEGREE}, got {degree}"):
        triangle_rule(degree)


@pytest.mark.parametrize("nodes", [3, 6])
def test_shape_functions(nodes):
    points = np.random.default_rng(0).dirichlet(np.ones(3), 20)[:, :2]
    N, dN = shape_functions(points, nodes)
    assert N.shape == (20, nodes)
    assert dN.shape == (20, nodes, 2)
    np.testing.assert_allclose(N.sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(dN.sum(axis=1), 0, atol=1e-13)
    np.testing.assert_allclose(N @ NODES[nodes], points, atol=1e-14)
    np.testing.assert_allclose(shape_functions(NODES[nodes], nodes)[0], np.eye(nodes), atol=1e-14)
    h = 1e-6
    for s in range(2):
        step = h * np.eye(2)[s]
        above, below = (shape_functions(points + k * step, nodes)[0] for k in (1, -1))
        np.testing.assert_allclose(dN[:, :, s], (above - below) / (2 * h), atol=1e-9)


def channel(size, element, axes="z", domain="eighth"):
    cell = Cell(
        geometry=OrthogonalChannels(radius=RADIUS, axes=axes), mesh=MeshSettings(size=size, element=element)
    )
    return cell.make_mesh("solid", domain)


@pytest.mark.parametrize(("element", "order"), [("linear", 2.0), ("quadratic-curved", 4.0)])
def test_area_of_one_channel_converges(element, order):
    """2πr per unit of length; facets of chords miss it by (ratio of sine and angle) O(h²), curved ones by O(h⁴)."""
    exact = 2 * np.pi * RADIUS / 8
    sizes = np.array([0.2, 0.1, 0.05])
    errors = [abs(pore_surface(channel(size, element)).area - exact) / exact for size in sizes]
    edges = [facet_edge(channel(size, element)) for size in sizes]
    assert errors[0] < 0.03
    slope = np.polyfit(np.log(edges), np.log(errors), 1)[0]
    assert slope > order - 0.5


def test_whole_cell_has_eight_times_the_wall_of_the_eighth():
    eighth, whole = (
        pore_surface(channel(0.2, "quadratic-curved", "xyz", domain)) for domain in ("eighth", "whole")
    )
    assert whole.area == pytest.approx(8 * eighth.area, rel=1e-12)
    assert eighth.area == pytest.approx(exact_wall() / 8, rel=2e-3)


def exact_wall():
    """Of three channels, by integration over the angle: what of a channel's wall lies within another is lost.

    A point of the z channel's wall at angle a has |x| = r |cos a|, |y| = r |sin a|. It is inside the x channel where
    y² + z² < r², |z| < r |cos a|, and inside the y channel where |z| < r |sin a|: the larger of the two is lost.
    """
    a = (np.arange(100_000) + 0.5) / 100_000 * 2 * np.pi
    lost = 2 * RADIUS * np.maximum(abs(np.cos(a)), abs(np.sin(a)))
    return 3 * RADIUS * 2 * np.pi * (1 - lost.mean())


@pytest.mark.parametrize("size", [0.2, 0.1])
def test_edge_of_equilateral_facets(size):
    """h is that of as many equilateral triangles of the same area."""
    mesh = channel(size, "linear")
    h = facet_edge(mesh)
    assert len(mesh.wall) * np.sqrt(3) / 4 * h**2 == pytest.approx(pore_surface(mesh).area)
    assert 0.4 * size < h < 1.6 * size
