"""Quality of the meshes of a cell as text; differences between an image and its mesh: porosity, pieces, walls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.geometry.pore_geometry import CUBE, PoreGeometry, Sides
from porocore.cell.geometry.pore_geometry import MOST as MOST_ELEMENTS
from porocore.cell.level_sets.cutting import lattice_edges
from porocore.cell.level_sets.image import labelled
from porocore.cell.level_sets.voxels import Voxels, necks, runs, through_axes, way_out
from porocore.cell.meshing.connectivity import Piece, blocked, pieces, why_disconnected
from porocore.cell.meshing.mesh import CellMesh, make_mesh
from porocore.cell.meshing.tetrahedra import (
    EDGES,
    FACETS,
    Phase,
    curved_volumes,
    least_stretch,
    porosity,
    volume,
)
from porocore.core.echo import joined
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


#: Difference of the porosities from which there is a note: share of the image's, and of the cell.
SHARE, POINTS = 0.03, 0.01
#: Elements across a neck, a wall or a pore below which the flow or the force through it is one of the mesh.
FEWEST = 2.0
#: Voxels across a neck up to which less smoothing widens it.
SMOOTHED = 4.5
#: Tetrahedra that are meshed at most to find a size of the image's porosity: 20,000 take 3 s.
TRIED = 60_000
#: Largest factor from one size that is tried to the next, and the smallest size.
STEP, SMALLEST = 0.93, 0.01
#: Share of the pores up to which pieces that the mesh closes are reported without advice.
LITTLE = 0.01
#: Values of the smoothing that are tried where it closes something [voxels].
LESS = (0.5, 0.0)
#: Voxels of an image beyond which its necks are not searched for.
MOST = 10_000_000
#: Share of a grain below which it is lost where the mesh has less of it.
LOST = 0.25
#: Volumes that a note names.
NAMED = 3

#: What an image shows, its phase and the key of its size.
_PHASES: tuple[tuple[str, Phase, str], ...] = (("pores", "fluid", "fluid_size"), ("solid", "solid", "size"))


class Advice(NamedTuple):
    """Advice in words, with the sizes of elements in it by their keys under ``cell.mesh``."""

    text: str
    sizes: Mapping[str, float] = MappingProxyType({})

    def of(self, what: str) -> Advice:
        """Return a note on a difference, which ends with this advice."""
        return Advice(f"{what}{self.text}", self.sizes)


def voxel_edges(geometry: Voxels) -> Array:
    """Return the edges of a voxel in units of the cell, (3,)."""
    part = 1.0 if geometry.unfolding == "whole" else 0.5
    return np.asarray(np.multiply(geometry.sides, part) / geometry.solid.shape)


def disagreements(cell: Cell, *, tried: bool = False) -> Iterator[Advice]:
    """Yield in what the meshes of a cell differ from its image, and what to write; nothing for cells without one.

    With ``tried`` a size that is advised for the porosity was meshed, where that is cheap.
    """
    if isinstance(cell.geometry, Voxels):
        single = cell.model_copy(update={"supercell": (1, 1, 1)})
        yield from _porosities(single, cell.geometry, tried)
        for phase in _PHASES:
            yield from _Compared.of(single, cell.geometry, *phase).notes()


def _porosities(cell: Cell, geometry: Voxels, tried: bool) -> Iterator[Advice]:
    image = geometry.porosity
    limit, noted = min(SHARE * image, POINTS), set[float]()
    for _, phase, key in reversed(_PHASES):
        mesh, size = cell.make_mesh(phase, "whole"), float(getattr(cell.mesh, key))
        meshed = porosity(mesh.points, mesh.cells, phase)
        if abs(meshed - image) > limit and size not in noted:
            noted.add(size)
            yield _closer(cell, phase, key, meshed, limit, tried).of(
                f"the porosity of the image is {image:.4g}, that of the mesh of the {phase} {meshed:.4g}; "
            )


def _closer(cell: Cell, phase: Phase, key: str, meshed: float, limit: float, tried: bool) -> Advice:
    """Return the size that brings the porosity of a mesh within a limit, meshed here, or else one to try."""
    geometry, size = cell.geometry, float(getattr(cell.mesh, key))
    image, spent, copies = geometry.porosity, 0.0, 1 if geometry.unfolding == "whole" else 8
    while True:
        # The error is of second order in the size, and scatters.
        factor = math.sqrt(limit / abs(meshed - image))
        size = at_most(max(SMALLEST, lattice_edges(geometry, size)[0] * min(factor, STEP)))
        spent += geometry.elements(size) / copies
        if not can_be_meshed(geometry, size):
            return Advice(too_fine(size))
        if not tried or spent > TRIED or size <= SMALLEST:
            return Advice(
                f"try cell.mesh.{key}: {size:g}; it was not meshed for this note, and the porosity does not approach "
                "the image's evenly",
                {key: size},
            )
        part = geometry.tetrahedra(size, cell.mesh.element)[phase]
        meshed = porosity(part.points, part.cells, phase, copies)
        if abs(meshed - image) <= limit:
            said = f"cell.mesh.{key}: {size:g} was meshed here and has {meshed:.4g}, within {limit:.2g}"
            return Advice(said, {key: size})


@dataclass(frozen=True, eq=False)
class _Compared:
    """One phase of an image and of its mesh.

    Attributes
    ----------
    name, phase, key
        Name of the image's phase, phase of the mesh, and key of its size.
    mesh
        Pieces of the mesh.
    labels, axes
        Pieces of the image, and along which axes they run through, see :func:`runs`.
    narrow
        Necks of less than two elements, by axis.
    size
        Edge of the elements, by which they are counted.
    """

    geometry: Voxels
    name: str
    phase: Phase
    key: str
    size: float
    mesh: tuple[Piece, ...]
    labels: IntArray
    axes: list[str]
    narrow: dict[str, float]

    @classmethod
    def of(cls, cell: Cell, geometry: Voxels, name: str, phase: Phase, key: str) -> _Compared:
        voxels = geometry.solid if phase == "solid" else ~geometry.solid
        periodic, size = geometry.unfolding == "whole", lattice_edges(geometry, getattr(cell.mesh, key))[0]
        narrow: dict[str, float] = {}
        if voxels.size <= MOST:
            narrow = necks(voxels, voxel_edges(geometry), FEWEST * size, periodic=periodic)
        of_mesh = pieces(cell.make_mesh(phase, "whole"))
        return cls(geometry, name, phase, key, size, of_mesh, *runs(voxels, periodic=periodic), narrow)

    def notes(self) -> Iterator[Advice]:
        """Yield what is open in the image and closed in the mesh, or the other way round, and narrow necks."""
        image = through_axes(self.axes)
        mesh = "".join(axis for axis in "xyz" if axis not in blocked(self.mesh))
        run, that, do = ("run", "those", "do") if self.name == "pores" else ("runs", "that", "does")
        if closed := [axis for axis in image if axis not in mesh]:
            advice = self._advice(
                [self.narrow[axis] for axis in closed if axis in self.narrow],
                lambda _, axes: set(closed) <= set(through_axes(axes)),
            )
            yield advice.of(
                f"the image's {self.name} {run} through along {joined(closed)}, {that} of the mesh {do} not: "
            )
        if opened := [axis for axis in mesh if axis not in image]:
            yield Advice(
                f"the mesh's {self.name} {run} through along {joined(opened)}, {that} of the image {do} not: give "
                f"a smaller cell.mesh.{self.key} or cell.geometry.smoothing"
            )
        if weak := sorted(axis for axis in self.narrow if axis in mesh):
            width = min(self.narrow[axis] for axis in weak)
            what = "permeability" if self.phase == "fluid" else "stiffness"
            yield self._advice([width]).of(
                f"the image's {self.name} {run} through along {joined(weak)}, but its narrowest necks there let only "
                f"balls up to a width of {width:.2g} of the cell pass, {count_text(width / self.size)} of "
                f"mesh.{self.key}; the {what} there depends on the mesh: "
            )
        yield from self._shut()

    def _shut(self) -> Iterator[Advice]:
        """Yield a note on pieces that are closed in the mesh only."""
        shut = [
            piece for piece in self.mesh if piece.rank == 0 and self.axes[self._label(self.labels, piece)]
        ]
        if not shut:
            return
        volumes = ", ".join(f"{piece.volume:.3g}" for piece in shut[:NAMED])
        some = f"a piece of the volume {volumes}, closed in itself, is"
        if len(shut) > 1:
            more = ", …" if len(shut) > NAMED else ""
            some = f"{len(shut)} pieces of the volumes {volumes}{more}, closed in themselves, are"
        part = sum(piece.volume for piece in shut) / sum(piece.volume for piece in self.mesh)
        share = f"of the mesh of the {self.phase} {some} open in the image, {100 * part:.2g} % of the {self.phase}"
        if self.phase == "fluid":
            share += "; this share bears the pressure p and does not flow"
            if part < LITTLE:
                yield Advice(f"{share}; it is small enough to be left so")
                return
        # Specks may lie where the smoothed image has the other phase.
        advice = self._advice(
            [self._way_out(shut[0])], lambda labels, axes: bool(axes[self._label(labels, shut[0])])
        )
        yield advice.of(f"{share}: ")

    def _way_out(self, piece: Piece) -> float:
        solid = self.geometry.solid
        return way_out(
            solid if self.phase == "solid" else ~solid,
            voxel_edges(self.geometry),
            _voxels(self.geometry, np.array(piece.inside)),
            FEWEST * self.size,
            periodic=self.geometry.unfolding == "whole",
        )

    def _advice(
        self, widths: list[float], is_open: Callable[[IntArray, list[str]], bool] = lambda labels, axes: True
    ) -> Advice:
        """Return what to write so that necks of these widths are resolved, and that ``is_open`` holds once smoothed."""
        width = min(widths, default=self.size)
        size, few = at_most(width / FEWEST), can_be_meshed(self.geometry, at_most(width / FEWEST))
        finer = f"cell.mesh.{self.key}: {size:g}" if few else too_fine(size)
        sizes = {self.key: size} if few else {}
        less = [value for value in LESS if value < self.geometry.smoothing]
        if is_open(*self._smoothed(self.geometry.smoothing)):
            narrow = width < SMOOTHED * float(voxel_edges(self.geometry).min())
            keeps = (
                f"; cell.geometry.smoothing: {less[0]:g} keeps more of narrow necks"
                if narrow and less
                else ""
            )
            return Advice(f"{'give ' if few else ''}{finer}{keeps}", sizes)
        for smoothing in less:
            if is_open(*self._smoothed(smoothing)):
                wider = f"smoothing closes necks; give cell.geometry.smoothing: {smoothing:g}"
                return Advice(f"{wider}{' and' if few else ';'} {finer}", sizes)
        return Advice(
            "their necks are of a voxel or two and lost in any mesh; take an image of smaller voxels"
        )

    def _smoothed(self, smoothing: float) -> tuple[IntArray, list[str]]:
        level_set = self.geometry.model_copy(update={"smoothing": smoothing}).level_set()
        solid = level_set.at_voxels() > 0
        periodic = self.geometry.unfolding == "whole"
        return runs(solid if self.phase == "solid" else ~solid, periodic=periodic)

    def _label(self, labels: IntArray, piece: Piece) -> int:
        """Return the number of the image's piece at a piece of the mesh; 0 where the image has the other phase."""
        return int(labels[_voxels(self.geometry, np.array(piece.inside))])


