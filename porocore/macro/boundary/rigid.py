"""Shapes of rigid indenters by their signed distance, with its gradient, Hessian and slope by the radius.

A distance is positive outside. The foremost point of a shape, its tip, is at the origin, and the shape lies behind it,
against the direction in which the indenter is pressed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, Tag, model_validator

from porocore.core.files.input_file import FromFile
from porocore.core.formulas import Value
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units import Dimension
from porocore.errors import ConfigurationError
from porocore.macro.boundary.closed_surface import ClosedSurface, read_surface
from porocore.states import Array

Length = Annotated[float, Field(gt=0), Dimension("displacement")]
#: Least distance from an axis or a centre of curvature that is divided by.
NEAR = 1e-300
#: Steps at most toward the points that an indenter comes upon.
SEARCH = 200


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """Distance of n points from the surface of a rigid body.

    Attributes
    ----------
    gap : (n,)
        Positive outside the rigid body.
    normal : (n, 3)
        Its gradient, the outward unit normal of the rigid body.
    hessian : (n, 3, 3)
        Its second derivative.
    by_radius : (n,)
        Its derivative by the radius of the shape at a fixed tip; zeros where there is no radius.
    normal_by_radius : (n, 3)
        That of the normal.
    """

    gap: Array
    normal: Array
    hessian: Array
    by_radius: Array
    normal_by_radius: Array


class IndenterShape(StrictModel, ABC):
    """Shape of a rigid body.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in :data:`AnyShape`.
    """

    #: True for a body of revolution about the direction in which it is pressed.
    of_revolution: ClassVar[bool] = False

    @property
    def has_radius(self) -> bool:
        """True if the shape has a radius, by which a run has derivatives."""
        return "radius" in type(self).model_fields

    @abstractmethod
    def distance(self, places: Array, axis: Array) -> SignedDistance:
        """Return the distance of ``places`` (n, 3) from the shape with its tip at 0.

        Parameters
        ----------
        axis : (3,)
            Unit vector from the tip into the shape, against the direction in which it is pressed.
        """

    def check(self, direction: Array, key: str) -> None:
        """Refuse a shape that does not go with the direction; the message begins with ``key``."""

    def check_beside(self, length: float, key: str) -> None:
        """Refuse a shape, with this ``key``, that cannot be pressed against a body of this length.

        Raises
        ------
        ConfigurationError
            Its file is no closed surface, or is measured in another unit than the body.
        """


def _about_centre(places: Array, across: Array, radius: float, axis: Array) -> SignedDistance:
    """Return the distance from a ball or a roller: ``places`` (n, 3) from its tip, projected by ``across`` (3, 3)."""
    places = places @ across
    arms = places - radius * axis
    length = np.maximum(np.linalg.norm(arms, axis=1), NEAR)
    n = arms / length[:, None]
    # The length less the radius, without the round-off of either where the tip is near.
    gap = ((places**2).sum(axis=1) - 2 * radius * (places @ axis)) / (length + radius)
    hessian = (across - n[:, :, None] * n[:, None, :]) / length[:, None, None]
    # The centre goes along the axis with the radius.
    return SignedDistance(gap, n, hessian, -n @ axis - 1.0, -hessian @ axis)


class SphericalIndenter(IndenterShape):
    """A sphere, such as the ball of an indenter."""

    of_revolution = True
    kind: Literal["sphere"] = "sphere"
    """A sphere, such as the ball of an indenter."""
    radius: Length
    """Radius of the ball."""

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        return _about_centre(places, np.eye(3), self.radius, axis)


class CylindricalIndenter(IndenterShape):
    """A long cylinder that lies on its side."""

    kind: Literal["cylinder"]
    """A cylinder that lies on its side and is longer than the body."""
    radius: Length
    """Radius of the cylinder."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction of the cylinder's axis, at right angles to that of the motion."""

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        along = np.array(self.axis) / np.linalg.norm(self.axis)
        across = np.eye(3) - np.outer(along, along)
        return _about_centre(places, across, self.radius, axis)

    def check(self, direction: Array, key: str) -> None:
        length = np.linalg.norm(self.axis)
        if length == 0 or abs(direction @ np.array(self.axis)) > 1e-6 * length:
            raise ValueError(
                f"{key}: expected an axis at right angles to the direction, got {list(self.axis)}"
            )


class PlaneIndenter(IndenterShape):
    """A plane across the direction of the motion."""

    kind: Literal["plane"]
    """A plane across the direction of the motion, larger than the body."""

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        n = len(places)
        return SignedDistance(
            places @ -axis, np.tile(-axis, (n, 1)), np.zeros((n, 3, 3)), np.zeros(n), np.zeros((n, 3))
        )


