"""Mesh quality of a cell as text; overlap of the deformed pore wall with planes or the solid.

Under strong compression the ridges where two channels meet crease and fold through their mirror plane while J stays
positive everywhere; without contact such a state has no meaning.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from porocore.cell.cell import Cell
from porocore.cell.geometry.pore_geometry import CUBE, Sides
from porocore.cell.level_sets.agreement import grains
from porocore.cell.meshing.connectivity import Piece, blocked, pieces, why_disconnected
from porocore.cell.meshing.mesh import CellMesh, make_mesh
from porocore.cell.meshing.tetrahedra import EDGES, FACETS, least_stretch, shape_functions, volume
from porocore.states import Array, IntArray

#: Sentence on a cell with closed pores.
CLOSED_PORES = "closed pores: their fluid bears the same pressure p as that of the open ones"


@dataclass(frozen=True)
class PhaseQuality:
    """Mesh quality of one phase of the whole cell.

    Attributes
    ----------
    share
        Volume of the mesh with its curved elements.
    tetrahedra, nodes
        Numbers of elements and nodes.
    regions
        Share of each region by name, where there are several.
    smallest_angle, low_angle
        Smallest dihedral angle, and its quantile of 1 % over the elements [degrees].
    least_stretch
        Smallest volume element of a curved tetrahedron over that of the same one with straight edges.
    pieces
        Connected pieces.
    """

    share: float
    tetrahedra: int
    nodes: int
    regions: dict[str, float]
    smallest_angle: float
    low_angle: float
    least_stretch: float
    pieces: tuple[Piece, ...]


@dataclass(frozen=True)
class MeshQuality:
    """Mesh quality of one whole cell.

    Attributes
    ----------
    description
        Description of the geometry.
    unfolding
        Part that was meshed.
    porosity
        Porosity of the geometry; that of a mesh is the share of the fluid, or the rest of that of the solid.
    solid, fluid
        Quality of each phase; None for a phase that is absent.
    unmatched
        Number of facets on the faces of the cell without a partner on the opposite face.
    disconnected
        Reason why the solid has no stiffness; empty if it has.
    blocked
        Axes out of "xyz" along which nothing can flow.
    sides
        Sides of the cell, in units of the cube root of its volume.
    notes
        Remarks of the geometry, such as what was removed from an image.
    warnings
        What is suspect in the geometry, such as an image that is not segmented.
    """

    description: str
    unfolding: str
    porosity: float
    solid: PhaseQuality | None
    fluid: PhaseQuality | None
    unmatched: int
    disconnected: str
    blocked: str
    sides: Sides
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def measure_mesh_quality(cell: Cell) -> MeshQuality:
    """Mesh both phases and measure their quality.

    Raises
    ------
    PorocoreError
        The cell cannot be meshed.
    """
    single = cell.model_copy(update={"supercell": (1, 1, 1)})
    solid, fluid = single.make_mesh("solid", "whole"), single.make_mesh("fluid", "whole")
    of_solid, of_fluid = _phase(solid), _phase(fluid)
    return MeshQuality(
        cell.geometry.description,
        cell.geometry.unfolding,
        cell.geometry.porosity,
        of_solid,
        of_fluid,
        sum(unmatched(both) for both in _sizes(single)),
        cell.geometry.disconnected or why_disconnected(of_solid.pieces if of_solid else ()),
        blocked(of_fluid.pieces if of_fluid else ()),
        cell.geometry.sides,
        (*cell.geometry.notes, *grains(single)),
        cell.geometry.warnings,
    )


def _sizes(cell: Cell) -> list[list[CellMesh]]:
    """Return the meshes of both phases for each size that the cell's mesh has."""
    sizes = {cell.mesh.size, cell.mesh.fluid_size}
    settings = [cell.mesh.model_copy(update={"size": size, "fluid_size": size}) for size in sorted(sizes)]
    return [
        [make_mesh(cell.geometry, one, phase, "whole") for phase in ("solid", "fluid")] for one in settings
    ]


def _phase(mesh: CellMesh) -> PhaseQuality | None:
    if not len(mesh.cells):
        return None
    angles = dihedral_angles(mesh.points, mesh.cells).min(axis=1)
    names = mesh.region_names if len(mesh.region_names) > 1 else ()
    regions = {name: volume(mesh.points, mesh.cells[mesh.regions == i]) for i, name in enumerate(names)}
    return PhaseQuality(
        volume(mesh.points, mesh.cells),
        len(mesh.cells),
        len(mesh.points),
        regions,
        float(angles.min()),
        float(np.quantile(angles, 0.01)),
        float(least_stretch(mesh.points, mesh.cells).min()),
        pieces(mesh),
    )


