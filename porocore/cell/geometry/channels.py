"""Pores as straight circular channels along the axes (OrthogonalChannels), as in the paper's cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator
from pydantic_core.core_schema import ValidationInfo

from porocore.cell.family.surfaces import WallSurface, cylinder
from porocore.cell.geometry.cad import DrawnGeometry, DrawnPart
from porocore.cell.geometry.crossing import crossing_volume
from porocore.cell.geometry.drawing import eighth, split, wedge
from porocore.cell.geometry.fillet import onto_fillet, opened_volume, rounded_surfaces
from porocore.cell.geometry.pore_geometry import Unfolding
from porocore.cell.geometry.rounded_wedge import draw_wedge
from porocore.core.echo import joined
from porocore.core.tensors.point_group import CUBIC, PointGroup
from porocore.core.units.dimensions import Unit
from porocore.states import Array

#: Smallest radius of a fillet, since the mesh resolves each of them.
SMALLEST_FILLET = 0.005
AxisRadius = Annotated[float, Field(ge=0, lt=0.5)]


class OrthogonalChannels(DrawnGeometry):
    """Straight circular channels along coordinate axes that meet in the middle of the cell.

    With all three axes this is the cell of Dehghani & Zilian: a cube from which three cylinders are subtracted.
    ``radii``, one for each axis and 0 for no channel, replaces ``radius`` and ``axes``.
    """

    kind: Literal["orthogonal-channels"] = "orthogonal-channels"
    """Straight circular channels along the axes that meet in the middle of the cube."""
    radius: Annotated[float, Field(gt=0, lt=0.5), Unit("cell")] = 0.25
    """Radius of the channels; at 0.5 a channel would touch its image."""
    axes: Annotated[str, Field(pattern="^(x|y|z|xy|xz|yz|xyz)$")] = "xyz"
    """Directions of the channels."""

    fillet: Annotated[float, Unit("cell")] = 0.0
    """Radius with which the ridges are rounded where two channels meet, from 0.005 to that of the channels, with
    radius + fillet < 0.5; 0 leaves them sharp."""

    radii: Annotated[tuple[AxisRadius, AxisRadius, AxisRadius] | None, Unit("cell")] = None
    """Radii of the channels along x, y and z, 0 for none; in place of ``radius`` and ``axes``."""

    @field_validator("fillet")
    @classmethod
    def _fits(cls, fillet: float, info: ValidationInfo) -> float:
        if fillet == 0 or "radius" not in info.data or "axes" not in info.data:
            return fillet
        radius, axes = info.data["radius"], info.data["axes"]
        if len(axes) == 1:
            raise ValueError("one channel has no ridges to round; set fillet to 0 or add axes")
        if not (SMALLEST_FILLET <= fillet <= radius and radius + fillet < 0.5):
            raise ValueError(
                f"expected 0 (sharp ridges) or a radius from {SMALLEST_FILLET} to that of the channels, "
                f"{radius:g}, with radius + fillet < 0.5 (else no solid is left between the fillets), "
                f"got {fillet:g}"
            )
        return fillet

    @field_validator("radii")
    @classmethod
    def _alone(
        cls, radii: tuple[float, float, float] | None, info: ValidationInfo
    ) -> tuple[float, float, float] | None:
        if radii is None:
            return None
        if not any(radii):
            raise ValueError(
                "expected a channel along one axis at least, got three radii of 0; or kind: no-pores"
            )
        given = [key for key in ("radius", "axes") if info.data.get(key) != cls.model_fields[key].default]
        if given:
            raise ValueError(f"radii stand in place of radius and axes; remove {joined(given)}")
        if info.data.get("fillet"):
            raise ValueError(
                "fillets are drawn between channels of one radius only; give radius, or set fillet to 0"
            )
        return radii

    @property
    def _by_axis(self) -> dict[str, float]:
        """Radius of each channel by its axis."""
        if self.radii is None:
            return dict.fromkeys(self.axes, self.radius)
        return {axis: radius for axis, radius in zip("xyz", self.radii, strict=True) if radius}

    @property
    def porosity(self) -> float:
        """Exact volume share φ_f of the pores.

        Channels with different radii: :func:`~porocore.cell.geometry.crossing.crossing_volume`. Equal ones with
        sharp ridges: n π r² − (volume counted twice). Equal ones with rounded ridges:
        :func:`~porocore.cell.geometry.fillet.opened_volume`.
        """
        if self.radii is not None:
            return crossing_volume(*self.radii)
        if self.fillet == 0:
            return self._sharp_porosity(self.radius)
        r, n, R = self.radius, len(self.axes), self.radius + self.fillet
        wall = {2: 4 * np.pi * R - 16 * R**2, 3: 6 * np.pi * R - 24 * 2**0.5 * R**2}[n]
        return 1 - opened_volume(1 - self._sharp_porosity(R), wall, r, self.fillet, n)

    def _sharp_porosity(self, r: float) -> float:
        return {
            1: np.pi * r**2,
            2: 2 * np.pi * r**2 - 16 / 3 * r**3,
            3: 3 * np.pi * r**2 - 8 * 2**0.5 * r**3,
        }[len(self.axes)]

    @property
    def description(self) -> str:
        radii = self._by_axis
        sizes = ", ".join(f"{radius:g}" for radius in dict.fromkeys(radii.values()))
        return f"orthogonal channels of radius {sizes} along {', '.join(radii)}"

    @property
    def narrowest(self) -> float:
        """Smallest radius of a channel."""
        return min(self._by_axis.values())

    @property
    def disconnected(self) -> str:
        """Empty: solid runs along every edge of the cell."""
        return ""

    @property
    def finest_fillet(self) -> float:
        """Radius of the fillets, 0 for sharp ridges."""
        return self.fillet

    @property
    def unfolding(self) -> Unfolding:
        """The wedge for three equal channels, else the eighth."""
        radii = self._by_axis
        return "wedge" if len(radii) == 3 and len(set(radii.values())) == 1 else "eighth"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the mirrors and of the permutations of axes with equal channels."""
        radii = np.array([self._by_axis.get(axis, 0.0) for axis in "xyz"])
        return CUBIC.kept(lambda Q: (np.abs(Q) @ radii == radii).all())

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        if self.fillet:
            return rounded_surfaces(self.radius, self.fillet, self.axes)
        return [cylinder(axis, radius) for axis, radius in self._by_axis.items()]

    def draw(self, gmsh: Any) -> DrawnPart:
        occ = gmsh.model.occ
        if self.fillet and self.unfolding == "wedge":
            drawn = draw_wedge(occ, self.radius, self.fillet)
            occ.synchronize()
            return DrawnPart([drawn.solid], [drawn.fluid], drawn.fillets, [drawn.channel])
        part = (3, wedge(occ) if self.unfolding == "wedge" else eighth(occ))
        if self.fillet:
            solid, rest = split(occ, part, [(3, self._rounded_solid(gmsh))])
            return DrawnPart(solid, rest, _rounded_faces(gmsh, solid))
        # In the wedge x² + y² is the smallest of the three, so only the channel along z enters.
        inside = {"z": min(self._by_axis.values())} if self.unfolding == "wedge" else self._by_axis
        fluid, rest = split(occ, part, self._channels(occ, inside))
        split_at_once = DrawnPart(rest, fluid)
        if self.is_drawn(gmsh, split_at_once):
            return split_at_once
        # Where the ridges of two channels touch the third, r₁² + r₂² = r₃², one is lost unless they are cut in turn.
        occ.remove([(3, tag) for tag in rest + fluid], recursive=True)
        part = (3, eighth(occ))
        cut: list[tuple[int, int]] = [(3, eighth(occ))]
        for channel in self._channels(occ, inside):
            cut, _ = occ.cut(cut, [channel])
        return DrawnPart(*split(occ, part, cut))

    def onto_fillet(self, points: Array) -> Array:
        return onto_fillet(points, self.radius, self.fillet, self.axes)

    def onto_channel(self, points: Array) -> Array:
        """Return points (n, 3) of the wedge near the wall of its channel, projected onto it."""
        moved = points.copy()
        moved[:, :2] *= self.radius / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        return moved

    def _channels(self, occ: Any, radii: dict[str, float]) -> list[tuple[int, int]]:
        cylinders = []
        for axis, radius in radii.items():
            direction = [1.0 if a == axis else 0.0 for a in "xyz"]
            start = [-d for d in direction]
            cylinders.append((3, occ.addCylinder(*start, *(2 * d for d in direction), radius)))
        return cylinders

    def _rounded_solid(self, gmsh: Any) -> int:
        """Draw the eighth of the solid between two channels and return its tag.

        OpenCASCADE fails on some fillets between channels along x and z; they are drawn along x and y and rotated.
        """
        occ = gmsh.model.occ
        solid, _ = occ.cut([(3, eighth(occ))], self._channels(occ, {"x": self.radius, "y": self.radius}))
        occ.synchronize()
        ridges = [tag for _, tag in gmsh.model.getEntities(1) if self._is_ridge(gmsh, tag)]
        rounded = occ.fillet([tag for _, tag in solid], ridges, [self.fillet])
        thirds = {"xy": 0, "yz": 1, "xz": 2}[self.axes]
        occ.rotate(rounded, 0, 0, 0, 1, 1, 1, thirds * 2 * np.pi / 3)
        return int(rounded[0][1])

    def _is_ridge(self, gmsh: Any, curve: int) -> bool:
        """Return whether a curve is the ridge between the channels along x and y."""
        low, high = gmsh.model.getParametrizationBounds(1, curve)
        x, y, z = gmsh.model.getValue(1, curve, [(low[0] + high[0]) / 2])
        return bool(abs(np.hypot(y, z) - self.radius) < 1e-6 and abs(np.hypot(x, z) - self.radius) < 1e-6)


def _rounded_faces(gmsh: Any, solid: list[int]) -> list[int]:
    faces = gmsh.model.getBoundary([(3, tag) for tag in solid], oriented=False)
    return sorted(tag for _, tag in faces if gmsh.model.getType(2, tag) not in ("Plane", "Cylinder"))
