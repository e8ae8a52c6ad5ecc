"""Mesh quality of a cell: porosity, sizes, dihedral angles, connectivity, unmatched facets, as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.geometry.sides import CUBE, Sides
from porocore.cell.level_sets.agreement import grains
from porocore.cell.meshing.connectivity import Piece, blocked, pieces, why_disconnected
from porocore.cell.meshing.mesh import CellMesh, make_mesh
from porocore.cell.meshing.shape_functions import EDGES, FACETS
from porocore.cell.meshing.tetrahedra import least_stretch, volume
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
