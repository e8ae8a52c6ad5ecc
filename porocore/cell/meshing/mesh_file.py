"""Geometry from a mesh file with tagged tetrahedra of solid and fluid (MeshFile)."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.geometry.pore_geometry import PoreGeometry, Unfolding
from porocore.cell.geometry.sides import CUBE, Sides, unit_sides
from porocore.cell.meshing.periodicity import matched
from porocore.cell.meshing.shape_functions import EDGES
from porocore.cell.meshing.tetrahedra import (
    Element,
    Phase,
    Tetrahedra,
    least_stretch,
    used,
    volume,
    volumes,
    with_middles,
)
from porocore.cell.symmetry.mesh_symmetry import RegionMap, region_maps
from porocore.core.files.foreign_mesh import read_mesh
from porocore.core.files.input_file import FromFile
from porocore.core.tensors.point_group import PointGroup, Rotation, as_rotation
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

Tag = int | str
Tags = Annotated[tuple[Tag, ...], Field(min_length=1)]
#: Names under which meshing programs store the tags of elements; the first one in a file is used.
TAG_DATA = ("gmsh:physical", "medit:ref", "phase", "region", "cell_tags", "material", "gmsh:geometrical")
#: Largest difference of the extents of a cube along the axes, relative to the largest.
SAME = 1e-6


class MeshFile(FromFile, PoreGeometry):
    """Tetrahedra of solid and fluid, distinguished by tags: names of physical groups, or numbers.

    The bounding box, with the same nodes on opposite faces, becomes the cell, of volume 1. The mesh is used
    as it is and ``cell.mesh.size`` is ignored; linear elements get the nodes that ``cell.mesh.element`` requires.
    Several tags of the solid are its regions.
    """

    kind: Literal["mesh-file"]
    """Tetrahedra of solid and fluid from a file that meshio reads."""
    solid: Tags = ("solid",)
    """Tags of the solid's tetrahedra: names of physical groups, or numbers; several are its regions."""
    fluid: Tags = ("fluid",)
    """Tags of the fluid's tetrahedra."""
    tags: str | None = None
    """Name of the element data with the tags; null: the first known one that the file has."""

    @model_validator(mode="after")
    def _apart(self) -> MeshFile:
        both = sorted({str(tag) for tag in self.solid} & {str(tag) for tag in self.fluid})
        if both:
            raise ValueError(
                f"the tags {', '.join(both)} stand under solid and under fluid; keep them in one"
            )
        return self

    @property
    def porosity(self) -> float:
        """Porosity of the mesh."""
        fluid = _read(self)[0]["fluid"]
        return volume(fluid.points, fluid.cells)

    @property
    def sides(self) -> Sides:
        """Sides of the bounding box."""
        return _read(self)[1]

    @property
    def unfolding(self) -> Unfolding:
        """The whole cell."""
        return "whole"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the mesh of the solid."""
        return PointGroup.generated([np.reshape(Q, (3, 3)) for Q in _region_maps(self)])

    def regions_after(self, Q: IntArray) -> RegionMap:
        return _region_maps(self).get(as_rotation(Q))

    @property
    def description(self) -> str:
        return f"mesh {Path(self.path).name}"

    def elements(self, size: float) -> float:
        """Return 0, since no element is made."""
        return 0.0

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        """Return the tetrahedra of the file.

        Raises
        ------
        ConfigurationError
            The file is no such mesh, has changed, or is not periodic.
        """
        return {phase: _of_order(part, element) for phase, part in _read(self)[0].items()}


def _of_order(mesh: Tetrahedra, element: Element) -> Tetrahedra:
    points, cells = mesh.points, mesh.cells
    if element == "linear":
        points, cells = used(points, cells[:, :4])
    elif cells.shape[1] == 4:
        points, cells, _ = with_middles(points, cells)
    elif element == "quadratic-straight":
        points = points.copy()
        points[cells[:, 4:]] = points[cells[:, EDGES]].mean(axis=2)
    return Tetrahedra(points, cells, mesh.regions, mesh.region_names)


@lru_cache(maxsize=2)
def _read(geometry: MeshFile) -> tuple[dict[Phase, Tetrahedra], Sides]:
    """Return the tetrahedra of a file by phase, and the sides of the cell."""
    path = geometry.checked("cell.geometry")
    mesh = read_mesh(path)
    kinds = {block.type for block in mesh.cells if block.dim == 3}
    if not kinds or not kinds <= {"tetra", "tetra10"} or len(kinds) > 1:
        raise ConfigurationError(
            f"{path}: expected tetrahedra of 4 or of 10 nodes (tetra, tetra10), got "
            f"{', '.join(sorted(kinds)) or 'no elements with a volume'}"
        )
    blocks = [i for i, block in enumerate(mesh.cells) if block.dim == 3]
    cells = np.concatenate([mesh.cells[i].data for i in blocks]).astype(np.int64)
    tags, names = _tags(geometry, path, mesh, blocks)
    phase = {tag: name for name in ("solid", "fluid") for tag in _numbers(geometry, path, name, tags, names)}
    strange = np.setdiff1d(np.unique(tags), list(phase))
    if len(strange):
        raise ConfigurationError(
            f"{path}: elements with the tags {_listed(strange, names)} belong to no phase; name them under "
            "cell.geometry.solid or cell.geometry.fluid"
        )
    points, sides = _unit_cell(path, np.asarray(mesh.points, dtype=np.float64), cells)
    points, cells = used(points, cells)
    points = matched(points, cells, sides, str(path))
    cells = _positive(points, cells, path)

    def of_phase(name: Phase) -> Tetrahedra:
        numbers = [tag for tag, of in phase.items() if of == name]
        chosen = np.isin(tags, numbers)
        part = used(points, cells[chosen])
        if len(numbers) == 1:
            return Tetrahedra(*part)
        regions = np.array([numbers.index(tag) for tag in tags[chosen]], dtype=np.int64)
        return Tetrahedra(*part, regions, tuple(str(names.get(number, number)) for number in numbers))

    return {"solid": of_phase("solid"), "fluid": of_phase("fluid")}, sides


@lru_cache(maxsize=2)
def _region_maps(geometry: MeshFile) -> dict[Rotation, RegionMap]:
    phases, sides = _read(geometry)
    return region_maps(phases["solid"], sides)


def _tags(geometry: MeshFile, path: Path, mesh: Any, blocks: list[int]) -> tuple[IntArray, dict[int, str]]:
    """Return the tag of every tetrahedron, and the names of the tags that have one."""
    known = sorted(mesh.cell_data)
    wanted = [geometry.tags] if geometry.tags else [name for name in TAG_DATA if name in known]
    if not wanted or wanted[0] not in known:
        raise ConfigurationError(
            f"cell.geometry.tags: expected the name of the element data of {path} that tells solid from fluid, "
            f"got {geometry.tags or 'none, and none of the usual ones is there'}; it has {', '.join(known) or 'none'}"
        )
    tags = np.concatenate([np.asarray(mesh.cell_data[wanted[0]][i]).reshape(-1) for i in blocks])
    if not (np.isfinite(tags) & (tags == np.rint(tags))).all():
        raise ConfigurationError(f"cell.geometry.tags: {wanted[0]} of {path} does not hold whole numbers")
    names = {int(number): name for name, (number, dim) in mesh.field_data.items() if int(dim) == 3}
    return tags.astype(np.int64), names


def _numbers(geometry: MeshFile, path: Path, phase: str, tags: IntArray, names: dict[int, str]) -> list[int]:
    """Return the tags of a phase as numbers."""
    by_name = {name: number for number, name in names.items()}
    found = []
    for tag in getattr(geometry, phase):
        number = by_name.get(tag) if isinstance(tag, str) else tag
        if number is None or number not in tags:
            raise ConfigurationError(
                f"cell.geometry.{phase}: no tetrahedron of {path} has the tag {tag!r}; its tags are "
                f"{_listed(np.unique(tags), names)}"
            )
        found.append(int(number))
    return found


def _listed(tags: IntArray, names: dict[int, str]) -> str:
    return ", ".join(f"{tag} ('{names[int(tag)]}')" if int(tag) in names else str(tag) for tag in tags[:12])


def _unit_cell(path: Path, points: Array, cells: IntArray) -> tuple[Array, Sides]:
    """Return the points shifted and scaled so that the corners of the tetrahedra fill a cell, and its sides."""
    corners = points[np.unique(cells[:, :4])]
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = high - low
    if extent.min() <= SAME * extent.max():
        raise ConfigurationError(
            f"{path}: expected tetrahedra that fill a box, got {extent[0]:g} x {extent[1]:g} x {extent[2]:g}, which is "
            "flat; mesh a whole cell"
        )
    if np.ptp(extent) <= SAME * extent.max():
        return np.asarray((points - low) / extent.max() - 0.5), CUBE
    sides = unit_sides(extent)
    return np.asarray(((points - low) / extent - 0.5) * sides), sides


def _positive(points: Array, cells: IntArray, path: Path) -> IntArray:
    """Return the tetrahedra oriented to a positive volume; those of ten nodes must not be folded either."""
    cells = cells.copy()
    negative = volumes(points, cells) < 0
    swapped = [1, 0, 2, 3] if cells.shape[1] == 4 else [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]
    cells[negative] = cells[negative][:, swapped]
    bad = int((volumes(points, cells) <= 0).sum())
    if not bad and cells.shape[1] == 10:
        bad = int((least_stretch(points, cells) <= 0).sum())
    if bad:
        raise ConfigurationError(
            f"{path}: {bad} of {len(cells):,} tetrahedra have no volume or fold over themselves; improve the mesh"
        )
    return cells
