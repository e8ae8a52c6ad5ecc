"""Straight circular channels, the cell of Dehghani & Zilian among them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator
from pydantic_core.core_schema import ValidationInfo

from porocore.cell.geometry.cad import DrawnGeometry, DrawnPart
from porocore.cell.geometry.crossing import crossing_volume
from porocore.cell.geometry.drawing import eighth, split, wedge
from porocore.cell.geometry.fillet import onto_fillet, opened_volume
from porocore.cell.geometry.part import Unfolding
from porocore.cell.geometry.rounded_wedge import draw_wedge
from porocore.core.tensors.point_group import CUBIC, PointGroup
from porocore.core.units.dimensions import Unit
from porocore.states import Array

#: The mesh resolves every fillet, so that a smaller one would only cost elements.
SMALLEST_FILLET = 0.005
AxisRadius = Annotated[float, Field(ge=0, lt=0.5)]


class OrthogonalChannels(DrawnGeometry):
    """Straight circular channels along coordinate axes that meet in the middle of the cell.

    With all three axes this is the cell of Dehghani & Zilian: a cube from which three cylinders are subtracted. With
    ``radii`` every axis has a radius of its own, 0 where there is no channel, in place of ``radius`` and ``axes``.
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
            raise ValueError(f"radii stand in place of radius and axes; remove {' and '.join(given)}")
        if info.data.get("fillet"):
            raise ValueError(
                "fillets are drawn between channels of one radius only; give radius, or set fillet to 0"
            )
        return radii

    @property
    def _by_axis(self) -> dict[str, float]:
        """The radius of each channel there is."""
        if self.radii is None:
            return dict.fromkeys(self.axes, self.radius)
        return {axis: radius for axis, radius in zip("xyz", self.radii, strict=True) if radius}

    @property
    def porosity(self) -> float:
        """Exact volume share of the pores, φ_f.

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
        """See :class:`~porocore.cell.geometry.part.PoreGeometry`."""
        radii = self._by_axis
        sizes = ", ".join(f"{radius:g}" for radius in dict.fromkeys(radii.values()))
        return f"orthogonal channels of radius {sizes} along {', '.join(radii)}"

    @property
    def narrowest(self) -> float:
        """The smallest radius."""
        return min(self._by_axis.values())

    @property
    def disconnected(self) -> str:
        """Solid is left along every edge of the cell."""
        return ""

    @property
    def finest_fillet(self) -> float:
        """See :class:`~porocore.cell.geometry.part.PoreGeometry`."""
        return self.fillet

    @property
    def unfolding(self) -> Unfolding:
        """The wedge with all three axes alike, else the eighth."""
        radii = self._by_axis
        return "wedge" if len(radii) == 3 and len(set(radii.values())) == 1 else "eighth"

    @property
    def point_group(self) -> PointGroup:
        """Mirrors, and the permutations of axes with equal channels."""
        radii = np.array([self._by_axis.get(axis, 0.0) for axis in "xyz"])
        return CUBIC.kept(lambda Q: (np.abs(Q) @ radii == radii).all())

    def draw(self, gmsh: Any) -> DrawnPart:
        """Add the part to the current gmsh model."""
        occ = gmsh.model.occ
        if self.fillet and self.unfolding == "wedge":
            drawn = draw_wedge(occ, self.radius, self.fillet)
            occ.synchronize()
            return DrawnPart([drawn.solid], [drawn.fluid], drawn.fillets, [drawn.channel])
        part = (3, wedge(occ) if self.unfolding == "wedge" else eighth(occ))
        if self.fillet:
            solid, rest = split(occ, part, [(3, self._rounded_solid(gmsh))])
            return DrawnPart(solid, rest, _rounded_faces(gmsh, solid))
        # Within the wedge x² + y² is the smallest of the three, so only the channel along z is met.
        met = {"z": min(self._by_axis.values())} if self.unfolding == "wedge" else self._by_axis
        fluid, rest = split(occ, part, self._channels(occ, met))
        return DrawnPart(rest, fluid)

    def onto_fillet(self, points: Array) -> Array:
        """Points (n, 3) of the drawn part near a fillet, moved onto it."""
        return onto_fillet(points, self.radius, self.fillet, self.axes)

    def onto_channel(self, points: Array) -> Array:
        """Points (n, 3) of the wedge near the wall of its channel, moved onto it."""
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
        """The eighth of the solid between two channels.

        OpenCASCADE does not find every fillet between channels along x and z; those along x and y it does.
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
        """Between the channels along x and y."""
        low, high = gmsh.model.getParametrizationBounds(1, curve)
        x, y, z = gmsh.model.getValue(1, curve, [(low[0] + high[0]) / 2])
        return bool(abs(np.hypot(y, z) - self.radius) < 1e-6 and abs(np.hypot(x, z) - self.radius) < 1e-6)


def _rounded_faces(gmsh: Any, solid: list[int]) -> list[int]:
    faces = gmsh.model.getBoundary([(3, tag) for tag in solid], oriented=False)
    return sorted(tag for _, tag in faces if gmsh.model.getType(2, tag) not in ("Plane", "Cylinder"))
