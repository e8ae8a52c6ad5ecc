"""Problems with a follower, an oblique plane, and a plate beside one, of any size; a box and the same box turned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.macro.body.kinds import Box
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.states import Array
from porocore.testing.macro_checks.bodies import write_tetrahedra
from porocore.testing.synthetic.response import cubic_reference, mean_gradient_law

TIME = {"end": 0.15, "step": 0.05, "ramp_increments": 2, "ramp_step": 0.05, "profiles": ()}
EXACT: dict[str, Any] = {"time": TIME, "newton": {"tolerance": 1e-11}}
_PLANES: dict[str, Any] = {"oblique": {"normal": 0}, "z-": {"normal": 0}, "y-": {"normal": 0}}
_FACES: dict[str, dict[str, Any]] = {
    "follower": {"y-": {"displacement": (0, 0, 0)}, "y+": {"follower": 0.05, "pressure": 0}},
    "oblique": {**_PLANES, "y+": {"traction": (0, -0.05, 0), "pressure": 0}},
    "both": {**_PLANES, "y+": {"pressure": 0}, "side": {"follower": 0.05}},
    "plate": {**_PLANES, "y+": {"plate": -0.03}, "side": {"pressure": 0}},
}
NAMES = tuple(_FACES)


def problem(name: str, elements: int) -> MacroProblem:
    """Return one of :data:`NAMES`, with so many elements along each axis; 5 are more than 3,000 unknowns."""
    body: dict[str, Any] = {"kind": "box", "size": (1, 1, 1)}
    if name != "follower":
        body = {"kind": "wedge", "radius": 1, "height": 0.7, "angle": 60}
    body["elements"] = (elements, elements, elements if name == "follower" else (elements + 1) // 2)
    return MacroProblem.model_validate({"body": body, "boundary": _FACES[name], **EXACT})


def isotropic_law() -> ClosedLaw:
    """Return a nonlinear law that does not know the axes."""
    normal, lateral = -0.2297, -0.0754
    return mean_gradient_law(cubic_reference(normal=normal, lateral=lateral, shear=(normal - lateral) / 2))


def turned_box(folder: Path, turn: Array, held: dict[str, Any]) -> MacroProblem:
    """Return a box of bent tetrahedra, rotated by ``turn``, that drains on top under an inclined dead load."""
    path = folder / "box.msh"
    write_tetrahedra(path, Box(size=(1, 1.2, 0.8), elements=(2, 2, 2)), bend=0.05, turn=turn)
    load = tuple(map(float, np.asarray(turn) @ [0.004, -0.02, -0.006]))
    boundary = {**held, "y+": {"traction": load, "pressure": 0}}
    return MacroProblem.model_validate(
        {"body": {"kind": "file", "path": str(path)}, "boundary": boundary, **EXACT}
    )
