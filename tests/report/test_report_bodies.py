"""The figure of a deformed body: curved facets, and ticks that keep clear of each other."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import ELEMENTS, boundary_facets
from porocore.report.figures.body import _ticks, body_figure, front, pieces


@pytest.mark.parametrize("nodes", [27, 10])
@pytest.mark.parametrize("parts", [2, 4])
def test_pieces_lie_on_the_quadratic_facet_and_cover_it_once(nodes, parts):
    element = ELEMENTS[nodes]
    for facet in element.facets:
        flat = element.nodes[facet]
        bent = flat + 0.1 * (flat**2)[:, [1, 2, 0]]
        values, polygons, outline = pieces(len(facet), parts)
        places = values @ flat
        np.testing.assert_allclose(values @ bent, places + 0.1 * (places**2)[:, [1, 2, 0]], atol=1e-14)
        area = area_of(flat[: 4 if nodes == 27 else 3])
        found = [area_of(places[polygon]) for polygon in polygons]
        np.testing.assert_allclose(np.sum(found, axis=0), area, atol=1e-14)  # all turned as the facet is
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.linalg.norm(area) / len(found))
        np.testing.assert_allclose(area_of(places[outline[:-1]]), area, atol=1e-14)
        assert outline[0] == outline[-1]


def area_of(polygon):
    """The area of a plane polygon (k, 3) as a vector."""
    return np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0) / 2


def test_three_sides_of_a_box_face_the_viewer():
    mesh = Box(size=(1, 2, 3), elements=(1, 2, 3)).make()
    facets = mesh.points[boundary_facets(mesh.cells)]
    seen = facets[front(facets, (22, -145))]
    middles = seen.mean(axis=1)
    on = [np.isclose(middles[:, 0], 0), np.isclose(middles[:, 1], 0), np.isclose(middles[:, 2], 3)]
    assert [int(side.sum()) for side in on] == [6, 3, 2]
    assert len(seen) == 11


def test_the_corner_in_front_has_one_number_and_a_short_axis_too():
    assert _ticks(0.0, 10.0, 1.0, open_end=False) == [0, 2.5, 5, 7.5, 10]
    assert _ticks(0.0, 10.0, 1.0, open_end=True) == [2.5, 5, 7.5, 10]
    assert _ticks(0.0, 0.5, 0.12, open_end=True) == [0.4]
    assert _ticks(-1.0, 1.0, 0.9, open_end=True)[0] > -1


def test_a_pressure_that_is_round_off_is_drawn_as_zero(column):
    solution = column()
    profile, n = solution.profiles[0], len(solution.points)
    noise = 1e-15 * np.random.default_rng(0).normal(size=n)
    for p, told in ((noise, 0.0), (0.3 + noise, 0.3)):
        figure = body_figure(solution, replace(profile, p=p))
        (bar,) = [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]
        np.testing.assert_allclose(bar.get_yticks(), [told], rtol=0, atol=1e-12)
    varying = body_figure(solution, replace(profile, p=np.linspace(0, 1e-3, n)))
    assert len(varying.axes[-1].get_yticks()) > 2
