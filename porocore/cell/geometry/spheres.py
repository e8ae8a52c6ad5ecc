"""Spherical pores on a lattice or at given centres, joined by throats (SpherePores, Throat)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations, product
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.geometry.drawn import DrawnGeometry, DrawnPart, split, wedge
from porocore.cell.geometry.pore_geometry import PER_CUBE, Round, Unfolding, WallSurface, sphere
from porocore.cell.level_sets.cutting import mesh_level_set
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.cell.symmetry import group_of_points, kinds
from porocore.core.models.strict import StrictModel
from porocore.core.tensors import CUBIC, PointGroup
from porocore.core.units import Unit
from porocore.states import Array, IntArray

#: Centres of the presets, and the distance of nearest neighbours.
LATTICES: dict[str, tuple[Array, float]] = {
    "cubic": (np.zeros((1, 3)), 1.0),
    "bcc": (np.array([[0, 0, 0], [0.5, 0.5, 0.5]]), 3**0.5 / 2),
    "fcc": (np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]), 2**0.5 / 2),
}
#: Smallest depth of a body in the part; one with less only touches it and is left out.
TOUCH = 1e-9
#: Limits on given centres in one cell, throats between them, and periods that a throat spans along an axis.
MOST, MOST_THROATS, FARTHEST = 64, 512, 4
#: Tolerance of equal lengths.
SAME = 1e-9
Radius = Annotated[float, Field(gt=0, lt=0.9), Unit("cell")]
Point = tuple[float, float, float]


class Throat(StrictModel):
    """A straight channel between the centres of two pores."""

    join: tuple[int, int]
    """Places of the two pores in the list of centres, from 0; the same place twice joins a pore with its periodic
    image."""
    shift: Annotated[tuple[int, int, int] | None, Unit("cells")] = None
    """Periods from the cell to the image of the second pore that is meant; null: to the nearest one."""
    radius: Radius | None = None
    """Radius of this throat; null: that of ``throat``."""


class SpherePores(DrawnGeometry):
    """Spherical pores at the points of a lattice or at given centres, repeated periodically.

    Overlapping pores are joined; others are joined by throats, in a lattice between nearest neighbours.
    """

    kind: Literal["sphere-pores"]
    """Spherical pores at the places of a lattice or at given centres, joined by throats or because they overlap."""
    lattice: Literal["cubic", "bcc", "fcc"] | None = None
    """Centres at the middle of the cell, at its corners too, or at the middles of its edges too; this or
    ``centres``."""
    centres: Annotated[tuple[Point, ...] | None, Unit("cell")] = None
    """1 to 64 points instead of a lattice; one beyond [−½, ½]³ stands for its periodic image."""
    radius: Radius | None = None
    """Radius of all pores; this or ``radii``."""
    radii: tuple[Radius, ...] | None = None
    """One radius for each centre."""
    throat: Annotated[float, Field(ge=0, lt=0.9), Unit("cell")] = 0.0
    """Radius of the throats, below that of the pores, in a lattice between nearest neighbours; 0: none, but for those
    with a radius of their own."""
    throats: tuple[Throat, ...] | None = None
    """Which of the given centres are joined."""

    @model_validator(mode="after")
    def _complete(self) -> SpherePores:
        if (self.lattice is None) == (self.centres is None):
            raise ValueError(
                f"expected one of the keys lattice and centres, got {'both' if self.lattice else 'neither'}"
            )
        if self.centres is not None and not 1 <= len(self.centres) <= MOST:
            raise ValueError(f"expected 1 to {MOST} centres, got {len(self.centres)}")
        if (self.radius is None) == (self.radii is None):
            raise ValueError(
                f"expected one of the keys radius and radii, got {'both' if self.radius else 'neither'}"
            )
        if self.lattice and self.radii:
            raise ValueError("the pores of a lattice are of one radius; give radius instead of radii")
        if self.lattice and self.throats is not None:
            raise ValueError("a lattice has throats between nearest neighbours; give their radius as throat")
        if self.centres and self.radii and len(self.radii) != len(self.centres):
            raise ValueError(
                f"expected {len(self.centres)} radii, one for each centre, got {len(self.radii)}"
            )
        if self.centres and self.throat and self.throats is None:
            raise ValueError("throat: say which centres are joined, for instance throats: [{join: [0, 1]}]")
        if len(self.throats or ()) > MOST_THROATS:
            raise ValueError(f"throats: expected at most {MOST_THROATS}, got {len(self.throats or ())}")
        for throat in self.throats or ():
            self._check(throat)
        if self.lattice and self.radius is not None and self.throat >= self.radius:
            raise ValueError(f"throat = {self.throat:g} is not below the radius {self.radius:g} of the pores")
        return self

    def _check(self, throat: Throat) -> None:
        count = len(self.centres or ())
        if not all(0 <= i < count for i in throat.join):
            raise ValueError(
                f"throats: expected places from 0 to {count - 1} to join, got {list(throat.join)}"
            )
        if throat.join[0] == throat.join[1] and not any(throat.shift or ()):
            raise ValueError(
                f"throats: to join pore {throat.join[0]} with its image give shift: [1, 0, 0] or so"
            )
        radius = self.throat if throat.radius is None else throat.radius
        reach = self._ends(throat)
        if not (np.isfinite(reach).all() and np.abs(np.diff(reach, axis=0)).max() <= FARTHEST):
            raise ValueError(
                f"throats: expected pores at most {FARTHEST} periods apart along each axis, got {list(throat.join)} "
                f"with the shift {list(throat.shift or ())}"
            )
        pores = [self._spheres[1][i] for i in throat.join]
        if not 0 < radius < min(pores):
            raise ValueError(
                f"throats: expected a radius above 0 and below those of the pores {list(throat.join)}, "
                f"{min(pores):g}, got {radius:g}; give radius there, or throat for all"
            )

    @property
    def _spheres(self) -> tuple[Array, Array]:
        """Centres (n, 3) and radii (n,) of one period."""
        if self.lattice:
            centres = LATTICES[self.lattice][0]
        else:
            centres = np.array(self.centres)
            centres = centres - np.rint(centres.real)
        radii = np.full(len(centres), self.radius) if self.radii is None else np.array(self.radii)
        return centres, radii

    @property
    def porosity(self) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; to about 5e-5."""
        return _porosity(self)

    @property
    def unfolding(self) -> Unfolding:
        """The wedge of a cubic lattice, else the whole cell."""
        return "wedge" if self.lattice else "whole"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the cube for a lattice, else that of spheres and throats."""
        return CUBIC if self.lattice else _point_group(self)

    @property
    def description(self) -> str:
        centres, radii = self._spheres
        where = f"on a {self.lattice} lattice" if self.lattice else f"at {len(centres)} given centres"
        size = f"radius {radii[0]:g}" if np.ptp(radii) == 0 else f"radii {radii.min():g} to {radii.max():g}"
        throats = f" with throats of radius {self.throat:g}" if self.throat else ""
        return f"spherical pores of {size} {where}{throats}"

    @property
    def narrowest(self) -> float:
        """Radius of the smallest pore or throat."""
        radii = [self.throat] if self.throat else []
        radii += [throat.radius for throat in self.throats or () if throat.radius is not None]
        return float(min([*radii, *self._spheres[1]]))

    def elements(self, size: float) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; a level set has the smallest radius."""
        return super().elements(size) if self.lattice else PER_CUBE / min(size, self.narrowest) ** 3

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        """A lattice is drawn, with sharp ridges where pores meet; at given centres a level set is cut.

        OpenCASCADE does not find every union of bodies in general position. The level set's ridges are cut off within
        an element.
        """
        if self.lattice:
            return super().tetrahedra(size, element)
        return mesh_level_set(self, self.pores(), min(size, self.narrowest), element)

    def pores(self) -> Capsules:
        """Spheres and throats, with the periodic images that may reach into the cell."""
        spheres = [(centre, centre, radius) for centre, radius in self._images()]
        return Capsules([*spheres, *self._tubes()])

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        spheres = [sphere(centre, radius) for centre, radius in self._images()]
        return [*spheres, *(Round(a, radius, b - a, is_tube=True) for a, b, radius in self._tubes())]

    def draw(self, gmsh: Any) -> DrawnPart:
        """The wedge of a lattice."""
        occ = gmsh.model.occ
        bodies = [
            (3, occ.addSphere(*a, radius) if np.array_equal(a, b) else occ.addCylinder(*a, *(b - a), radius))
            for a, b, radius in self.pores().reaching(0.0, 0.5, TOUCH)
        ]
        if len(bodies) > 1:
            bodies, _ = occ.fuse(bodies[:1], bodies[1:])
        fluid, solid = split(occ, (3, wedge(occ)), bodies)
        return DrawnPart(solid, fluid)

    def _images(self) -> list[tuple[Array, float]]:
        """Every sphere with the periodic images that may reach into the cell."""
        centres, radii = self._spheres
        return [
            (centre + shift, radius)
            for centre, radius in zip(centres, radii, strict=True)
            for shift in product((-1.0, 0.0, 1.0), repeat=3)
        ]

    def _tubes(self) -> list[tuple[Array, Array, float]]:
        """Ends and radius of every throat, with the periodic images that may reach into the cell."""
        if self.lattice:
            distance = LATTICES[self.lattice][1]
            if not self.throat:
                return []
            places = [centre for centre, _ in self._images()]
            return [
                (a, b, self.throat)
                for a, b in combinations(places, 2)
                if abs(np.linalg.norm(b - a) - distance) < 1e-9
            ]
        found = []
        for a, b, radius in self._given_tubes():
            reach = range(-1 - int(np.abs(b).max()), 2 + int(np.abs(b).max()))
            found += [(a + shift, b + shift, radius) for shift in product(map(float, reach), repeat=3)]
        return found

    def _given_tubes(self) -> list[tuple[Array, Array, float]]:
        """Return ends and radius of every given throat, once."""
        found = []
        for throat in self.throats or ():
            a, b = self._ends(throat)
            found.append((a, b, self.throat if throat.radius is None else throat.radius))
        return found

    def _ends(self, throat: Throat) -> Array:
        """Return the centres (2, 3) of the two pores that a throat joins, the first in the cell."""
        centres, _ = self._spheres
        given = np.array(self.centres)
        i, j = throat.join
        a, b = centres[i], centres[j]
        if throat.shift is None:
            return np.stack([a, b - np.rint((b - a).real)])
        return np.stack([a, a + (given[j] + np.array(throat.shift, dtype=np.float64) - given[i])])


