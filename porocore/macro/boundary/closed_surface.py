"""Closed triangulated surfaces of rigid indenters: reading, checks, and the distance from them by VTK's search."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from porocore.core.echo import echo_path
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

#: Corners of triangles closer than this share of the surface's length are one.
SAME_PLACE = 1e-6
#: Barycentric coordinate below which the nearest point of a triangle lies on its edge.
ON_EDGE = 1e-10
#: Distance from an edge, as a share of the surface's length, below which the normal is that of the edge itself.
TOUCHING = 1e-14


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """Closed surface of triangles whose normals point outward.

    Attributes
    ----------
    points : (v, 3)
        Corners, each once.
    triangles : (t, 3)
        Corners of the triangles, counter-clockwise seen from outside.
    """

    points: Array
    triangles: IntArray

    @cached_property
    def normals(self) -> Array:
        """(t, 3) outward unit normals."""
        a, b, c = self.points[self.triangles].swapaxes(0, 1)
        n = np.cross(b - a, c - a)
        return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))

    @cached_property
    def length(self) -> float:
        """Largest extent along an axis."""
        return float(np.ptp(self.points, axis=0).max())

    @cached_property
    def edge_normals(self) -> Array:
        """(t, 3, 3) sum of the normals of the two triangles at the edge opposite each corner."""
        edges = np.sort(self.triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
        _, number = np.unique(edges, axis=0, return_inverse=True)
        number = number.ravel()
        sums = np.zeros((number.max() + 1, 3))
        np.add.at(sums, number, np.repeat(self.normals, 3, axis=0))
        return np.asarray(sums[number].reshape(-1, 3, 3))

    @cached_property
    def corner_normals(self) -> Array:
        """(v, 3) normals of the triangles at each corner, weighted by their angles there.

        Their sign tells inside from outside [Bærentzen & Aanæs 2005].
        """
        x = self.points[self.triangles]
        sums = np.zeros(self.points.shape)
        for k in range(3):
            one, other = x[:, (k + 1) % 3] - x[:, k], x[:, (k + 2) % 3] - x[:, k]
            sine = np.linalg.norm(np.cross(one, other), axis=1)
            angle = np.arctan2(sine, np.einsum("ti,ti->t", one, other))
            np.add.at(sums, self.triangles[:, k], angle[:, None] * self.normals)
        return sums

    @cached_property
    def _search(self) -> Any:
        """Search tree of VTK."""
        try:
            from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
            from vtkmodules.vtkCommonCore import vtkPoints
            from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkStaticCellLocator
        except ImportError as error:
            raise ConfigurationError(
                "macro.contact: the distance from a surface of triangles is found by VTK, which cannot be imported "
                f"here ({error}); pip install vtk, or take another kind of shape"
            ) from None
        points, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(self.points, dtype=float), deep=True))
        starts, corners = np.arange(0, 3 * len(self.triangles) + 1, 3), self.triangles.ravel()
        cells.SetData(
            *(numpy_to_vtkIdTypeArray(each.astype(np.int64), deep=True) for each in (starts, corners))
        )
        surface.SetPoints(points)
        surface.SetPolys(cells)
        found = vtkStaticCellLocator()
        found.SetDataSet(surface)
        found.BuildLocator()
        return found

    def nearest(self, places: Array) -> tuple[IntArray, Array]:
        """Return the triangle (n,) nearest to each of ``places`` (n, 3), and its nearest point (n, 3)."""
        from vtkmodules.vtkCommonCore import mutable
        from vtkmodules.vtkCommonDataModel import vtkGenericCell

        search, cell, at = self._search, vtkGenericCell(), [0.0, 0.0, 0.0]
        number, part, squared = mutable(0), mutable(0), mutable(0.0)
        triangles, points = np.empty(len(places), dtype=np.int64), np.empty((len(places), 3))
        for row, place in enumerate(places.tolist()):
            search.FindClosestPoint(place, at, cell, number, part, squared)
            triangles[row], points[row] = int(number), at
        return triangles, points

    def distance(self, places: Array) -> tuple[Array, Array, Array]:
        """Return the signed distance (n,) of ``places`` (n, 3), its gradient (n, 3) and Hessian (n, 3, 3).

        It is the distance from the plane of a triangle, from the line of an edge, or from a corner.
        """
        triangle, at = self.nearest(places)
        x, plane = self.points[self.triangles[triangle]], self.normals[triangle]
        area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
        shares = np.stack(
            [
                np.einsum("ni,ni->n", np.cross(x[:, (k + 1) % 3] - at, x[:, (k + 2) % 3] - at), plane) / area
                for k in range(3)
            ],
            axis=1,
        )
        off = shares <= ON_EDGE
        count = off.sum(axis=1)
        gap = np.einsum("ni,ni->n", places - x[:, 0], plane)
        normal, hessian = plane.copy(), np.zeros((len(places), 3, 3))
        for among, outward, of_edge in (
            (np.flatnonzero(count == 1), self.edge_normals, True),
            (np.flatnonzero(count >= 2), self.corner_normals, False),
        ):
            if not len(among):
                continue
            own = x[among]
            rows = np.arange(len(among))
            if of_edge:
                k = off[among].argmax(axis=1)
                start = own[rows, (k + 1) % 3]
                along = own[rows, (k + 2) % 3] - start
                along /= np.linalg.norm(along, axis=1, keepdims=True)
                pseudo = outward[triangle[among], k]
                arms = places[among] - start
                arms = arms - np.einsum("ni,ni->n", arms, along)[:, None] * along
                free = np.eye(3) - along[:, :, None] * along[:, None, :]
            else:
                k = shares[among].argmax(axis=1)
                pseudo = outward[self.triangles[triangle[among], k]]
                arms = places[among] - own[rows, k]
                free = np.broadcast_to(np.eye(3), (len(among), 3, 3))
            length = np.linalg.norm(arms, axis=1)
            sign = np.where(np.einsum("ni,ni->n", arms, pseudo) < 0, -1.0, 1.0)
            far = length > TOUCHING * self.length
            unit = np.where(
                far[:, None],
                (sign / np.maximum(length, TOUCHING * self.length))[:, None] * arms,
                pseudo / np.linalg.norm(pseudo, axis=1, keepdims=True),
            )
            signed = sign * np.maximum(length, TOUCHING * self.length)
            gap[among], normal[among] = sign * length, unit
            hessian[among] = (free - unit[:, :, None] * unit[:, None, :]) / signed[:, None, None]
        return gap, normal, hessian


@lru_cache(maxsize=4)
def read_surface(path: Path, sha256: str, scale: float) -> ClosedSurface:
    """Return the surface of a file, whose triangles may be turned inward all together.

    Parameters
    ----------
    path
        File of triangles that meshio reads, such as STL.
    sha256
        Hash of its content.
    scale
        Factor of its coordinates.

    Raises
    ------
    ValueError
        It cannot be read, or is not one closed surface.
    """
    points, triangles = _triangles(path)
    if not len(triangles):
        raise ValueError(f"{echo_path(path)} has no triangles; save the surface as STL")
    if not np.isfinite(points).all():
        raise ValueError(f"{echo_path(path)} has coordinates that are not finite")
    points, triangles = _merged(points * scale, triangles)
    x = points[triangles]
    size = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    surface = ClosedSurface(points, triangles[size > 0])
    edges = surface.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    if (count != 2).any() or not len(count):
        open_, more = int((count == 1).sum()), int((count > 2).sum())
        said = (
            f"{open_} belong to one triangle alone" if open_ else f"{more} belong to more than two triangles"
        )
        raise ValueError(
            f"{echo_path(path)} is not closed: of its {len(count)} edges {said}; close the surface in the program "
            "that wrote it, for only a closed one has an inside"
        )
    _, count = np.unique(edges, axis=0, return_counts=True)
    if (count != 1).any():
        raise ValueError(
            f"{echo_path(path)}: the triangles at {int((count > 1).sum())} edges turn opposite ways, so that inside "
            "and outside are not known; unify the normals in the program that wrote it"
        )
    x = surface.points[surface.triangles]
    inward = np.einsum("ti,ti->", x[:, 0], np.cross(x[:, 1], x[:, 2])) < 0
    return ClosedSurface(points, surface.triangles[:, ::-1]) if inward else surface


def _triangles(path: Path) -> tuple[Array, IntArray]:
    import meshio  # heavy, and needed here only

    try:
        mesh = meshio.read(path)
        points = np.asarray(mesh.points, dtype=float)
        found = [np.asarray(block.data, dtype=np.int64) for block in mesh.cells if block.type == "triangle"]
    except (Exception, SystemExit) as error:  # noqa: BLE001 - readers raise whatever happens to them
        raise ValueError(
            f"{echo_path(path)} cannot be read as a surface of triangles ({str(error).strip() or 'it is damaged'}); "
            "save it as STL"
        ) from None
    return points, np.concatenate([np.empty((0, 3), dtype=np.int64), *found])


def _merged(points: Array, triangles: IntArray) -> tuple[Array, IntArray]:
    """Return points of which none are at one place, and the triangles that are left of those between them."""
    length = float(np.ptp(points, axis=0).max())
    pairs = cKDTree(points).query_pairs(SAME_PLACE * length, output_type="ndarray")
    graph = sparse.csr_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points))
    )
    _, group = sparse.csgraph.connected_components(graph, directed=False)
    _, first = np.unique(group, return_index=True)
    triangles = group[triangles]
    a, b, c = triangles.T
    return points[first], triangles[(a != b) & (b != c) & (c != a)]
