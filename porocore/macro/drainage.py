"""Check that the fluid of a macroscale problem can drain."""

from __future__ import annotations

import numpy as np

from porocore.macro.body.kinds import Box
from porocore.macro.problem import MacroSetup
from porocore.states import Array

#: A conductivity below this share of the largest is none: what the cell solver leaves where no pore runs through.
CLOSED = 1e-6


def undrained(macro: MacroSetup, conductivity: Array) -> list[str]:
    """Return why the body, or a surface with a prescribed pressure, cannot drain; empty where all can.

    Parameters
    ----------
    macro
        With the surfaces on which the pressure is prescribed; the direction is known of those across x, y or z.
    conductivity : (3, 3)
        K of the undeformed cell.
    """
    faces = macro.boundary.items()
    if not any(boundary.pressure is not None or boundary.flux != 0 for _, boundary in faces):
        return [
            "no surface has a prescribed pressure, so no fluid can leave and nothing consolidates; "
            "give one under macro.boundary"
        ]
    K, found = np.diag(conductivity), []
    if K.max() <= 0:
        return [
            "the cell conducts no fluid in any direction, so none leaves through the surfaces whose pressure or flux "
            "is prescribed and nothing consolidates; its pores must run through, see cell.geometry"
        ]
    for name, boundary in faces:
        face = macro.surfaces[name].of if name in macro.surfaces else name
        if face not in Box.surfaces:
            continue
        i = "xyz".index(face[0])
        if boundary.pressure is not None and K[i] <= CLOSED * K.max():
            kind = "face" if name == face else "surface"
            found.append(
                f"the cell conducts no fluid along {face[0]} (K_{i + 1}{i + 1} = {K[i]:.2g}), so none leaves "
                f"through the {kind} {name}, whose pressure is prescribed; see cell.geometry"
            )
    return found