@dataclass(frozen=True, eq=False)
class _Meridian:
    """Distance d(ρ, z) in the half plane through the axis of a shape of revolution, all (n,); z goes into the shape.

    Those by the radius stand last.
    """

    d: Array
    slope_r: Array
    slope_z: Array
    rr: Array
    rz: Array
    zz: Array
    radius: Array
    r_radius: Array
    z_radius: Array

    def turned(self, places: Array, axis: Array) -> SignedDistance:
        """Return the distance in space."""
        rho, e = _radial(places, axis)
        n = self.slope_r[:, None] * e + self.slope_z[:, None] * axis
        hoop = np.where(rho > 1e-12 * np.abs(places).max(initial=1e-9), self.slope_r / rho, self.rr)
        er, ez = e[:, :, None] * e[:, None, :], np.outer(axis, axis)
        mixed = e[:, :, None] * axis
        hessian = (
            self.rr[:, None, None] * er
            + self.rz[:, None, None] * (mixed + mixed.swapaxes(1, 2))
            + self.zz[:, None, None] * ez
            + hoop[:, None, None] * (np.eye(3) - er - ez)
        )
        by_radius: Array = self.r_radius[:, None] * e + self.z_radius[:, None] * axis
        return SignedDistance(self.d, n, np.asarray(hessian, dtype=float), self.radius, by_radius)


def _radial(places: Array, axis: Array) -> tuple[Array, Array]:
    """Return the distance (n,) of places from the axis, and the unit vectors (n, 3) away from it."""
    arms = places - (places @ axis)[:, None] * axis
    rho = np.maximum(np.linalg.norm(arms, axis=1), NEAR)
    across = np.eye(3)[np.abs(axis).argmin()]
    across = across - (across @ axis) * axis
    return rho, np.where(rho[:, None] > NEAR, arms / rho[:, None], across / np.linalg.norm(across))


class FlatPunch(IndenterShape):
    """A round punch with a flat face and a rounded edge."""

    of_revolution = True
    kind: Literal["punch"]
    """A round punch with a flat face and a rounded edge."""
    radius: Length
    """Radius of the punch."""
    edge: Length
    """Radius of the rounding of its edge, at most that of the punch."""

    @model_validator(mode="after")
    def _rounded(self) -> FlatPunch:
        if self.edge > self.radius:
            raise ValueError("the edge is rounded by more than the radius of the punch; round it by less")
        return self

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        z, (rho, _) = places @ axis, _radial(places, axis)
        x, y, nothing = rho - (self.radius - self.edge), self.edge - z, np.zeros(len(places))
        length = np.maximum(np.hypot(x, y), NEAR)
        rounded = (x > 0) & (y > 0)
        side = ~rounded & (x > y)
        cos, sin = x / length, y / length
        curved = np.where(rounded, 1 / length, 0.0)
        slope = np.where(rounded, cos, side * 1.0)
        rr, rz = curved * sin**2, curved * sin * cos
        return _Meridian(
            # The face and its rounding without the round-off of the edge's radius.
            d=np.where(
                rounded,
                (x**2 + z**2 - 2 * self.edge * z) / (length + self.edge),
                np.where(side, x - self.edge, -z),
            ),
            slope_r=slope,
            slope_z=np.where(rounded, -sin, np.where(side, 0.0, -1.0)),
            rr=rr,
            rz=rz,
            zz=curved * cos**2,
            # The edge goes outward with the radius.
            radius=nothing - slope,
            r_radius=-rr,
            z_radius=-rz,
        ).turned(places, axis)


class ConicalIndenter(IndenterShape):
    """A cone with a rounded tip."""

    of_revolution = True
    kind: Literal["cone"]
    """A cone with a rounded tip."""
    angle: Annotated[float, Field(gt=0, lt=90)]
    """Angle between the cone's axis and its side, in degrees."""
    radius: Length
    """Radius of the rounding of its tip."""

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        sin, cos = np.sin(np.radians(self.angle)), np.cos(np.radians(self.angle))
        z, (rho, _) = places @ axis, _radial(places, axis)
        y = z - self.radius
        length = np.maximum(np.hypot(rho, y), NEAR)
        tip = rho * sin + y * cos < 0
        n_r, n_z = rho / length, y / length
        curved = np.where(tip, 1 / length, 0.0)
        rz, zz = -curved * n_r * n_z, curved * n_r**2
        return _Meridian(
            d=np.where(
                tip,
                (rho**2 + z**2 - 2 * self.radius * z) / (length + self.radius),
                rho * cos - z * sin - self.radius * (1 - sin),
            ),
            slope_r=np.where(tip, n_r, cos),
            slope_z=np.where(tip, n_z, -sin),
            rr=curved * n_z**2,
            rz=rz,
            zz=zz,
            # The centre of the rounding goes along the axis with its radius.
            radius=np.where(tip, -n_z, sin) - 1.0,
            r_radius=-rz,
            z_radius=-zz,
        ).turned(places, axis)


