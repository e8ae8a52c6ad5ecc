"""Picture of the cell's solid, shaded; surface triangles of a tetrahedral mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from porocore.cell.meshing.tetrahedra import boundary_facets
from porocore.report.figures.style import new_figure, styled
from porocore.states import Array, IntArray

#: Pieces of each edge of a curved facet.
PIECES = 4
SOLID = to_rgb("#c9a27a")
WALL = to_rgb("#5b8db8")
VIEW = {"elev": 24.0, "azim": -58.0}
#: Of a cube; a longer box is drawn smaller.
ZOOM = 1.1
#: Towards the light, in the frame of the picture.
LIGHT = np.array([0.25, -0.75, 0.9])


@styled
def cell_picture(points: Array, cells: IntArray) -> Figure:
    """Draw the surface of a tetrahedral mesh, shaded: faces of its box in one colour, pore surface in another.

    Parameters
    ----------
    points : (N, 3)
        Nodes.
    cells : (M, 4) or (M, 10)
        Linear or quadratic tetrahedra in VTK order, positively oriented.
    """
    triangles = surface_triangles(points, cells)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1).clip(1e-300)[:, None]
    seen = normals @ _towards_viewer() > 0  # the back of a facet is hidden by solid in front of it
    triangles, normals = triangles[seen], normals[seen]
    figure = new_figure(4.2, 4.2)
    axes = figure.add_subplot(projection="3d", proj_type="ortho", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    bright = 0.5 + 0.5 * (normals @ (LIGHT / np.linalg.norm(LIGHT))).clip(0, 1)
    face = _on_box(triangles, points)
    # A face of the box that the viewer sees has nothing in front of it, so the walls are painted first.
    for rows, colour, level in ((~face, WALL, 1), (face, SOLID, 2)):
        colours = np.array(colour) * bright[rows, None]
        axes.add_collection3d(
            Poly3DCollection(
                triangles[rows],
                facecolors=colours,
                edgecolors=colours,
                linewidths=0.3,
                zorder=level,
                rasterized=True,
            )
        )
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple(high - low), zoom=ZOOM * min(1.0, _extent(np.ones(3)) / _extent(high - low)))
    axes.view_init(**VIEW)
    axes.set_axis_off()
    return figure


def surface_triangles(points: Array, cells: IntArray) -> Array:
    """Return triangles (k, 3, 3) of the surface, outward; curved ones in pieces."""
    facets = points[boundary_facets(cells)]
    return facets if cells.shape[1] == 4 else _pieces(facets)


def _pieces(facets: Array) -> Array:
    """Return flat triangles (k · PIECES², 3, 3) of quadratic ones (k, 6, 3), so that curved walls look curved."""
    n = PIECES
    up = [((i, j), (i + 1, j), (i, j + 1)) for i in range(n) for j in range(n - i)]
    down = [((i + 1, j), (i + 1, j + 1), (i, j + 1)) for i in range(n - 1) for j in range(n - 1 - i)]
    s, t = np.moveaxis(np.array(up + down, dtype=float) / n, -1, 0)
    r = 1 - s - t
    shape = np.stack([r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r])
    pieces: Array = np.einsum("apc,kax->kpcx", shape, facets).reshape(-1, 3, 3)
    return pieces


def _extent(edges: Array) -> float:
    """Return the larger of width and height of a box in the picture, over its diagonal."""
    azimuth = np.radians(VIEW["azim"])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(_towards_viewer(), right)
    return float(max(np.abs(right) @ edges, np.abs(up) @ edges) / np.linalg.norm(edges))


def _towards_viewer() -> Array:
    elevation, azimuth = np.radians(VIEW["elev"]), np.radians(VIEW["azim"])
    return np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def _on_box(triangles: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Return the triangles (k,) bool that lie in a face of the bounding box."""
    low, high = points.min(axis=0), points.max(axis=0)
    slack = 1e-6 * float((high - low).max())
    flat = (np.abs(triangles - low) < slack).all(axis=1) | (np.abs(triangles - high) < slack).all(axis=1)
    on_box: npt.NDArray[np.bool_] = flat.any(axis=1)
    return on_box