@lru_cache(maxsize=8)
def _point_group(geometry: SpherePores) -> PointGroup:
    """Return the point group of given centres; each sphere and throat is a point with a length and a radius."""
    centres, radii = geometry._spheres
    tubes = geometry._given_tubes()
    middles = np.array([*centres, *((a + b) / 2 for a, b, _ in tubes)])
    along = np.array([*np.zeros_like(centres), *(b - a for a, b, _ in tubes)])
    sizes = np.column_stack([[*radii, *(r for _, _, r in tubes)], np.linalg.norm(along, axis=1)])

    def allows(Q: IntArray, order: IntArray) -> bool:
        turned, there = along @ Q.T, along[order]
        apart = np.minimum(np.abs(turned - there).max(axis=1), np.abs(turned + there).max(axis=1))
        return bool(apart.max() < SAME)

    return group_of_points(middles, kinds(sizes, SAME), SAME, allows)


@lru_cache(maxsize=8)
def _porosity(geometry: SpherePores) -> float:
    return geometry.pores().share(*((0.0, 0.5) if geometry.lattice else (-0.5, 0.5)))


#: Margin around the cell within which bodies contribute to the level set at the faces.
MARGIN = 0.1
#: Lines along each of two axes on which the volume is integrated, exactly along each line.
LINES = 500
CHUNK = 20_000

