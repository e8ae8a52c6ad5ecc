"""Solid spheres or cylinders in a fluid (SphereArray, CylinderArray), and a cell without pores."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.family.surfaces import WallSurface, cylinder, sphere
from porocore.cell.geometry.cad import LARGEST_SIZE_TO_RADIUS, DrawnGeometry, DrawnPart, split, wedge
from porocore.cell.geometry.pore_geometry import PER_CUBE, Unfolding
from porocore.core.tensors import CUBIC, PointGroup
from porocore.core.units import Unit

#: Smallest gap between neighbours that a mesh resolves.
SMALLEST_GAP = 0.002


class SphereArray(DrawnGeometry):
    """Equal spheres on a simple cubic lattice, one in the middle of each cell (Zick & Homsy 1982)."""

    kind: Literal["sphere-array"]
    """Solid spheres on a simple cubic lattice, the pores around them."""
    radius: Annotated[float, Field(gt=0, le=0.5), Unit("cell")]
    """Radius of the spheres; at 0.5 they touch, which needs a neck."""
    neck: Annotated[float, Field(ge=0), Unit("cell")] = 0.0
    """Radius of round bars along the axes that join the spheres, below ``radius``; 0: none, and the spheres are
    loose."""

    @model_validator(mode="after")
    def _can_be_meshed(self) -> SphereArray:
        if self.neck >= self.radius:
            raise ValueError(f"neck = {self.neck:g} is not below the radius {self.radius:g} of the spheres")
        if self.neck == 0 and 1 - 2 * self.radius < SMALLEST_GAP:
            raise ValueError(
                f"radius = {self.radius:g} leaves a gap below {SMALLEST_GAP:g} between neighbours, which no mesh "
                "resolves; give a neck > 0, which fills it where it is narrowest, or a smaller radius"
            )
        return self

    @property
    def porosity(self) -> float:
        """Porosity 1 − 4/3 π r³, less the parts of the three bars outside the spheres."""
        r, n = self.radius, self.neck
        height = np.sqrt(r**2 - n**2)
        cap = np.pi * (r - height) ** 2 * (2 * r + height) / 3
        bar = 2 * (np.pi * n**2 * (0.5 - height) - cap)
        return float(1 - 4 / 3 * np.pi * r**3 - 3 * bar)

    @property
    def unfolding(self) -> Unfolding:
        """The wedge of a cubic cell."""
        return "wedge"

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        necks = [cylinder(axis, self.neck) for axis in "xyz"] if self.neck else []
        return [sphere(np.zeros(3), self.radius), *necks]

    @property
    def description(self) -> str:
        necks = f" with necks of radius {self.neck:g}" if self.neck else ""
        return f"spheres of radius {self.radius:g} on a cubic lattice{necks}"

    @property
    def disconnected(self) -> str:
        """Reason without necks; empty with necks."""
        return "" if self.neck else "its spheres do not touch; give cell.geometry.neck > 0"

    @property
    def narrowest(self) -> float:
        """Radius of the obstacles."""
        return self.radius

    def gap(self, x: float, y: float, z: float) -> float:
        """Return the distance from the sphere to the mirror plane across z, the only one in the wedge."""
        return 0.5 - float(np.sqrt(max(self.radius**2 - max(x**2 + y**2, self.neck**2), 0.0)))

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw the wedge, which only the bar along z enters."""
        occ = gmsh.model.occ
        solid = [(3, occ.addSphere(0, 0, 0, self.radius))]
        if self.neck:
            solid, _ = occ.fuse(solid, [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, self.neck))])
        return DrawnPart(*split(occ, (3, wedge(occ)), solid))


class CylinderArray(DrawnGeometry):
    """Equal cylinders along z on a square lattice (Sangani & Acrivos 1982)."""

    kind: Literal["cylinder-array"]
    """Solid cylinders along z on a square lattice, the pores around them."""
    radius: Annotated[float, Field(gt=0, lt=0.5), Unit("cell")]
    """Radius of the cylinders; at 0.5 neighbours would touch."""

    @model_validator(mode="after")
    def _can_be_meshed(self) -> CylinderArray:
        if 1 - 2 * self.radius < SMALLEST_GAP:
            raise ValueError(
                f"radius = {self.radius:g} leaves a gap below {SMALLEST_GAP:g} between neighbours, which no mesh "
                "resolves; give a smaller radius"
            )
        return self

    @property
    def porosity(self) -> float:
        """Porosity 1 − π r²."""
        return 1 - np.pi * self.radius**2

    @property
    def unfolding(self) -> Unfolding:
        """The eighth, one element high."""
        return "eighth"

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        return [cylinder("z", self.radius)]

    @property
    def point_group(self) -> PointGroup:
        """Point group 4/mmm of a square prism along z."""
        return CUBIC.kept(lambda Q: Q[2, 2] != 0)

    @property
    def description(self) -> str:
        return f"cylinders of radius {self.radius:g} along z on a square lattice"

    @property
    def disconnected(self) -> str:
        """Reason, across the axis of the cylinders."""
        return "its cylinders do not touch"

    @property
    def narrowest(self) -> float:
        """Radius of the obstacles."""
        return self.radius

    def gap(self, x: float, y: float, z: float) -> float:
        """Return the distance from the cylinder to the mirror planes across x and y."""
        return 0.5 - float(np.sqrt(max(self.radius**2 - min(x, y) ** 2, 0.0)))

    def elements(self, size: float) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; one layer only."""
        return PER_CUBE / min(size, LARGEST_SIZE_TO_RADIUS * self.narrowest) ** 2

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw a section and extrude it by one element; the flow is uniform along z."""
        occ = gmsh.model.occ
        square = (2, occ.addRectangle(0, 0, 0, 0.5, 0.5))
        disk = (2, occ.addDisk(0, 0, 0, self.radius, self.radius))
        pieces, origin = occ.fragment([square], [disk])
        within = set(origin[0])
        inside = within & set(origin[1])
        occ.remove(sorted(set(pieces) - within), recursive=True)
        solid, fluid = (
            [tag for dim, tag in occ.extrude(sorted(faces), 0, 0, 0.5, numElements=[1]) if dim == 3]
            for faces in (inside, within - inside)
        )
        occ.synchronize()
        return DrawnPart(solid, fluid, extruded=True)


class NoPores(DrawnGeometry):
    """Cell without pores, for checks: its response is that of the material."""

    kind: Literal["no-pores"]
    """A cell that is all solid, for checks: its response is that of the material."""

    @property
    def porosity(self) -> float:
        return 0.0

    @property
    def unfolding(self) -> Unfolding:
        """The wedge of a cubic cell."""
        return "wedge"

    @property
    def disconnected(self) -> str:
        """Empty: the solid is connected."""
        return ""

    @property
    def description(self) -> str:
        return "no pores"

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw the wedge."""
        part = DrawnPart([wedge(gmsh.model.occ)], [])
        gmsh.model.occ.synchronize()
        return part
