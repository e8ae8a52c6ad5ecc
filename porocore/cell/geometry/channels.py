"""Circular channels along the axes (OrthogonalChannels), as in the paper's cell; their rounded ridges.

The wedge contains parts of the channel along z, half of the fillet along one ridge, and a sixth of a corner. Boolean
operations and OpenCASCADE's own fillets fail on the sphere of the corner and the planes that cut it lengthwise. So the
known points and curves of the wedge are drawn, and its curved faces are fillings between them. A filling is not exact;
the nodes of the mesh are projected onto the wall afterwards.

A ball of radius f that touches two channels of radius r has its centre at the distance R = r + f from both axes, on an
arc of an ellipse, for instance (R cos t, R cos t, R sin t) between the channels along x and y. The directions of its
contact points with the channels differ by the angle θ, cos θ = sin² t. A ball that touches three channels is centred at
the end of three such arcs. So the rounded part of the wall is a canal surface with parts of spheres in the corners,
and the solid is the set of points within f of the solid with channels of radius R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator
from pydantic_core.core_schema import ValidationInfo
from scipy.special import roots_legendre

from porocore.cell.geometry.drawn import DrawnGeometry, DrawnPart, eighth, split, wedge
from porocore.cell.geometry.pore_geometry import Plane, Unfolding, Values, WallSurface, cylinder, sphere
from porocore.core.echo import joined
from porocore.core.tensors import CUBIC, PointGroup
from porocore.core.units import Unit
from porocore.states import Array


@lru_cache(maxsize=16)
def crossing_volume(along_x: float, along_y: float, along_z: float) -> float:
    """Return the share of the cell in channels of the given radii along the axes; a radius of 0 is no channel.

    The area of each section across z is known: two crossing strips, and the part of the disk outside of them. It is
    integrated over z between the heights where a strip ends, where it varies like a square root.
    """
    from scipy.integrate import quad  # slow to import

    def section(z: float) -> float:
        """Return the area of the section in the quarter 0 ≤ x, y ≤ ½."""
        y = np.sqrt(max(along_x**2 - z**2, 0.0))  # half width of the strip along x
        x = np.sqrt(max(along_y**2 - z**2, 0.0))
        return float(0.25 - (0.5 - x) * (0.5 - y) + _beyond(along_z, float(x), float(y)))

    ends = sorted(
        {0.0, min(along_x, 0.5), min(along_y, 0.5), 0.5, *_corner_on_circle(along_x, along_y, along_z)}
    )
    total = 0.0
    for low, high in pairwise(ends):
        # z = low + (high − low) sin² s makes the integrand smooth at the ends.
        total += quad(
            lambda s, a=low, b=high: section(a + (b - a) * np.sin(s) ** 2) * (b - a) * np.sin(2 * s),
            0.0,
            np.pi / 2,
            epsabs=1e-13,
            epsrel=1e-12,
        )[0]
    return float(8 * total)


def _beyond(r: float, x: float, y: float) -> float:
    """Return the area of a quarter of a disk where the coordinates exceed x and y."""
    if x**2 + y**2 >= r**2:
        return 0.0
    right, top = np.sqrt(r**2 - y**2), np.sqrt(r**2 - x**2)
    angle = np.arctan2(top, x) - np.arctan2(y, right)
    return float((r**2 * angle - x * (top - y) - y * (right - x)) / 2)


def _corner_on_circle(along_x: float, along_y: float, along_z: float) -> list[float]:
    """Return the height at which the corner between the strips lies on the circle, if there is one."""
    square = (along_x**2 + along_y**2 - along_z**2) / 2
    inside = 0 < square < min(along_x, along_y) ** 2
    return [float(np.sqrt(square))] if inside else []


#: Points of the spline along the middle of the fillet.
SPLINE_POINTS = 25
#: Shares of the width and length of a face at which its filling passes through points of the wall.
GUIDES = np.linspace(0.0, 1.0, 6)[1:-1]


class _Drawing:
    """Points, curves and faces of a gmsh model by the names of their corners."""

    def __init__(self, occ: Any, corners: dict[str, Array]) -> None:
        self.occ = occ
        self.points = {name: self.point(place) for name, place in corners.items()}
        self.curves: dict[tuple[str, str], int] = {}

    def point(self, place: Array) -> int:
        return int(self.occ.addPoint(*(float(x) for x in place)))

    def line(self, a: str, b: str) -> None:
        self.curves[a, b] = self.occ.addLine(self.points[a], self.points[b])

    def arc(self, a: str, b: str, centre: str) -> None:
        self.curves[a, b] = self.occ.addCircleArc(self.points[a], self.points[centre], self.points[b])

    def loop(self, names: tuple[str, ...]) -> int:
        ends = zip(names, (*names[1:], names[0]), strict=True)
        curves = [self.curves[a, b] if (a, b) in self.curves else -self.curves[b, a] for a, b in ends]
        return int(self.occ.addCurveLoop(curves))

    def plane(self, *names: str) -> int:
        return int(self.occ.addPlaneSurface([self.loop(names)]))

    def filling(self, guides: Array, *names: str) -> int:
        inside = [self.point(place) for place in guides]
        return int(self.occ.addSurfaceFilling(self.loop(names), pointTags=inside))

    def volume(self, faces: list[int]) -> int:
        return int(self.occ.addVolume([self.occ.addSurfaceLoop(faces)]))


def draw_wedge(occ: Any, radius: float, fillet: float) -> DrawnPart:
    """Add solid and fluid of the wedge, with a common wall, to the current model."""
    R = radius + fillet
    middle = middle_of_fillet(R, fillet, np.linspace(0.0, np.pi / 4, SPLINE_POINTS))
    corners = _corners(radius, fillet, middle)
    drawing = _Drawing(occ, corners)
    _add_curves(drawing, middle)
    channel = drawing.filling(_on_channel(radius, R), "top", "top diagonal", "contact end", "contact")
    fillets = [
        drawing.filling(_on_fillet(R, fillet), "contact", "contact end", "middle end", "middle"),
        drawing.filling(_on_corner(corners["corner"], fillet), "contact end", "tip", "middle end"),
    ]
    solid = [
        drawing.plane("top", "edge", "middle", "contact"),
        drawing.plane("top", "top diagonal", "far", "edge"),
        drawing.plane("top diagonal", "contact end", "tip", "far"),
        drawing.plane("edge", "far", "tip", "middle end", "middle"),
    ]
    fluid = [
        drawing.plane("origin", "axis", "top", "contact", "middle"),
        drawing.plane("axis", "top", "top diagonal"),
        drawing.plane("origin", "axis", "top diagonal", "contact end", "tip"),
        drawing.plane("origin", "middle", "middle end", "tip"),
    ]
    wall = [channel, *fillets]
    return DrawnPart([drawing.volume([*solid, *wall])], [drawing.volume([*fluid, *wall])], fillets, [channel])


def _corners(r: float, f: float, middle: Array) -> dict[str, Array]:
    """Return the corners of all faces, and the centres of the arcs, by name."""
    R, root = r + f, np.sqrt(0.5)
    places: dict[str, Any] = {
        "origin": (0, 0, 0),
        "axis": (0, 0, 0.5),
        "edge": (0, 0.5, 0.5),
        "far": (0.5, 0.5, 0.5),
        "top": (0, r, 0.5),
        "top diagonal": (r * root, r * root, 0.5),
        "contact": (0, r, R),  # of fillet and channel, in the plane x = 0
        "contact end": (r * root, r * root, R * root),
        "middle": middle[0],  # of the fillet, in the plane y = z
        "middle end": middle[-1],
        "tip": np.full(3, R * root - f / np.sqrt(3)),  # of the corner
        "centre": (0, R, R),
        "corner": np.full(3, R * root),
    }
    return {name: np.asarray(place, dtype=np.float64) for name, place in places.items()}


def _add_curves(drawing: _Drawing, middle: Array) -> None:
    """Add the straight edges, the arcs, and the two curves along the fillet."""
    for pair in (
        ("origin", "axis"), ("axis", "top"), ("axis", "top diagonal"), ("origin", "middle"), ("origin", "tip"),
        ("top", "contact"), ("top", "edge"), ("edge", "middle"), ("edge", "far"), ("far", "top diagonal"),
        ("far", "tip"), ("top diagonal", "contact end"),
    ):  # fmt: skip
        drawing.line(*pair)
    drawing.arc("top", "top diagonal", "axis")
    drawing.arc("contact", "middle", "centre")
    for a, b in (("contact end", "middle end"), ("contact end", "tip"), ("tip", "middle end")):
        drawing.arc(a, b, "corner")
    occ, points = drawing.occ, drawing.points
    # On the channel the fillet ends along a plane section through the origin, an ellipse.
    foot, major = occ.addPoint(0, 0, 0), points["contact"]
    drawing.curves["contact", "contact end"] = occ.addEllipseArc(major, foot, major, points["contact end"])
    inner = [drawing.point(place) for place in middle[1:-1]]
    drawing.curves["middle", "middle end"] = occ.addSpline([points["middle"], *inner, points["middle end"]])


def _on_channel(r: float, R: float) -> Array:
    """Return points of the channel for the filling to pass through."""
    angle, share = np.meshgrid(np.pi / 4 * GUIDES, GUIDES)
    x, y = r * np.sin(angle.ravel()), r * np.cos(angle.ravel())
    low = R / r * y
    return np.stack([x, y, low + share.ravel() * (0.5 - low)], axis=1)


def _on_fillet(R: float, fillet: float) -> Array:
    t, share = (grid.ravel() for grid in np.meshgrid(np.pi / 4 * GUIDES, GUIDES))
    sine, cosine = np.sin(t), np.cos(t)
    centre = R * np.stack([sine, cosine, cosine], axis=1)
    contact = np.stack([sine, cosine, 0 * t], axis=1)
    away = centre - middle_of_fillet(R, fillet, t)
    return np.asarray(centre - fillet * _unit(contact + share[:, None] * (away / fillet - contact)))


def _on_corner(corner: Array, fillet: float) -> Array:
    contact_tip_middle = _unit(np.array([[1.0, 1, 0], [1, 1, 1], [2, 1, 1]]))
    weights = np.array([[1.0, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])
    return corner - fillet * _unit(weights @ contact_tip_middle)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def middle_of_fillet(R: float, fillet: float, t: Array) -> Array:
    """Return the section of the fillet between the channels along y and z with the plane y = z, (n, 3)."""
    sine, cosine = np.sin(t), np.cos(t)
    centre = R * np.stack([sine, cosine, cosine], axis=-1)
    bisector = np.stack([2 * sine, cosine, cosine], axis=-1)  # sum of the two directions of contact
    return np.asarray(centre - fillet * _unit(bisector))


#: Parameter at the corner with a third channel, in the middle of the quadrant of the ellipse.
CORNER = np.pi / 4


def opened_volume(
    sharp_volume: float, wall_area: float, radius: float, fillet: float, channels: int
) -> float:
    """Return the volume of the rounded solid, by Steiner's formula for the points within f of a sharp solid.

    Faces, arcs and corners of the sharp solid contribute a shell at the wall, the sectors of the canal surface and the
    sectors of the spheres. They do not overlap, since f is smaller than the wall's radius of curvature.

    Parameters
    ----------
    sharp_volume, wall_area
        Volume and wall area of the solid with sharp channels of radius R = ``radius`` + ``fillet``.
    radius, fillet
        Radii r and f.
    channels
        Number of channels, 2 or 3.
    """
    R, f = radius + fillet, fillet
    shell = wall_area * (R**2 - radius**2) / (2 * R)
    arcs, end = (24, CORNER) if channels == 3 else (8, np.pi / 2)
    x, weights = roots_legendre(40)
    t, dt = end * (x + 1) / 2, end / 2 * weights
    sine = np.sin(t)
    angle = np.arccos(sine**2)
    length = R * np.sqrt(1 + sine**2)
    turning = np.sqrt(2) / (1 + sine**2)  # curvature times length of the ellipse
    sectors = arcs * float(dt @ (f**2 / 2 * angle * length - 2 / 3 * f**3 * np.sin(angle / 2) * turning))
    # The directions of contact in a corner are 60° apart: an equilateral spherical triangle.
    solid_angle = 3 * np.arccos(1 / 3) - np.pi if channels == 3 else 0.0
    return sharp_volume + shell + sectors + 8 * solid_angle * f**3 / 3


def onto_fillet(points: Array, radius: float, fillet: float, axes: str) -> Array:
    """Return points (n, 3) of the eighth near the rounded wall, projected onto it along its normal.

    OpenCASCADE approximates fillets by splines, to some 1e-3 of their radius.
    """
    R = radius + fillet
    end = CORNER if len(axes) == 3 else np.pi / 2
    pairs = combinations(("xyz".index(axis) for axis in axes), 2)
    all_centres = np.stack([_nearest_centres(points, pair, R, end) for pair in pairs])
    nearest = np.linalg.norm(points - all_centres, axis=2).argmin(axis=0)
    centre = all_centres[nearest, np.arange(len(points))]
    away = points - centre
    return np.asarray(centre + fillet * away / np.linalg.norm(away, axis=1, keepdims=True))


def _nearest_centres(points: Array, pair: tuple[int, int], R: complex, end: float) -> Values:
    """Return the centres (n, 3) of the balls between the channels along a pair of axes that are nearest to points."""
    i, j = pair
    t = _nearest(np.sqrt(0.5) * (points[:, i] + points[:, j]), points[:, 3 - i - j], np.real(R), end)
    centre = np.zeros(points.shape, dtype=np.result_type(float, R))
    centre[:, i] = centre[:, j] = R * np.cos(t)
    centre[:, 3 - i - j] = R * np.sin(t)
    return centre


def _nearest(a: Array, b: Array, R: float, end: float) -> Array:
    """Return t in [0, end] of the point (√2 R cos t, R sin t) of the ellipse nearest to (a, b), by Newton's method."""
    t = np.arctan2(np.sqrt(2) * np.maximum(b, 0.0), a)
    for _ in range(30):
        sine, cosine = np.sin(t), np.cos(t)
        slope = R * sine * cosine + np.sqrt(2) * a * -sine + b * cosine
        curvature = R * (cosine**2 - sine**2) - np.sqrt(2) * a * cosine - b * sine
        t = np.clip(t - slope / np.where(np.abs(curvature) > 1e-12, curvature, -1.0), 0.0, end)
    return t


