"""Configuration of a column whose settlement a calibration is given."""

from __future__ import annotations

from typing import Any

SIDE = {"displacement": [0, None, 0]}
STUDY: dict[str, Any] = {
    "title": "A column",
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.25},
        "material": {"poisson_ratio": 0.3},
        "viscosity": "1 mPa s",
        "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    },
    "scales": {"modulus": "0.5 MPa", "length": "1 mm", "pore": "2 um", "viscosity": "1 mPa s"},
    "sampling": {
        "inputs": {"H22": {"range": [-0.1, 0.02], "step": 0.02}, "p": {"range": [-0.02, 0.05], "step": 0.02}}
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 1.0, 0.1], "elements": [1, 4, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, "25 kPa", 0], "pressure": 0},
        },
        "loads": [-1],
        "time": {"end": "1 h", "step": "60 s", "ramp_increments": 2, "ramp_step": "1 s"},
    },
}
