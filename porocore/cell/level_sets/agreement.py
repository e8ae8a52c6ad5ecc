"""Agreement of an image with its mesh: porosity, and connection of the phases from cell to cell."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.level_sets.level_set import lattice_edges
from porocore.cell.level_sets.runs import necks, runs, through_axes
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import Piece, blocked, pieces
from porocore.cell.meshing.tetrahedra import Phase, volume
from porocore.states import Array, IntArray

#: Difference of the porosities from which there is a note: share of the image's, and of the cell.
SHARE, POINTS = 0.03, 0.01
#: Elements across a neck, a wall or a pore below which the flow or the force through it is one of the mesh.
FEWEST = 2.0
#: Voxels across a neck up to which less smoothing widens it.
SMOOTHED = 4.5
#: Values of the smoothing that are tried where it closes something [voxels].
LESS = (0.5, 0.0)
#: Voxels of an image beyond which its necks are not searched for.
MOST = 10_000_000
#: Volumes that a note names.
NAMED = 3

#: What an image shows, its phase and the key of its size.
_PHASES: tuple[tuple[str, Phase, str], ...] = (("pores", "fluid", "fluid_size"), ("solid", "solid", "size"))


def voxel_edges(geometry: Voxels) -> Array:
    """Return the edges of a voxel in units of the cell, (3,)."""
    part = 1.0 if geometry.unfolding == "whole" else 0.5
    return np.asarray(np.multiply(geometry.sides, part) / geometry.solid.shape)


def disagreements(cell: Cell) -> Iterator[str]:
    """Yield in what the meshes of a cell differ from its image, and what to write; nothing for cells without one."""
    if isinstance(cell.geometry, Voxels):
        single = cell.model_copy(update={"supercell": (1, 1, 1)})
        yield from _porosities(single, cell.geometry)
        for phase in _PHASES:
            yield from _Compared.of(single, cell.geometry, *phase).notes()


def _porosities(cell: Cell, geometry: Voxels) -> Iterator[str]:
    image = geometry.porosity
    limit, noted = min(SHARE * image, POINTS), set[float]()
    for _, phase, key in reversed(_PHASES):
        mesh, size = cell.make_mesh(phase, "whole"), float(getattr(cell.mesh, key))
        share = volume(mesh.points, mesh.cells) if len(mesh.cells) else 0.0
        porosity = 1 - share if phase == "solid" else share
        if abs(porosity - image) > limit and size not in noted:
            noted.add(size)
            # The error is of second order in the size.
            smaller = size * math.sqrt(limit / abs(porosity - image))
            yield (
                f"the porosity of the image is {image:.4g}, that of the mesh of the {phase} {porosity:.4g}; "
                f"cell.mesh.{key}: {smaller:.2g} should bring them within {limit:.2g}"
            )


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

    def notes(self) -> Iterator[str]:
        """Yield what is open in the image and closed in the mesh, or the other way round, and narrow necks."""
        image = through_axes(self.axes)
        mesh = "".join(axis for axis in "xyz" if axis not in blocked(self.mesh))
        run, that, do = ("run", "those", "do") if self.name == "pores" else ("runs", "that", "does")
        if closed := [axis for axis in image if axis not in mesh]:
            advice = self._advice(
                [self.narrow[axis] for axis in closed if axis in self.narrow],
                lambda _, axes: set(closed) <= set(through_axes(axes)),
            )
            yield (
                f"the image's {self.name} {run} through along {_listed(closed)}, {that} of the mesh {do} not: {advice}"
            )
        if opened := [axis for axis in mesh if axis not in image]:
            yield (
                f"the mesh's {self.name} {run} through along {_listed(opened)}, {that} of the image {do} not: give "
                f"a smaller cell.mesh.{self.key} or cell.geometry.smoothing"
            )
        if weak := sorted(axis for axis in self.narrow if axis in mesh):
            width = min(self.narrow[axis] for axis in weak)
            what = "permeability" if self.phase == "fluid" else "stiffness"
            yield (
                f"the image's {self.name} {run} through along {_listed(weak)} by necks that no ball "
                f"wider than {width:.2g} of the cell gets through, {count_text(width / self.size)} of mesh.{self.key}; "
                f"the {what} there depends on the mesh: {self._advice([width])}"
            )
        yield from self._shut()

    def _shut(self) -> Iterator[str]:
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
        # Specks may lie where the smoothed image has the other phase.
        advice = self._advice(
            list(self.narrow.values()), lambda labels, axes: bool(axes[self._label(labels, shut[0])])
        )
        yield f"of the mesh of the {self.phase} {some} open in the image: {advice}"

    def _advice(
        self, widths: list[float], is_open: Callable[[IntArray, list[str]], bool] = lambda labels, axes: True
    ) -> str:
        """Return what to write so that necks of these widths are resolved, and that ``is_open`` holds once smoothed."""
        width = min(widths, default=self.size)
        finer = f"cell.mesh.{self.key}: {at_most(width / FEWEST):g}"
        less = [value for value in LESS if value < self.geometry.smoothing]
        if is_open(*self._smoothed(self.geometry.smoothing)):
            few = width < SMOOTHED * float(voxel_edges(self.geometry).min())
            keeps = (
                f"; cell.geometry.smoothing: {less[0]:g} keeps more of narrow necks" if few and less else ""
            )
            return f"give {finer}{keeps}"
        for smoothing in less:
            if is_open(*self._smoothed(smoothing)):
                return f"smoothing closes necks; give cell.geometry.smoothing: {smoothing:g} and {finer}"
        return "their necks are of a voxel or two and lost in any mesh; take an image of smaller voxels"

    def _smoothed(self, smoothing: float) -> tuple[IntArray, list[str]]:
        level_set = self.geometry.model_copy(update={"smoothing": smoothing}).level_set()
        solid = level_set.at_voxels() > 0
        periodic = self.geometry.unfolding == "whole"
        return runs(solid if self.phase == "solid" else ~solid, periodic=periodic)

    def _label(self, labels: IntArray, piece: Piece) -> int:
        """Return the number of the image's piece at a piece of the mesh; 0 where the image has the other phase."""
        place, sides = np.array(piece.inside), np.array(self.geometry.sides)
        place = place + sides / 2 if self.geometry.unfolding == "whole" else np.abs(place)
        index = (place / voxel_edges(self.geometry)).astype(np.int64)
        return int(labels[tuple(np.clip(index, 0, np.array(labels.shape) - 1))])


def at_most(size: float) -> float:
    """Return a size rounded down to two digits."""
    digit = 10.0 ** (math.floor(math.log10(size)) - 1)
    return float(f"{math.floor(size / digit + 1e-6) * digit:.2g}")


def count_text(elements: float) -> str:
    """Return a number of elements, such as ``1 element`` or ``1.6 elements``."""
    count = f"{elements:.2g}"
    return f"{count} element" if count == "1" else f"{count} elements"


def _listed(axes: Sequence[str]) -> str:
    return " and ".join(axes) if len(axes) < 3 else f"{axes[0]}, {axes[1]} and {axes[2]}"
