"""The wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cell with three channels and rounded ridges, built face by face.

Within the wedge only the channel along z is met, half of the fillet along one ridge, and a sixth of a corner. Boolean
operations and OpenCASCADE's own fillets fail on the corner's sphere and the planes that cut it lengthwise; points and
curves of the wedge are known, and its curved faces are filled in between them. The filling is not exact, the nodes
of the mesh are put onto the wall afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.states import Array

#: Points of the spline along the middle of the fillet.
SPLINE_POINTS = 25
#: Of a face's width and length: where the filling is made to pass through points of the wall.
GUIDES = np.linspace(0.0, 1.0, 6)[1:-1]


@dataclass(frozen=True)
class RoundedWedge:
    """Tags of what was drawn: volumes, and the faces of the wall."""

    solid: int
    fluid: int
    channel: int
    fillets: list[int]


def draw_wedge(occ: Any, radius: float, fillet: float) -> RoundedWedge:
    """Add solid and fluid of the wedge, which share the wall, to the current model."""
    r, f = radius, fillet
    R, root = r + f, np.sqrt(0.5)
    corner = np.full(3, R * root)
    middle = middle_of_fillet(R, f, np.linspace(0.0, np.pi / 4, SPLINE_POINTS))
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
        "corner": corner,
    }
    point = {name: occ.addPoint(*(float(x) for x in place)) for name, place in places.items()}
    lines: dict[tuple[str, str], int] = {}

    def line(a: str, b: str) -> None:
        lines[a, b] = occ.addLine(point[a], point[b])

    def arc(a: str, b: str, centre: int) -> None:
        lines[a, b] = occ.addCircleArc(point[a], centre, point[b])

    for pair in (
        ("origin", "axis"), ("axis", "top"), ("axis", "top diagonal"), ("origin", "middle"), ("origin", "tip"),
        ("top", "contact"), ("top", "edge"), ("edge", "middle"), ("edge", "far"), ("far", "top diagonal"),
        ("far", "tip"), ("top diagonal", "contact end"),
    ):  # fmt: skip
        line(*pair)
    arc("top", "top diagonal", point["axis"])
    arc("contact", "middle", point["centre"])
    for a, b in (("contact end", "middle end"), ("contact end", "tip"), ("tip", "middle end")):
        arc(a, b, point["corner"])
    # On the channel the fillet ends along a plane section through the origin, an ellipse.
    foot, major = occ.addPoint(0, 0, 0), point["contact"]
    lines["contact", "contact end"] = occ.addEllipseArc(major, foot, major, point["contact end"])
    inner = [occ.addPoint(*(float(x) for x in place)) for place in middle[1:-1]]
    lines["middle", "middle end"] = occ.addSpline([point["middle"], *inner, point["middle end"]])

    def loop(*names: str) -> int:
        curves = []
        for a, b in zip(names, (*names[1:], names[0]), strict=True):
            curves.append(lines[a, b] if (a, b) in lines else -lines[b, a])
        return int(occ.addCurveLoop(curves))

    def plane(*names: str) -> int:
        return int(occ.addPlaneSurface([loop(*names)]))

    def fill(guides: Array, *names: str) -> int:
        inside = [occ.addPoint(*(float(x) for x in place)) for place in guides]
        return int(occ.addSurfaceFilling(loop(*names), pointTags=inside))

    channel = fill(_on_channel(r, R), "top", "top diagonal", "contact end", "contact")
    fillets = [
        fill(_on_fillet(R, f), "contact", "contact end", "middle end", "middle"),
        fill(_on_corner(corner, f), "contact end", "tip", "middle end"),
    ]
    solid = [
        plane("top", "edge", "middle", "contact"),
        plane("top", "top diagonal", "far", "edge"),
        plane("top diagonal", "contact end", "tip", "far"),
        plane("edge", "far", "tip", "middle end", "middle"),
    ]
    fluid = [
        plane("origin", "axis", "top", "contact", "middle"),
        plane("axis", "top", "top diagonal"),
        plane("origin", "axis", "top diagonal", "contact end", "tip"),
        plane("origin", "middle", "middle end", "tip"),
    ]
    wall = [channel, *fillets]

    def volume(faces: list[int]) -> int:
        return int(occ.addVolume([occ.addSurfaceLoop([*faces, *wall])]))

    return RoundedWedge(volume(solid), volume(fluid), channel, fillets)


def _on_channel(r: float, R: float) -> Array:
    """Points for the filling to pass through."""
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
    on_fillet: Array = centre - fillet * _unit(contact + share[:, None] * (away / fillet - contact))
    return on_fillet


def _on_corner(corner: Array, fillet: float) -> Array:
    contact_tip_middle = _unit(np.array([[1.0, 1, 0], [1, 1, 1], [2, 1, 1]]))
    weights = np.array([[1.0, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])
    on_corner: Array = corner - fillet * _unit(weights @ contact_tip_middle)
    return on_corner


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def middle_of_fillet(R: float, fillet: float, t: Array) -> Array:
    """Where the fillet between the channels along y and z meets the plane y = z, (n, 3)."""
    sine, cosine = np.sin(t), np.cos(t)
    centre = R * np.stack([sine, cosine, cosine], axis=-1)
    bisector = np.stack([2 * sine, cosine, cosine], axis=-1)  # sum of the two directions of contact
    middle: Array = centre - fillet * _unit(bisector)
    return middle