def dihedral_angles(points: Array, cells: IntArray) -> Array:
    """Return the six angles between the facets of each tetrahedron with straight edges, (M, 6) [degrees]."""
    corners = points[cells[:, :4]][:, FACETS[:, :3]]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    cosines = -np.einsum("mei,mei->me", normals[:, EDGES[:, 0]], normals[:, EDGES[:, 1]])
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


def unmatched(meshes: Sequence[CellMesh]) -> int:
    """Return the number of facets on the faces of the whole cell without a partner on the opposite face.

    ``meshes`` are those of both phases, of one size: where the wall lies in a face, the partner is of the other phase.
    """
    facets = np.concatenate([mesh.points[mesh.boundary] for mesh in meshes])
    alone, half = 0, meshes[0].high
    for axis in range(3):
        on_face = (np.abs(facets[:, :, axis]) == half[axis]).all(axis=1)
        places = np.delete(facets[on_face], axis, axis=2)
        nodes = np.unique(places.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(places.shape[:2])
        _, count = np.unique(np.sort(nodes, axis=1), axis=0, return_counts=True)
        alone += int((count == 1).sum())
    return alone


def quality_lines(quality: MeshQuality) -> list[str]:
    """Return the mesh quality as lines of text."""
    lines = [f"geometry: {quality.description}"]
    lines += [f"geometry: {note}" for note in quality.notes]
    lines += [f"note: geometry: {warning}" for warning in quality.warnings]
    if quality.sides != CUBE:
        lines.append(
            f"sides: {', '.join(f'{side:.4g}' for side in quality.sides)} along x, y, z, in units of the cube root of "
            "the cell's volume, as all lengths of the cell"
        )
    part = {"wedge": "a 48th", "eighth": "an eighth", "whole": "the whole cell"}[quality.unfolding]
    # That of a run is the solid's; the fluid's may be finer.
    meshes = f"; of the solid's mesh {1 - quality.solid.share:.6f}" if quality.solid else ""
    meshes += f"; of the fluid's mesh {quality.fluid.share:.6f}" if quality.fluid else ""
    lines.append(f"porosity: {quality.porosity:.6f}{meshes}")
    lines.append(f"meshed: {part}" + (", unfolded by mirrors" if quality.unfolding != "whole" else ""))
    for name, phase in (("solid", quality.solid), ("fluid", quality.fluid)):
        if phase is None:
            lines.append(f"{name}: none")
            continue
        eighth = f" ({phase.tetrahedra // 8:,} in an eighth)" if quality.unfolding != "whole" else ""
        lines.append(
            f"{name}: {phase.tetrahedra:,} tetrahedra in the whole cell{eighth}, {phase.nodes:,} nodes; "
            f"dihedral angles from {phase.smallest_angle:.1f}° (99 % from {phase.low_angle:.1f}°); "
            f"least stretch of curved tetrahedra {phase.least_stretch:.2f}"
        )
        if phase.regions:
            shares = ", ".join(f"{region} {share:.4g}" for region, share in phase.regions.items())
            lines.append(f"{name}, regions: {shares} of the cell")
        lines += [f"{name}, {_hangs(piece, len(phase.pieces) > 1)}" for piece in phase.pieces[:6]]
        if rest := phase.pieces[6:]:
            some = "1 smaller piece" if len(rest) == 1 else f"{len(rest)} smaller pieces"
            lines.append(f"{name}, and {some} of volume {sum(piece.volume for piece in rest):.6f} in all")
    if closed_pores(quality.fluid.pieces if quality.fluid else ()):
        lines.append(CLOSED_PORES)
    alone = f"{quality.unmatched} facets without a partner"
    lines.append(f"opposite faces: {alone if quality.unmatched else 'every facet has its partner'}")
    if quality.disconnected:
        lines.append(f"the solid has no stiffness: {quality.disconnected}")
    if quality.blocked:
        why = "it does not run through" if quality.fluid else "there is none"
        lines.append(f"K = 0 along {', '.join(quality.blocked)}: of the fluid {why} there")
    return lines


def closed_pores(fluid: Sequence[Piece]) -> bool:
    """Return whether a piece of the fluid reaches no other cell."""
    return any(piece.rank == 0 for piece in fluid)


def _hangs(piece: Piece, several: bool) -> str:
    size = f"a piece of volume {piece.volume:.6f}" if several else "one piece"
    if piece.rank == 0:
        return f"{size}: closed in itself, reaches no other cell"
    if piece.rank == 3:
        return f"{size}: runs through in every direction"
    kind = {1: "one direction", 2: "two directions"}[piece.rank]
    return f"{size}: runs through in {kind} only, along {', '.join(piece.axes)}"


#: Subdivision of a quadratic tetrahedron (VTK order) into eight linear ones.
SUBDIVISION = np.array([
    [0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
    [4, 5, 6, 8], [4, 6, 7, 8], [6, 5, 9, 8], [6, 9, 7, 8],
])  # fmt: skip
#: Intervals along the edge of a facet in the grid of points on the wall.
FACET_GRID = 8
#: A node lies inside a tetrahedron if all its barycentric coordinates exceed this.
DEPTH = 0.02


def mirror_gap(mesh: CellMesh, grad_u: Array, u: Array) -> float:
    """Return the smallest distance of the deformed wall to a mirror plane of the eighth over the undeformed one.

    It is 1 in the undeformed state, and negative where the wall has passed the plane. It is evaluated on a grid of
    points on every facet, since a crease begins as a fold within the facets next to the plane. The mesh is that of the
    solid on the eighth, ``grad_u`` (3, 3) is a diagonal H and u (nodes, 3) is u¹.
    """
    X, weights = _wall_points(mesh)
    x = X * (1 + np.diag(grad_u)) + np.einsum("sa,kai->ksi", weights, u[mesh.wall]).reshape(-1, 3)
    edge = (1 + np.diag(grad_u)) * mesh.high
    gap = np.inf
    for axis in range(3):
        below, above = X[:, axis], mesh.high[axis] - X[:, axis]
        off = below > 1e-12
        gap = min(gap, (x[off, axis] / below[off]).min(initial=np.inf))
        off = above > 1e-12
        gap = min(gap, ((edge[axis] - x[off, axis]) / above[off]).min(initial=np.inf))
    return float(gap)


@lru_cache(maxsize=8)
def _wall_points(mesh: CellMesh) -> tuple[Array, Array]:
    """Return grid points on the wall's facets (points, 3), and their shape functions (samples, 3 or 6)."""
    n = FACET_GRID
    grid = np.array([(j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    weights, _ = shape_functions(grid, mesh.wall.shape[1])
    return np.einsum("sa,kai->ksi", weights, mesh.points[mesh.wall]).reshape(-1, 3), weights


def nodes_inside(mesh: CellMesh, grad_u: Array, u: Array) -> npt.NDArray[np.int64]:
    """Return the nodes of the deformed wall that, or a periodic image of which, lie inside the deformed solid.

    The domain is the whole cell under any load; arguments as of :func:`mirror_gap`.
    """
    F0 = np.eye(3) + grad_u
    x = mesh.points @ F0.T + u
    tetrahedra = mesh.cells if mesh.order == 1 else mesh.cells[:, SUBDIVISION].reshape(-1, 4)
    # Sums over short last axes are slow, so components come first.
    corners = x.T[:, tetrahedra.T]
    centres = corners.mean(axis=1)
    radii = np.sqrt(((corners - centres[:, None]) ** 2).sum(axis=0).max(axis=0))
    low, high = x.min(axis=0), x.max(axis=0)
    nodes = np.unique(mesh.wall)
    queries, names = [], []
    for shift in product((-1.0, 0.0, 1.0), repeat=3):
        moved = x[nodes] + F0 @ (np.array(shift) * mesh.spans)
        near = ((moved > low) & (moved < high)).all(axis=1)
        queries.append(moved[near])
        names.append(nodes[near])
    points, origin = np.concatenate(queries), np.concatenate(names)
    reach = float(radii.max(initial=0.0))
    near = cKDTree(points, balanced_tree=False).sparse_distance_matrix(
        cKDTree(centres.T, balanced_tree=False), reach, output_type="ndarray"
    )
    point, tetrahedron = near["i"], near["j"]
    within = near["v"] < radii[tetrahedron]
    point, tetrahedron = point[within], tetrahedron[within]
    same = mesh.periodic_class[tetrahedra[tetrahedron]] == mesh.periodic_class[origin[point]][:, None]
    apart = ~same.any(axis=1)
    point, tetrahedron = point[apart], tetrahedron[apart]
    inside = _depth(x[tetrahedra[tetrahedron]], points[point]) > DEPTH
    return np.asarray(np.unique(origin[point[inside]]))


def _depth(corners: Array, points: Array) -> npt.NDArray[np.float64]:
    """Return the smallest barycentric coordinate of each point (n, 3) in its tetrahedron (n, 4, 3).

    It is −1 for a tetrahedron that is flat or turned inside out.
    """
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    # A curved tetrahedron may be sound where one of the straight ones that divide it is turned inside out.
    flat = np.linalg.det(edges) < 1e-14
    edges[flat] = np.eye(3)
    inner = np.linalg.solve(edges, (points - corners[:, 0])[:, :, None])[:, :, 0]
    depth: npt.NDArray[np.float64] = np.minimum(inner.min(axis=1), 1 - inner.sum(axis=1))
    depth[flat] = -1.0
    return depth
