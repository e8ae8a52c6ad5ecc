"""Bodies and unknowns of the tests of sensitivities and gradients: a column, a layered block, a pressed cylinder."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

TIME = {"end": 3.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()}
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
NEWTON = {"tolerance": 1e-13}


def law(*parameters, closure="potential", conductivity="piola"):
    cell = PorousFamilyLaw(*parameters, deformed=conductivity == "deformed")
    K = 0.02 * np.diag([1.0, 1.5, 2.0])
    return ClosedLaw(cell, make_closure(closure, 0.6, NeoHookean(), K, law=conductivity))


UNKNOWNS = {
    "radius": (CellParameterChange("radius"), 0.0),
    "poisson_ratio": (CellParameterChange("poisson_ratio", factor=True), 1.0),
    "modulus": (ModulusChange(), 1.0, True),
    "viscosity": (ViscosityChange(), 0.01, True),
    "load": (LoadChange(), 1.0),
    "traction": (BoundaryChange("y+", "traction", 1), -0.05),
    "pressure": (BoundaryChange("y+", "pressure"), 0.002),
    "initial": (InitialPressureChange(), 0.001),
}


#: Two branches: one relaxes within a step, one beyond the end.
RELAXING = {
    "relaxation.1.strength": (CellParameterChange("relaxation.1.strength"), 0.7),
    "relaxation.1.time": (CellParameterChange("relaxation.1.time"), 0.4),
    "relaxation.2.strength": (CellParameterChange("relaxation.2.strength"), 0.3),
    "relaxation.2.time": (CellParameterChange("relaxation.2.time"), 6.0),
}


def column(
    *,
    modulus: float = 1.0,
    load: float = 1.0,
    traction: float = -0.05,
    pressure: float = 0.002,
    initial: float = 0.001,
    **fields: Any,
) -> MacroProblem:
    """A column of three elements in units of the modulus: loads over it, and times as the viscosity over it."""
    found = {}
    if fields:
        found["radius"] = f"{0.2 + fields['radius']!r} + 0.01*y"
        found["poisson_ratio"] = f"{fields['poisson_ratio']!r}*(0.33 - 0.01*y)"
        found["viscosity"] = fields["viscosity"] / modulus
        found |= {name: value for name, value in fields.items() if "." in name}
    top = {"traction": (0, traction / modulus, 0), "pressure": pressure / modulus}
    data = {
        "body": {"kind": "box", "elements": (1, 3, 1), "size": (0.5, 1.5, 0.5)},
        "boundary": {**SIDES, "y-": {"displacement": (0, 0, 0)}, "y+": top},
        "time": TIME,
        "newton": NEWTON,
        "probes": {"inside": (0.2, 0.6, 0.3)},
        "fields": found,
        "initial": {"pressure": initial / modulus},
        "load": load,
    }
    return MacroProblem.model_validate(data)


def layers(*, radius=0.21, body_radius=1.0, modulus=1.0, moved=-0.05, **settings: Any) -> MacroProblem:
    """A block with a hard layer, turned axes and a lid that is moved down; it drains to one side."""
    axes = {"about": (0.3, 0.2, 1.0), "angle": "30 + 20*x"}
    top = {"displacement": (None, {"ramp": moved, "until": 0.4}, None)}
    data = {
        "body": {"kind": "box", "elements": (1, 2, 1), "size": (0.8, 1.0, 0.5)},
        "boundary": {
            "x-": {"displacement": (0, None, None)},
            "y-": {"displacement": (None, 0, None)},
            "z-": {"displacement": (None, None, 0)},
            "x+": {"pressure": 0},
            "y+": top,
        },
        "regions": {
            "hard": {"kind": "layer", "above": 0.5, "fields": {"radius": radius, "modulus": modulus}}
        },
        "fields": {"radius": f"{body_radius!r}*(0.24 - 0.02*x)", "axes": axes, "modulus": 1.0},
        "time": TIME | {"end": 1.4, "step": 0.5},
        "newton": NEWTON,
    }
    return MacroProblem.model_validate(data | settings)


LAYERS = {
    "radius": (CellParameterChange("radius", "hard"), 0.21),
    "body_radius": (CellParameterChange("radius", factor=True), 1.0),
    "modulus": (ModulusChange("hard"), 1.0, True),
    "moved": (BoundaryChange("y+", "displacement", 1), -0.05),
}


def pressed(*, follower, plate, flux, normal, load, initial) -> MacroProblem:
    """A quarter of a cylinder under a plate, a pressure around it, and an inflow at its base."""
    data = {
        "body": {"kind": "quarter-cylinder", "radius": 0.5, "height": 0.6, "elements": (1, 1, 1)},
        "boundary": {
            "x-": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"normal": normal, "flux": flux},
            "y+": {"plate": {"ramp": -plate, "until": 0.4}},
            "side": {"follower": follower, "pressure": 0},
        },
        "load": load,
        "time": TIME | {"end": 1.4, "step": 0.5},
        "newton": NEWTON,
        "initial": {"pressure": initial},
    }
    return MacroProblem.model_validate(data)