Body = tuple[Array, Array, float]


class Capsules:
    """Union of capsules, each with ends and a radius; a sphere is one of length 0."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.bodies = list(bodies)
        near = self.reaching(-0.5 - MARGIN, 0.5 + MARGIN, 0.0)
        self._start = np.array([a for a, _, _ in near])
        self._along = np.array([b - a for a, b, _ in near])
        self._radius = np.array([radius for _, _, radius in near])

    def reaching(self, low: float, high: float, touch: float) -> list[Body]:
        """Return the bodies that reach farther than ``touch`` into the box [low, high]³."""
        return [(a, b, r) for a, b, r in self.bodies if _distance(a, b, low, high) < r - touch]

    def value(self, points: Array) -> Array:
        """Return the distance (n,) of points (n, 3) to the union; inside it is negative, that to the nearest body."""
        return self._nearest(points)[0]

    def gradient(self, points: Array) -> Array:
        """Return the gradient (n, 3) of the distance at points (n, 3), away from the nearest body."""
        return self._nearest(points)[1]

    def _nearest(self, points: Array) -> tuple[Array, Array]:
        values, gradients = [np.empty(0)], [np.empty((0, 3))]
        square = np.maximum((self._along**2).sum(axis=1), 1e-30)
        for part in np.array_split(points, len(points) * len(self._radius) // 2_000_000 + 1):
            away = part[:, None] - self._start
            share = np.clip((away * self._along).sum(axis=2) / square, 0.0, 1.0)
            away -= share[:, :, None] * self._along
            distance = np.sqrt((away**2).sum(axis=2))
            nearest = (distance - self._radius).argmin(axis=1)
            row = np.arange(len(part))
            length = distance[row, nearest]
            values.append(length - self._radius[nearest])
            gradients.append(away[row, nearest] / np.maximum(length, 1e-30)[:, None])
        return np.concatenate(values), np.concatenate(gradients)

    def share(self, low: float, high: float) -> float:
        """Return the share of the box [low, high]³ in the bodies, bars without round ends, to about 5e-5."""
        count = round(LINES * (high - low))
        grid = low + (high - low) * (np.arange(count) + 0.5) / count
        lines = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
        bodies = self.reaching(low, high, 0.0)
        filled = 0.0
        for part in np.array_split(lines, len(lines) // CHUNK + 1):
            ends = [_crossing(part, *body) for body in bodies]
            enter = np.clip([a for a, _ in ends], low, high)
            leave = np.clip([b for _, b in ends], low, high)
            order = np.argsort(enter, axis=0)
            enter, leave = (np.take_along_axis(side, order, axis=0) for side in (enter, leave))
            before = np.maximum.accumulate(np.concatenate([np.full((1, len(part)), low), leave[:-1]]), axis=0)
            filled += float(np.maximum(leave - np.maximum(enter, before), 0.0).sum())
        return filled / ((high - low) * len(lines))


def _crossing(lines: Array, a: Array, b: Array, radius: float) -> tuple[Array, Array]:
    """Return the heights at which lines along z through points (n, 2) enter and leave a body; equal if never."""
    away = np.column_stack([lines - a[:2], np.full(len(lines), -a[2])])  # at z = 0
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length else np.zeros(3)
    # |away + z e − ((away + z e)·axis) axis|² = radius²
    rise = axis[2]
    along = away @ axis
    A = 1 - rise**2
    B = away[:, 2] - along * rise
    C = (away**2).sum(axis=1) - along**2 - radius**2
    if A > 1e-14:
        root = B**2 - A * C
        half = np.sqrt(np.maximum(root, 0.0)) / A
        enter, leave = -B / A - half, -B / A + half
        missed = root <= 0
    else:
        enter, leave = np.full(len(lines), -1e9), np.full(len(lines), 1e9)
        missed = C >= 0
    if length and abs(rise) > 1e-14:
        z = np.sort([-along / rise, (length - along) / rise], axis=0)
        enter, leave = np.maximum(enter, z[0]), np.minimum(leave, z[1])
    elif length:
        missed |= (along < 0) | (along > length)
    missed |= leave <= enter
    return np.where(missed, 0.0, enter), np.where(missed, 0.0, leave)


def _distance(a: Array, b: Array, low: float, high: float) -> float:
    """Return an upper bound of the distance of a straight line to the box [low, high]³; exact for a point."""
    points = a + np.linspace(0.0, 1.0, 201 if np.any(a != b) else 1)[:, None] * (b - a)
    return float(np.linalg.norm(points - np.clip(points, low, high), axis=1).min())