def _voxels(geometry: Voxels, places: Array) -> tuple[IntArray, ...]:
    """Return the indices of the voxels at places (..., 3) of the whole cell."""
    sides = np.array(geometry.sides)
    places = places + sides / 2 if geometry.unfolding == "whole" else np.abs(places)
    index = (places / voxel_edges(geometry)).astype(np.int64)
    return tuple(np.moveaxis(np.clip(index, 0, np.array(geometry.solid.shape) - 1), -1, 0))


def grains(cell: Cell) -> Iterator[str]:
    """Yield what the mesh of the solid makes of the grains of an image that touch the rest by no face of a voxel."""
    if not isinstance(geometry := cell.geometry, Voxels):
        return
    labels = labelled(geometry.solid, periodic=geometry.repeat != "mirror")
    sizes = np.bincount(labels.ravel())[1:]
    if len(sizes) < 2:
        return
    mesh = cell.make_mesh("solid", "whole")
    elements = labels[_voxels(geometry, mesh.points[mesh.cells[:, :4]].mean(axis=1))]
    meshed = np.bincount(elements, curved_volumes(mesh.points, mesh.cells), len(sizes) + 1)[1:]
    apart = {int(labels[_voxels(geometry, np.array(piece.inside))]) - 1 for piece in pieces(mesh)[1:]}
    of_grain = sizes / geometry.solid.size
    loose = [i for i in range(len(sizes)) if i != sizes.argmax()]
    lost = [i for i in loose if i not in apart and meshed[i] < LOST * of_grain[i]]
    held = [i for i in loose if i not in apart and i not in lost]
    for found, what in (
        (held, "joined to the rest by"),
        (sorted(apart & set(loose)), "apart in"),
        (lost, "lost in"),
    ):
        if found:
            counts = ", ".join(f"{n:,}" for n in sorted(sizes[found], reverse=True)[:NAMED])
            more = ", …" if len(found) > NAMED else ""
            one = "1 of these grains" if len(found) == 1 else f"{len(found)} of these grains"
            yield f"{one} ({counts}{more} voxels) {'is' if len(found) == 1 else 'are'} {what} the mesh"


def can_be_meshed(geometry: PoreGeometry, size: float) -> bool:
    """Return whether a mesh of elements of a size is not refused."""
    return geometry.elements(size) <= MOST_ELEMENTS


def too_fine(size: float) -> str:
    """Return what to do where elements of a size would be needed, and are too many."""
    return (
        f"elements of {size:g} would be needed, and are more than are meshed ({MOST_ELEMENTS:,}): take a smaller part "
        "of the image (cell.geometry.crop), in which they are a larger share, or accept the difference"
    )


def at_most(size: float) -> float:
    """Return a size rounded down to two digits."""
    digit = 10.0 ** (math.floor(math.log10(size)) - 1)
    return float(f"{math.floor(size / digit + 1e-6) * digit:.2g}")


def count_text(elements: float) -> str:
    """Return a number of elements, such as ``1 element`` or ``1.6 elements``."""
    count = f"{elements:.2g}"
    return f"{count} element" if count == "1" else f"{count} elements"