#: Lengths of a surface over that of the body beyond which the two are taken to be in different units.
OTHER_UNIT = 200.0


class SurfaceIndenter(FromFile, IndenterShape):
    """A body inside a closed surface of triangles, from a file such as STL."""

    kind: Literal["surface"]
    """A body inside a closed surface of triangles, from a file such as STL."""
    scale: Length = 1.0
    """Factor of the file's coordinates; with a unit, that of the file, such as ``1 mm``."""

    @property
    def surface(self) -> ClosedSurface:
        """Triangles of the file.

        Raises
        ------
        ValueError
            They are not one closed surface.
        """
        return read_surface(Path(self.path), str(self.sha256), self.scale)

    def distance(self, places: Array, axis: Array) -> SignedDistance:
        n = len(places)
        gap, normal, hessian = self.surface.distance(places)
        return SignedDistance(gap, normal, hessian, np.zeros(n), np.zeros((n, 3)))

    def check_beside(self, length: float, key: str) -> None:
        self.checked(key)
        try:
            own = self.surface.length
        except ValueError as error:
            raise ConfigurationError(f"{key}.path: {error}") from None
        if not length / OTHER_UNIT <= own <= length * OTHER_UNIT:
            raise ConfigurationError(
                f"{key}.scale: the surface is {own / length:.3g} times as long as the body; give the unit of the "
                "file, such as 1 mm"
            )


AnyShape = Annotated[
    Annotated[SphericalIndenter, Tag("sphere")]
    | Annotated[FlatPunch, Tag("punch")]
    | Annotated[CylindricalIndenter, Tag("cylinder")]
    | Annotated[ConicalIndenter, Tag("cone")]
    | Annotated[PlaneIndenter, Tag("plane")]
    | Annotated[SurfaceIndenter, Tag("surface")],
    by_kind(IndenterShape, "sphere"),
]


class RigidIndenter(StrictModel):
    """Rigid body without friction that is pressed against surfaces of the body, by a displacement or by a force."""

    shape: AnyShape
    """Shape of the rigid body."""
    place: Annotated[tuple[float, float, float], Dimension("displacement")]
    """[x, y, z] of its foremost point, the tip, at no displacement; of a ``surface`` that of the origin of its file,
    which is not turned."""
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Direction in which it moves toward the body, of any length; the shape lies behind the tip along it."""
    displacement: Annotated[Value | None, Dimension("displacement")] = None
    """Displacement along the direction."""
    force: Annotated[Value | None, Dimension("force")] = None
    """Force along the direction, of the whole where the body has symmetry planes; the indenter follows the surface."""
    surfaces: Annotated[tuple[Name, ...], Field(min_length=1)]
    """Surfaces of the body that it may touch."""
    under: Literal["sealed", "drained"] | None = None
    """Whether fluid leaves into the indenter where it touches, at the pressure 0; null: as ``macro.boundary`` says."""
    outside: Literal["drained"] | None = None
    """``drained``: fluid leaves at the pressure 0 where the indenter does not touch; null: as ``macro.boundary``
    has it."""
    penalty: Annotated[float, Field(ge=1, le=1e6)] = 100.0
    """Stiffness of the contact over that of a layer of the body one element thick."""

    @model_validator(mode="after")
    def _moved_in_one_way(self) -> RigidIndenter:
        if (self.displacement is None) == (self.force is None):
            raise ValueError("expected exactly one of displacement and force")
        if not any(self.direction):
            raise ValueError("the direction has no length; give one such as [0, -1, 0]")
        self.shape.check(self.along, "shape.axis")
        return self

    @property
    def along(self) -> Array:
        """Unit vector (3,) of the direction."""
        return np.asarray(np.array(self.direction) / np.linalg.norm(self.direction))

    def touches_circle(self, *, section: bool) -> bool:
        """Return if its contact is round and has a radius; that with a section in plane strain is a strip."""
        return self.shape.of_revolution and not section

    def way_to(self, arms: Array) -> float:
        """Return the displacement at which the indenter comes upon the first of some points; infinite if upon none.

        Parameters
        ----------
        arms : (n, 3)
            Ways from its place to the points.
        """
        reach = 1.0 + float(np.linalg.norm(arms, axis=1).max())
        motion = -reach
        for _ in range(SEARCH):
            # No gap is larger than the way to a point.
            gap = float(self.shape.distance(arms - motion * self.along, -self.along).gap.min())
            motion += gap
            if gap <= 1e-14 * reach or motion > reach:
                break
        return motion if motion <= reach else np.inf

    @property
    def motion(self) -> Value:
        """Prescribed displacement or force."""
        value = self.displacement if self.force is None else self.force
        assert value is not None
        return value

    @property
    def drains(self) -> bool:
        """True if fluid leaves somewhere on its surfaces."""
        return self.under == "drained" or self.outside is not None
