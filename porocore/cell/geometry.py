"""Pore geometries in the unit cube [−½, ½]³.

A geometry names its smallest part that mirror planes unfold into the whole cell and draws that part with
the OpenCASCADE kernel of gmsh; :mod:`porocore.cell.mirror` unfolds the mesh.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Unfolding = Literal["wedge", "eighth"]


class OrthogonalChannels(BaseModel):
    """Straight circular channels along coordinate axes that meet in the middle of the cell.

    With all three axes this is the cell of Dehghani & Zilian: a cube from which three cylinders are subtracted.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["orthogonal-channels"] = "orthogonal-channels"
    radius: Annotated[float, Field(gt=0, lt=0.5)] = 0.25
    axes: Annotated[str, Field(pattern="^(x|y|z|xy|xz|yz|xyz)$")] = "xyz"

    @property
    def porosity(self) -> float:
        """Exact volume share of the pores, φ_f = n π r² − (volume counted twice)."""
        r, n = self.radius, len(self.axes)
        return {
            1: np.pi * r**2,
            2: 2 * np.pi * r**2 - 16 / 3 * r**3,
            3: 3 * np.pi * r**2 - 8 * 2**0.5 * r**3,
        }[n]

    @property
    def unfolding(self) -> Unfolding:
        """The part that is drawn: the wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cubic cell, else the eighth [0, ½]³."""
        return "wedge" if self.axes == "xyz" else "eighth"

    def draw(self, gmsh: Any) -> tuple[list[int], list[int]]:
        """Add the part to the current gmsh model; returns the tags of its solid and fluid volumes."""
        occ = gmsh.model.occ
        if self.unfolding == "wedge":
            part = _tetrahedron(occ, [(0, 0, 0), (0, 0, 0.5), (0, 0.5, 0.5), (0.5, 0.5, 0.5)])
            axes = "z"  # within the wedge x² + y² is the smallest of the three, so only this channel is met
        else:
            part = occ.addBox(0, 0, 0, 0.5, 0.5, 0.5)
            axes = self.axes
        cylinders = []
        for axis in axes:
            direction = [1.0 if a == axis else 0.0 for a in "xyz"]
            start = [-d for d in direction]
            cylinders.append((3, occ.addCylinder(*start, *(2 * d for d in direction), self.radius)))
        pieces, origin = occ.fragment([(3, part)], cylinders)
        of_part = set(origin[0])
        fluid = {piece for images in origin[1:] for piece in images} & of_part
        occ.remove([piece for piece in set(pieces) - of_part if piece[0] == 3], recursive=True)
        occ.synchronize()
        return sorted(tag for _, tag in of_part - fluid), sorted(tag for _, tag in fluid)


def _tetrahedron(occ: Any, corners: list[tuple[float, float, float]]) -> int:
    points = [occ.addPoint(*corner) for corner in corners]
    edge = {(i, j): occ.addLine(points[i], points[j]) for i in range(4) for j in range(i + 1, 4)}
    faces = [
        occ.addPlaneSurface([occ.addCurveLoop([edge[i, j], edge[j, k], -edge[i, k]])])
        for i, j, k in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))