@dataclass(frozen=True)
class _Canal:
    """Canal surface of the fillet between two channels, in the eighth.

    Attributes
    ----------
    pair
        Axes of the two channels.
    R, fillet
        Distance of the ball's centre from both axes, and its radius.
    """

    pair: tuple[int, int]
    R: complex
    fillet: complex

    def value(self, points: Array) -> Values:
        away = self._away(points)
        return np.asarray(self.fillet - np.sqrt((away * away).sum(axis=1)))

    def gradient(self, points: Array) -> Array:
        away = self._away(points)
        return np.asarray(-away / np.linalg.norm(away, axis=1, keepdims=True))

    def _away(self, points: Array) -> Values:
        """Return the vectors from the nearest centres; to first order these do not depend on which is the nearest."""
        return np.asarray(points - _nearest_centres(points, self.pair, self.R, np.pi / 2))


def rounded_surfaces(radius: complex, fillet: complex, axes: str) -> list[WallSurface]:
    """Return the surfaces of the rounded wall in the eighth, and the planes in which they touch.

    A ball touches the channel i where r X_i = R X_j, and the sphere of a corner begins at the end of the ellipse.
    """
    R, places = radius + fillet, ["xyz".index(axis) for axis in axes]
    channels: list[WallSurface] = [cylinder(axis, radius) for axis in axes]
    canals: list[WallSurface] = []
    seams: list[WallSurface] = []
    corner: list[WallSurface] = []
    if len(axes) == 3:
        corner = [sphere(np.full(3, R * np.sqrt(0.5)), fillet)]
    for i, j in combinations(places, 2):
        canal = _Canal((i, j), R, fillet)
        canals.append(canal)
        for a, b in ((i, j), (j, i)):
            normal = np.zeros(3, dtype=np.result_type(float, R))
            normal[a], normal[b] = radius, -R
            seams.append(Plane(normal, 0.0, (channels[places.index(a)], canal)))
        if corner:
            normal = np.where(np.isin(range(3), [i, j]), -1.0, 1.0)
            seams.append(Plane(normal, -R * np.sqrt(0.5), (corner[0], canal)))
    return [*seams, *channels, *canals, *corner]


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

    #: Solid runs along every edge of the cell.
    disconnected: ClassVar[str] = ""

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

        Channels with different radii: :func:`~porocore.cell.geometry.channels.crossing_volume`. Equal ones with
        sharp ridges: n π r² − (volume counted twice). Equal ones with rounded ridges:
        :func:`~porocore.cell.geometry.channels.opened_volume`.
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
            return drawn
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
