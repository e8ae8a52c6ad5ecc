"""Volumes drawn with gmsh's OpenCASCADE: the eighth, the wedge, and a volume split by tools."""

from __future__ import annotations

from typing import Any


def split(occ: Any, part: tuple[int, int], tools: list[tuple[int, int]]) -> tuple[list[int], list[int]]:
    """Split a volume by some tools and return the tags of its pieces inside and outside of them."""
    pieces, origin = occ.fragment([part], tools)
    of_part = set(origin[0])
    inside = {piece for images in origin[1:] for piece in images} & of_part
    occ.remove([piece for piece in set(pieces) - of_part if piece[0] == 3], recursive=True)
    occ.synchronize()
    return sorted(tag for _, tag in inside), sorted(tag for _, tag in of_part - inside)


def eighth(occ: Any) -> int:
    """Draw the volume [0, ½]³ and return its tag."""
    return int(occ.addBox(0, 0, 0, 0.5, 0.5, 0.5))


def wedge(occ: Any) -> int:
    """Draw the volume 0 ≤ x ≤ y ≤ z ≤ ½ and return its tag."""
    corners = ((0, 0, 0), (0, 0, 0.5), (0, 0.5, 0.5), (0.5, 0.5, 0.5))
    points = [occ.addPoint(*corner) for corner in corners]
    edge = {(i, j): occ.addLine(points[i], points[j]) for i in range(4) for j in range(i + 1, 4)}
    faces = [
        occ.addPlaneSurface([occ.addCurveLoop([edge[i, j], edge[j, k], -edge[i, k]])])
        for i, j, k in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))
