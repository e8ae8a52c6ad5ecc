"""Geometry from a mesh file with tagged tetrahedra of solid and fluid (MeshFile)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import yaml
from pydantic import Field, model_validator

from porocore.cell.geometry.pore_geometry import CUBE, PoreGeometry, Sides, Unfolding, unit_sides
from porocore.cell.meshing.tetrahedra import (
    Element,
    Phase,
    Tetrahedra,
    boundary_facets,
    facet_classes,
    least_stretch,
    oriented,
    straightened,
    used,
    volume,
    volumes,
    with_middles,
)
from porocore.cell.symmetry import RegionMap, region_maps
from porocore.core.echo import did_you_mean, echo, joined
from porocore.core.files.foreign_mesh import (
    IN_THREE_DIMENSIONS,
    KNOWN_DATA,
    how_to_convert,
    read_mesh,
    require_apart,
)
from porocore.core.files.input_file import FromFile
from porocore.core.files.mesh_parts import ForeignMesh
from porocore.core.tensors import PointGroup, Rotation, as_rotation
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

Tag = int | str
PHASES: tuple[Phase, ...] = ("solid", "fluid")
Tags = Annotated[tuple[Tag, ...], Field(min_length=1)]
#: Largest difference of the extents of a cube along the axes, relative to the largest.
SAME = 1e-6


class MeshFile(FromFile, PoreGeometry):
    """Tetrahedra of solid and fluid, distinguished by tags: names of physical groups, or numbers.

    The bounding box, with the same nodes on opposite faces, becomes the cell, of volume 1. The mesh is used
    as it is and ``cell.mesh.size`` is ignored; linear elements get the nodes that ``cell.mesh.element`` requires.
    Several tags of the solid are its regions.
    """

    kind: Literal["mesh-file"]
    """Tetrahedra of solid and fluid from a file of gmsh, Abaqus or Exodus, or another that meshio reads."""
    solid: Tags = ("solid",)
    """Tags of the solid's tetrahedra: names of physical groups, or numbers; several are its regions."""
    fluid: Tags = ("fluid",)
    """Tags of the fluid's tetrahedra."""
    tags: str | None = None
    """Name of the element data with the tags; null: the groups that the file names, or the first known data."""

    unfolding: ClassVar[Unfolding] = "whole"

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
    def notes(self) -> tuple[str, ...]:
        """A sentence on the edge of the cell in the file's unit, where it is not 1."""
        box = _read(self)[2]
        edge = float(np.cbrt(box.prod()))
        if abs(edge - 1) <= SAME:
            return ()
        return (
            f"the box of {Path(self.path).name} is {box[0]:.6g} x {box[1]:.6g} x {box[2]:.6g} in the unit of the file; "
            f"scales.pore, the cube root of its volume, is {edge:.6g} of this unit",
        )

    @property
    def point_group(self) -> PointGroup:
        """Point group of the mesh of the solid."""
        return PointGroup.generated([np.reshape(Q, (3, 3)) for Q in _region_maps(self)])

    def regions_after(self, Q: IntArray) -> RegionMap:
        return _region_maps(self).get(as_rotation(Q))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Groups that are named like the other phase."""
        return tuple(
            f"the group {echo(tag)} is given as {phase} and is named like the {other}; exchange cell.geometry.solid "
            "and cell.geometry.fluid if it is the other way round"
            for phase in PHASES
            for tag in getattr(self, phase)
            if (other := _phase_named(str(tag))) not in (phase, None)
        )

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
        points = straightened(points, cells)
    return Tetrahedra(points, cells, mesh.regions, mesh.region_names)


#: What a file of surfaces lacks.
BOTH_PHASES = (
    "a cell needs the solid and the pores meshed, each a named group under cell.geometry.solid and "
    "cell.geometry.fluid; a scan is read as an image, by 'kind: voxels'"
)


@lru_cache(maxsize=2)
def _read(geometry: MeshFile) -> tuple[dict[Phase, Tetrahedra], Sides, Array]:
    """Return the tetrahedra of a file by phase, the sides of the cell, and the edges (3,) of the box in the file."""
    path = geometry.checked("cell.geometry")
    mesh = read_mesh(path, geometry.tags)
    kinds = list(mesh.elements[3])
    if not kinds or not {*kinds} <= {"tetra", "tetra10"} or len(kinds) > 1:
        raise ConfigurationError(
            f"{path}: expected tetrahedra of 4 or of 10 nodes (tetra, tetra10), got "
            + (
                f"{joined(sorted(kinds))}; {how_to_convert(kinds)}"
                if kinds
                else f"no elements with a volume: {BOTH_PHASES}; {IN_THREE_DIMENSIONS}"
            )
        )
    ((kind, cells),) = mesh.elements[3].items()
    parts = _parts(geometry, path, mesh, kind)
    points, sides, box = _unit_cell(path, mesh.points, cells)
    points, cells = used(points, cells)
    require_apart(points, path)
    points = matched(points, cells, sides, str(path))
    cells = _positive(points, cells, path)

    def of_phase(name: Phase) -> Tetrahedra:
        regions = np.full(len(cells), -1)
        for number, rows in enumerate(parts[name].values()):
            regions[rows] = number
        chosen = regions >= 0
        part = used(points, cells[chosen])
        return (
            Tetrahedra(*part)
            if len(parts[name]) == 1
            else Tetrahedra(*part, regions[chosen], tuple(parts[name]))
        )

    return {"solid": of_phase("solid"), "fluid": of_phase("fluid")}, sides, box


@lru_cache(maxsize=2)
def _region_maps(geometry: MeshFile) -> dict[Rotation, RegionMap]:
    phases, sides, _ = _read(geometry)
    return region_maps(phases["solid"], sides)


def _parts(geometry: MeshFile, path: Path, mesh: ForeignMesh, kind: str) -> dict[Phase, dict[str, IntArray]]:
    """Return the rows of the tetrahedra of each phase by the names of their groups."""
    groups = mesh.groups[3]
    if not groups or (geometry.tags is not None and geometry.tags not in mesh.data):
        raise ConfigurationError(
            f"cell.geometry.tags: expected the name of the element data of {path} that tells solid from fluid, "
            f"got {geometry.tags or f'none, and none of {KNOWN_DATA} holds whole numbers'}; it has "
            f"{', '.join(sorted(mesh.data)) or 'no data of elements; give physical groups of volumes (gmsh)'}"
        )
    _require_tags(geometry, path, mesh, kind)
    found: dict[Phase, dict[str, IntArray]] = {"solid": {}, "fluid": {}}
    owner = np.full(len(mesh.elements[3][kind]), -1)
    given: list[str] = []
    for phase, parts in found.items():
        for tag in getattr(geometry, phase):
            name = mesh.name(3, tag)
            if name is None or name in parts:
                continue
            rows = groups[name][kind]
            if (both := owner[rows] >= 0).any():
                raise ConfigurationError(
                    f"cell.geometry.{phase}: {int(both.sum()):,} of the {len(rows):,} tetrahedra of {path} with the "
                    f"tag {_as_given(tag, name)} have the tag {given[owner[rows[both][0]]]} too; give each one part "
                    "of the cell"
                )
            owner[rows], parts[name] = len(given), rows
            given.append(f"{_as_given(tag, name)} of {phase}")
    left = np.flatnonzero(owner < 0)
    if len(left):
        theirs = [name for name, members in groups.items() if np.isin(members[kind], left).any()]
        tags = f"the tags {_listed(mesh, theirs)}" if theirs else "no tag"
        raise ConfigurationError(
            f"{path}: {len(left):,} elements with {tags} belong to no phase; name them under "
            "cell.geometry.solid or cell.geometry.fluid"
        )
    return found


def _as_given(tag: Tag, name: str) -> str:
    """Return a tag as it is written, with the name of its group where that is another."""
    return echo(tag) if str(tag) == name else f"{echo(tag)} ({echo(name)})"


def _require_tags(geometry: MeshFile, path: Path, mesh: ForeignMesh, kind: str) -> None:
    """Refuse tags that stand for two groups, and those that no tetrahedron has, with all their names."""
    for phase in PHASES:
        for tag in getattr(geometry, phase):
            if why := mesh.clashes[3].get(str(tag)):
                raise ConfigurationError(f"cell.geometry.{phase}: in {path.name} {why}")
    wrong = {
        phase: [tag for tag in getattr(geometry, phase) if mesh.name(3, tag) is None] for phase in PHASES
    }
    told = []
    for phase, tags in wrong.items():
        near = [" ".join([echo(tag), *_near(str(tag), phase, mesh)]) for tag in tags]
        told += [f"{joined(near)} under {phase}"] if near else []
    if told:
        missing = [phase for phase in PHASES if wrong[phase]]
        raise ConfigurationError(
            f"cell.geometry.{missing[0]}: no tetrahedron of {path} has the tag {' and '.join(told)}; its tags are "
            f"{_with_shares(mesh, kind)}: {_tags_to_write(geometry, mesh, missing)}"
        )


def _tags_to_write(geometry: MeshFile, mesh: ForeignMesh, missing: Sequence[Phase]) -> str:
    """Return what to write for the phases whose tags no tetrahedron has."""
    taken = {mesh.name(3, tag) for phase in PHASES for tag in getattr(geometry, phase)}
    free = [name for name in mesh.groups[3] if name not in taken]
    if len(mesh.groups[3]) < 2:
        return (
            "there is one volume only, and a cell needs two: mesh the pores, too, or the solid, with the same nodes on "
            "the wall between them, and give each a group of its own"
        )
    found: dict[Phase, str] = {}
    for phase in missing:
        left = [name for name in free if name not in found.values()]
        # A group that is named like the other phase comes last.
        ranks = {
            name: (phase, None).index(named) if named in (phase, None) else 2
            for name, named in zip(left, map(_phase_named, left), strict=True)
        }
        left.sort(key=ranks.__getitem__)
        found[phase] = left[0] if left else "NAME"
    write = " and ".join(f"'{phase}: [{_as_yaml(name)}]'" for phase, name in found.items())
    unsure = len(free) > 1 and not any(_phase_named(name) == phase for phase, name in found.items())
    others = "the other way round" if len(free) == 2 else "others of them"
    other = (
        f", or {others}: no name tells which is which; the share of the fluid is the porosity"
        if unsure
        else ""
    )
    return f"write {write} under cell.geometry{other}"


def _as_yaml(name: str) -> str:
    """Return a name as it stands in a list of YAML, in quotes where it would be read as something else."""
    try:
        read = yaml.safe_load(f"[{name}]")
    except yaml.YAMLError:
        read = []
    same = len(read) == 1 and type(read[0]) in (int, str) and str(read[0]) == name
    return name if same else json.dumps(name, ensure_ascii=False)


#: Words in the names of groups.
_NAMED: dict[Phase, str] = {
    "solid": r"solid|matrix|skeleton|bone|frame|tissue|scaffold|grain|trabecul|polymer|feststoff|ger(ü|ue)st",
    "fluid": r"fluid|void|pore|water|liquid|air|brine|blood|channel|hohlraum|wasser",
}


def _phase_named(name: str) -> Phase | None:
    """Return the phase that a group has by its name; None where it names none."""
    return next((phase for phase, words in _NAMED.items() if re.search(words, name.casefold())), None)


def _near(tag: str, phase: Phase, mesh: ForeignMesh) -> tuple[str, ...]:
    """Return the question whether a similar name of a group is meant, which is not named like the other phase."""
    asked = did_you_mean(tag, (name for name in mesh.groups[3] if _phase_named(name) in (phase, None)))
    return (f"({asked})",) if asked else ()


def _with_shares(mesh: ForeignMesh, kind: str) -> str:
    """Return the groups with their shares of all volume, and how many faces of the box they reach."""
    cells = mesh.elements[3][kind][:, :4]
    each = np.abs(volumes(mesh.points, cells))
    low, high = mesh.points[cells].min(axis=(0, 1)), mesh.points[cells].max(axis=(0, 1))
    near = SAME * float((high - low).max())
    said = []
    for name, members in list(mesh.groups[3].items())[:12]:
        points = mesh.points[cells[members[kind]]].reshape(-1, 3)
        reached = int((points.min(axis=0) - low <= near).sum() + (high - points.max(axis=0) <= near).sum())
        share = 100 * each[members[kind]].sum() / max(each.sum(), np.finfo(float).tiny)
        said.append(f"{_listed(mesh, [name])} with {share:.3g} % of the volume, at {reached} of the 6 faces")
    return ", ".join(said)


def _listed(mesh: ForeignMesh, names: Iterable[str]) -> str:
    """Return names of groups with their numbers."""
    numbers = {name: tag for tag, name in mesh.tags[3].items() if name != str(tag)}
    named = [f"{numbers[name]} ('{name}')" if name in numbers else name for name in names]
    return ", ".join(named[:12])


def _unit_cell(path: Path, points: Array, cells: IntArray) -> tuple[Array, Sides, Array]:
    """Return the points shifted and scaled so that the corners of the tetrahedra fill a cell, its sides, the box."""
    corners = points[np.unique(cells[:, :4])]
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = high - low
    if extent.min() <= SAME * extent.max():
        raise ConfigurationError(
            f"{path}: expected tetrahedra that fill a box, got {extent[0]:g} x {extent[1]:g} x {extent[2]:g}, which is "
            "flat; mesh a whole cell"
        )
    if np.ptp(extent) <= SAME * extent.max():
        return np.asarray((points - low) / extent.max() - 0.5), CUBE, extent
    sides = unit_sides(extent)
    return np.asarray(((points - low) / extent - 0.5) * sides), sides, extent


def _positive(points: Array, cells: IntArray, path: Path) -> IntArray:
    """Return the tetrahedra oriented to a positive volume; those of ten nodes must not be folded either."""
    cells = oriented(points, cells)
    bad = int((volumes(points, cells) <= 0).sum())
    if not bad and cells.shape[1] == 10:
        bad = int((least_stretch(points, cells) <= 0).sum())
    if bad:
        raise ConfigurationError(
            f"{path}: {bad} of {len(cells):,} tetrahedra have no volume or fold over themselves; improve the mesh"
        )
    return cells


#: Tolerances of a node on a face and of partners on opposite faces, in lengths of the cell.
ON_FACE, PARTNER = 1e-6, 1e-4


def matched(points: Array, cells: IntArray, sides: Sides, what: str) -> Array:
    """Return the nodes (N, 3) of a mesh of a cell, with nodes of opposite faces at exactly the same places.

    The tetrahedra are those of both phases; messages begin with ``what``, the name of the mesh.

    Raises
    ------
    ConfigurationError
        A face has nodes or facets without partners on the opposite face.
    """
    from scipy.spatial import cKDTree  # slow to import

    half = np.array(sides) / 2
    for face in (-half, half):
        points = np.where(np.abs(points - face) < ON_FACE, face, points)
    for axis, name in enumerate("xyz"):
        others = np.array([i for i in range(3) if i != axis])
        low, high = (np.flatnonzero(points[:, axis] == side) for side in (-half[axis], half[axis]))
        distance, partner = cKDTree(points[low][:, others]).query(points[high][:, others])
        back, _ = cKDTree(points[high][:, others]).query(points[low][:, others])
        missing = int((distance > PARTNER).sum() + (back > PARTNER).sum())
        faces = f"{name} = ±{half[axis]:.4g} ({len(low)} and {len(high)} nodes)"
        if missing:
            raise ConfigurationError(
                f"{what}: not periodic along {name}: {missing} nodes of the faces {faces} have no partner on the "
                f"opposite face; the largest distance to the nearest node there is "
                f"{max(distance.max(), back.max()):.3g} of the cell's length; mesh one face and copy it to the other "
                "(gmsh: setPeriodic)"
            )
        if len(low) != len(high) or len(np.unique(partner)) < len(high):
            raise ConfigurationError(
                f"{what}: not periodic along {name}: several nodes of the faces {faces} lie within {PARTNER:g} of the "
                "cell's length of one node of the opposite face; mesh one face, no finer than that, and copy it to "
                "the other (gmsh: setPeriodic)"
            )
        points[np.ix_(high, others)] = points[np.ix_(low[partner], others)]
    _check_facets(points, cells, half, what)
    return points


def _check_facets(points: Array, cells: IntArray, half: Array, what: str) -> None:
    """Refuse a mesh with boundary facets inside the cell, or with different facets on opposite faces."""
    boundary = boundary_facets(cells[:, :4])
    on_face = (np.abs(points[boundary]) == half).all(axis=1).any(axis=1)
    if not on_face.all():
        raise ConfigurationError(
            f"{what}: {int((~on_face).sum())} facets inside of the cell belong to one tetrahedron only; solid and "
            "fluid must fill the cell and share their nodes on the wall"
        )
    alone = int((np.bincount(facet_classes(points, boundary, -half, half)) == 1).sum())
    if alone:
        raise ConfigurationError(
            f"{what}: not periodic: the nodes of opposite faces match, but {alone} facets between them do not; mesh "
            "one face and copy it to the other (gmsh: setPeriodic)"
        )
