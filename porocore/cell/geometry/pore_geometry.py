"""Interface of a pore geometry (PoreGeometry), sides of its cell, surfaces of its wall; refusal of a large mesh."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.core.models.strict import StrictModel
from porocore.core.tensors import CUBIC, MIRRORS, TRIVIAL, PointGroup
from porocore.errors import ConfigurationError
from porocore.states import Array, BoolArray, IntArray

Sides = tuple[float, float, float]
CUBE: Sides = (1.0, 1.0, 1.0)
#: Significant bits of a side. Multiples of it are exact, so that copies of a cell meet in the same numbers.
BITS = 48


def unit_sides(lengths: Iterable[float]) -> Sides:
    """Return the sides of a box of volume 1 with the proportions of the given lengths; exactly 1 for a cube."""
    x, y, z = lengths
    if x == y == z:
        return CUBE
    edge = math.cbrt(x * y * z)
    return _rounded(x / edge), _rounded(y / edge), _rounded(z / edge)


def _rounded(side: float) -> float:
    mantissa, exponent = math.frexp(side)
    return math.ldexp(round(math.ldexp(mantissa, BITS)), exponent - BITS)


#: Real values; complex ones where a number of the geometry is complex.
Values = npt.NDArray[Any]


class WallSurface(Protocol):
    """Smooth function that vanishes on a surface.

    A number of the geometry may be complex, with a tiny imaginary part: that of the value is then the derivative by
    the number, to round-off.
    """

    def value(self, points: Array) -> Values:
        """Return the values (n,) at points (n, 3)."""

    def gradient(self, points: Array) -> Array:
        """Return the gradients (n, 3) at points (n, 3), for real numbers."""


@dataclass(frozen=True)
class Round:
    """Distance from a point, or from a straight line, less a radius: a sphere, or an endless cylinder.

    Attributes
    ----------
    centre : (3,)
        The point, or a point of the line.
    radius
        Radius.
    along : (3,)
        Direction of the line, of any length; 0 for a sphere.
    is_tube
        Whether the body is the part of the cylinder from ``centre`` to ``centre + along`` alone.
    """

    centre: Values
    radius: complex
    along: Values
    is_tube: bool = False

    def value(self, points: Array) -> Values:
        away = self._away(points)
        return np.asarray(np.sqrt((away * away).sum(axis=1)) - self.radius)

    def gradient(self, points: Array) -> Array:
        away = self._away(points)
        return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))

    def covers(self, points: Array, depth: float) -> BoolArray:
        """Return which points (n, 3) lie deeper than ``depth`` in the body, for real numbers."""
        deep: BoolArray = self.value(points) < -depth
        if self.is_tube:
            share = self._share(points - self.centre)
            deep &= (share >= 0) & (share <= 1)
        return deep

    def _away(self, points: Array) -> Values:
        away: Values = points - self.centre
        if np.any(self.along != 0):
            away = away - self._share(away)[:, None] * self.along
        return away

    def _share(self, away: Values) -> Values:
        return np.asarray((away @ self.along) / (self.along @ self.along))


def sphere(centre: Values, radius: complex) -> Round:
    """Return the surface of a sphere."""
    return Round(np.asarray(centre), radius, np.zeros(3))


def cylinder(axis: str, radius: complex) -> Round:
    """Return the surface of a cylinder around the axis "x", "y" or "z" through the middle of the cell."""
    return Round(np.zeros(3), radius, np.eye(3)["xyz".index(axis)])


@dataclass(frozen=True)
class Plane:
    """Plane X · normal = height in which two surfaces touch.

    Attributes
    ----------
    normal : (3,)
        Normal, of any length.
    height
        X · normal in the plane.
    between
        The two surfaces.
    """

    normal: Values
    height: complex
    between: tuple[WallSurface, WallSurface]

    def value(self, points: Array) -> Values:
        return np.asarray(points @ self.normal - self.height)

    def gradient(self, points: Array) -> Array:
        return np.tile(self.normal, (len(points), 1))


#: Tetrahedra of unit size in a unit cube; measured on drawn cells and level sets, 8 to 17.
PER_CUBE = 12.0
#: Tetrahedra along the fillets of a cell of unit size, times their radius; measured at radii of 0.02.
PER_FILLET = 1300.0
#: Largest number of elements; the memory that meshing so many takes was not measured.
MOST = 3_000_000


def require_few(count: float, key: str) -> None:
    """Refuse a mesh with too many elements, by their approximate number and the key of the size that decides.

    Raises
    ------
    ConfigurationError
        There are too many elements.
    """
    if not count <= MOST:
        shown = f"{count:,.0f}" if count < 1e12 else f"{count:.0e}"
        raise ConfigurationError(
            f"{key}: about {shown} tetrahedra would be made, at most {MOST:,} are; take larger elements, or wider "
            "pores and rounder ridges, which decide where they are narrower than the elements"
        )


Unfolding = Literal["wedge", "eighth", "whole"]


class PoreGeometry(StrictModel, ABC):
    """Shape of the pores in a periodic cell of volume 1 around the origin: the unit cube [−½, ½]³, or a box.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.cell.Geometry`. Most derive :class:`porocore.cell.geometry.drawn.DrawnGeometry` or
    :class:`porocore.cell.level_sets.cutting.LevelSetGeometry`, which make the mesh.
    """

    @property
    @abstractmethod
    def porosity(self) -> float:
        """Volume share φ_f of the pores, as exactly as the geometry is known; 0 without pores."""

    @property
    @abstractmethod
    def unfolding(self) -> Unfolding:
        """Part that is meshed and unfolded by mirrors.

        It is the wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cubic cell, the eighth of a cell with the three mirrors through its
        middle, from the middle to half of each side, or the whole cell.
        """

    @property
    @abstractmethod
    def description(self) -> str:
        """Short description, such as ``spheres of radius 0.4 on a cubic lattice``."""

    @property
    def sides(self) -> Sides:
        """Sides of the cell along x, y and z, in units of the cube root of its volume."""
        return CUBE

    @property
    def length(self) -> float | None:
        """Cube root of the cell's volume in metres, where it follows from the description of the pores."""
        return None

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks about the pores that a user should read before anything is solved."""
        return ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is suspect about the pores, and on what to do about it."""
        return ()

    @property
    def value_warnings(self) -> tuple[str, ...]:
        """Sentences on an image whose values are not those of two phases; also among the warnings."""
        return ()

    @property
    def error_of_shape(self) -> str:
        """Sentence on an error that the description of the pores makes in K and moduli; empty where there is none."""
        return ""

    @property
    def point_group(self) -> PointGroup:
        """Point group of the pores: the operations of the cube that, with some shift, map them onto themselves.

        It holds no operation that exchanges different sides of the cell. By default it has the operations that unfold
        the part. A smaller group costs accuracy, a larger one makes laws wrong. Regions of different material may be
        mapped onto each other, see :meth:`regions_after`.
        """
        return {"wedge": CUBIC, "eighth": MIRRORS, "whole": TRIVIAL}[self.unfolding]

    def regions_after(self, Q: IntArray) -> Mapping[str, str] | None:
        """Return the image of each region of the solid under an operation Q (3, 3) of the point group, by name.

        A region that is not named stays in place; None: regions are not mapped onto regions.
        """
        return {}

    @property
    def disconnected(self) -> str | None:
        """Reason why the solid is not connected across the periodic cell; empty if it is, None if a mesh must tell."""
        return None

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        """Return the surfaces on which the pore wall lies; None if a mesh of this kind cannot be moved.

        Their number and order do not depend on the geometry's numbers, which may be complex.
        """
        return None

    def specification(self) -> dict[str, Any]:
        """Return all that the cell depends on; of a file its content, not its path."""
        return self.model_dump(mode="json", exclude={"path"})

    def elements(self, size: float) -> float:
        """Return the approximate number of tetrahedra of a size in the whole cell, without meshing it."""
        return PER_CUBE / size**3

    @abstractmethod
    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        """Return the mesh of the part, both phases with the same nodes on the wall.

        Nodes on the planes of a part lie there to 1e-9. Nodes on the faces of a whole cell lie there exactly, and
        opposite faces have the same nodes to the last bit.

        Parameters
        ----------
        size
            Element size, in units of the cube root of the cell's volume.

        Raises
        ------
        PorocoreError
            The geometry cannot be meshed.
        """
