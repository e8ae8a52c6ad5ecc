"""Picture of a cell: the surface of its elements is closed and converges to the curved one; the solid is seen."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.image import imread

from porocore.report.figures import cell_picture, png_bytes
from porocore.report.figures.cell import surface_triangles

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])


#: The unit cube in six tetrahedra around the diagonal 0–7.
KUHN = np.array([[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]])


def volume_by_divergence(triangles):
    """∫ x·n dS / 3 over a closed surface of outward triangles."""
    return np.einsum("ti,ti->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6


def test_surface_of_a_cube_is_closed_and_outward():
    triangles = surface_triangles(CUBE, KUHN)
    assert len(triangles) == 12
    assert volume_by_divergence(triangles) == pytest.approx(1.0, rel=1e-14)


def ball():
    """An octahedron of eight quadratic tetrahedra, the middles of its edges pushed out onto the unit sphere."""
    axis = np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3))])
    points, cells = list(axis), []
    number: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in number:
            point = (axis[a] + axis[b]) / 2
            number[key] = len(points)
            points.append(point if 6 in key else point / np.linalg.norm(point))
        return number[key]

    for a in (0, 3):
        for b in (1, 4):
            for c in (2, 5):
                corners = [6, a, b, c]
                if np.linalg.det(axis[corners[1:]]) < 0:
                    corners[2:] = [c, b]
                edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
                cells.append(corners + [middle(corners[i], corners[j]) for i, j in edges])
    return np.array(points), np.array(cells)


def volume_by_quadrature(points, cells):
    """∫ det J over quadratic tetrahedra, exactly, by a Gauss rule on the collapsed cube."""
    x, w = np.polynomial.legendre.leggauss(4)
    x, w = (x + 1) / 2, w / 2
    volume = 0.0
    for a, wa in zip(x, w, strict=True):
        for b, wb in zip(x, w, strict=True):
            for c, wc in zip(x, w, strict=True):
                r, s, t = a, b * (1 - a), c * (1 - a) * (1 - b)
                weight = wa * wb * wc * (1 - a) ** 2 * (1 - b)
                q = 1 - r - s - t
                # Gradients of the shape functions in VTK order with respect to (r, s, t).
                dq, dr, ds, dt = -np.ones(3), *np.eye(3)
                corners = [(4 * v - 1) * dv for v, dv in ((q, dq), (r, dr), (s, ds), (t, dt))]
                pairs = (((q, dq), (r, dr)), ((r, dr), (s, ds)), ((s, ds), (q, dq)))
                pairs += (((q, dq), (t, dt)), ((r, dr), (t, dt)), ((s, ds), (t, dt)))
                middles = [4 * (v * dw_ + w_ * dv) for (v, dv), (w_, dw_) in pairs]
                jacobian = np.einsum("eni,nj->eij", points[cells], np.array(corners + middles))
                volume += weight * np.linalg.det(jacobian).sum()
    return volume


def test_surface_of_curved_tetrahedra(monkeypatch):
    """The volume under the flat pieces converges with their number to that of the curved elements."""
    points, cells = ball()
    exact = volume_by_quadrature(points, cells)
    assert exact > 1.5 * 4 / 3  # the flat octahedron has 4/3
    error = []
    for pieces in (4, 8):
        monkeypatch.setattr("porocore.report.figures.cell.PIECES", pieces)
        triangles = surface_triangles(points, cells)
        assert len(triangles) == 8 * pieces**2
        error.append(exact - volume_by_divergence(triangles))
    assert np.log2(error[0] / error[1]) == pytest.approx(2, abs=0.1)


def test_cell_picture_shows_the_solid():
    """Seen from outside, the picture is filled where the cube is and white elsewhere."""
    image = imread(io.BytesIO(png_bytes(cell_picture(CUBE, KUHN), dpi=40)))[..., :3]
    height, width, _ = image.shape
    assert (image[height // 2, width // 2] < 0.95).any()
    assert (image[[0, 0, -1, -1], [0, -1, 0, -1]] == 1).all()
    white = (image == 1).all(axis=2).mean()
    assert 0.15 < white < 0.7
