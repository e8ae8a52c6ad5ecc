"""The wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cell with rounded channels, drawn face by face in gmsh.

The wedge contains parts of the channel along z, half of the fillet along one ridge, and a sixth of a corner. Boolean
operations and OpenCASCADE's own fillets fail on the sphere of the corner and the planes that cut it lengthwise. So the
known points and curves of the wedge are drawn, and its curved faces are fillings between them. A filling is not exact;
the nodes of the mesh are projected onto the wall afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.states import Array

#: Points of the spline along the middle of the fillet.
SPLINE_POINTS = 25
#: Shares of the width and length of a face at which its filling passes through points of the wall.
GUIDES = np.linspace(0.0, 1.0, 6)[1:-1]


@dataclass(frozen=True)
class RoundedWedge:
    """Tags of the volumes of a drawn wedge, and of the faces of its wall."""

    solid: int
    fluid: int
    channel: int
    fillets: list[int]


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


def draw_wedge(occ: Any, radius: float, fillet: float) -> RoundedWedge:
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
    return RoundedWedge(drawing.volume([*solid, *wall]), drawing.volume([*fluid, *wall]), channel, fillets)


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
