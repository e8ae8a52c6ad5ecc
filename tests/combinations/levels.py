"""Levels of each factor, and the coarse study that a row of levels makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.macro.body.kinds import Box
from porocore.testing.macro_checks.bodies import write_tetrahedra

PORES: dict[str, dict[str, Any]] = {
    "isotropic": {"kind": "orthogonal-channels", "radius": 0.25},
    "orthotropic": {"kind": "orthogonal-channels", "radii": [0.2, 0.25, 0.3]},
    "one-channel": {"kind": "orthogonal-channels", "radii": [0.3, 0, 0]},
    "spheres": {"kind": "sphere-pores", "lattice": "cubic", "radius": 0.4, "throat": 0.3},
    "gyroid": {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.4},
    "image": {"kind": "voxels", "path": "pores.npy", "pore": 1, "repeat": "mirror"},
}
_FIBRES = {
    "kind": "holzapfel-gasser-ogden",
    "shear_modulus": 0.35,
    "bulk_modulus": 1.1,
    "k1": 0.2,
    "k2": 1.0,
}
MATERIALS: dict[str, dict[str, Any]] = {
    "neo-hookean": {"kind": "neo-hookean", "poisson_ratio": 0.35},
    "mooney-rivlin": {"kind": "mooney-rivlin", "c10": 0.15, "c01": 0.03, "bulk_modulus": 1.1},
    "ogden": {
        "kind": "ogden",
        "terms": [{"mu": 0.3, "alpha": 2.0}, {"mu": -0.05, "alpha": -2.0}],
        "bulk_modulus": 1.1,
    },
    "fibres": _FIBRES | {"directions": [[0, 1, 0]]},
    # No plane of the cube is a mirror of these.
    "fibres-oblique": _FIBRES | {"directions": [[1, 2, 3]]},
    "expression": {
        "kind": "expression",
        "energy": "c*(I1*J**(-2/3) - 3) + k/2*(J - 1)**2",
        "parameters": {"c": 0.18, "k": 1.1},
    },
}
FACTORS: dict[str, tuple[str, ...]] = {
    "pores": tuple(PORES),
    "material": tuple(MATERIALS),
    "sampler": ("density-sweep", "sobol", "latin-hypercube", "active", "macro-driven"),
    "surrogate": ("polynomial", "torch", "jax"),
    "closure": ("mean-gradient", "potential"),
    "conductivity": ("piola", "piola-unrotated", "deformed"),
    "body": ("column", "box", "cylinder", "quarter", "wedge", "file"),
    "load": ("traction", "displacement", "follower", "plate", "flux"),
    "time": ("steps", "tolerance", "curve", "function"),
}
#: Area of the top of each body, of the whole one where planes of symmetry cut it.
TOP = {
    "column": 0.04,
    "box": 0.72,
    "cylinder": np.pi / 4,
    "quarter": np.pi / 4,
    "wedge": np.pi / 4,
    "file": 0.72,
}
#: Of what is sampled; narrow, so that coarse surrogates serve.
STRAIN, PRESSURE = 0.03, [-0.01, 0.03]


def study(row: dict[str, str], folder: Path, fem: str) -> dict[str, Any]:
    """Return the configuration of a row, and write the files that it refers to into ``folder``."""
    surfaces, boundary = _body(row["body"], folder)
    _load(row["load"], row["time"], boundary, TOP[row["body"]])
    if row["pores"] == "image":
        np.save(folder / "pores.npy", _image())
    size = 0.2 if row["pores"] == "gyroid" else 0.4  # a level set takes it as it is
    return {
        "title": ", ".join(row.values()),
        "cell": {
            "geometry": PORES[row["pores"]],
            "material": MATERIALS[row["material"]],
            "mesh": {"size": size, "fluid_size": size, "element": "linear"},
        },
        "fem": {"backend": fem},
        "sampling": _sampling(row),
        "surrogate": {
            "backend": row["surrogate"],
            "seed": 1,
            "options": _training(row),
        },
        "closure": row["closure"],
        "conductivity": row["conductivity"],
        "macro": {
            "body": surfaces,
            "boundary": boundary,
            "loads": [0.004],
            "time": _time(row["time"]),
            "newton": {"tolerance": 1e-11},
        },
    }


def _image() -> Any:
    """Return the eighth of crossing channels, with one of them narrower, in 8³ voxels."""
    middle = (np.arange(8) + 0.5) / 16
    x, y, z = np.meshgrid(middle, middle, middle, indexing="ij")
    return ((y**2 + z**2 < 0.06) | (x**2 + z**2 < 0.06) | (x**2 + y**2 < 0.04)).astype(np.uint8)


def _sampling(row: dict[str, str]) -> dict[str, Any]:
    names = ["p", "H22"]
    if row["body"] != "column":
        names += ["H11"] if row["sampler"] == "density-sweep" else ["H11", "H33", "H12"]
    inputs: dict[str, Any] = {
        name: {"range": PRESSURE if name == "p" else [-STRAIN, STRAIN]} for name in names
    }
    count = 18 if len(names) == 2 else 20
    section: dict[str, Any] = {"sampler": row["sampler"], "inputs": inputs, "workers": 1}
    section["test"] = {"count": 2, "seed": 1}
    if row["sampler"] == "density-sweep":
        for name, entry in inputs.items():
            entry["step"] = (0.02 if name == "p" else STRAIN) if len(names) > 2 else 0.01
        section["tolerance"] = 1.0
    elif row["sampler"] == "macro-driven":
        section["options"] = {"count": count, "elements": 2, "steps": 4}
    else:
        section["options"] = {"count": count}
    return section


def _training(row: dict[str, str]) -> dict[str, Any]:
    if row["surrogate"] == "polynomial":
        return {}
    if row["closure"] == "potential":
        return {"iterations": 150}
    return {"epochs": 400, "hidden": [12, 12]}


def _body(body: str, folder: Path) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Return the body, and its supports: bottom and planes of symmetry are held, the top drains."""
    boundary: dict[str, dict[str, Any]] = {"y-": {"displacement": [0, 0, 0]}, "y+": {"pressure": 0}}
    round_body = {"radius": 0.5, "height": 1.0, "elements": [1, 2, 1]}
    if body == "column":
        sides = ("x-", "x+", "z-", "z+")
        boundary |= {side: {"displacement": [0, None, 0]} for side in sides}
        return {"kind": "box", "size": [0.2, 1, 0.2], "elements": [1, 4, 1]}, boundary
    if body == "box":
        return {"kind": "box", "size": [0.8, 1, 0.9], "elements": [2, 2, 2]}, boundary
    if body == "cylinder":
        return {"kind": "cylinder", **round_body}, boundary
    if body == "quarter":
        boundary |= {"x-": {"normal": 0}, "z-": {"normal": 0}}
        return {"kind": "quarter-cylinder", **round_body}, boundary
    if body == "wedge":
        boundary |= {"z-": {"normal": 0}, "oblique": {"normal": 0}, "y-": {"normal": 0}}
        return {"kind": "wedge", **round_body, "angle": 30}, boundary
    write_tetrahedra(folder / "body.msh", Box(size=(0.8, 1.0, 0.9), elements=(1, 2, 1)), bend=0.03)
    return {"kind": "file", "path": "body.msh"}, boundary


def _load(load: str, time: str, boundary: dict[str, dict[str, Any]], area: float) -> None:
    """Put the load on the top, a flux on the bottom; pushed down it is of some per cent of strain."""
    size: Any = -1.0
    if load == "plate":  # a force, of the stress of a traction
        size = -float(area)
    if time == "function":
        size = {"expression": f"{size}*sin(2*t)"}
    top = boundary["y+"]
    if load == "traction":
        top["traction"] = [0, size, 0]
    elif load == "displacement":
        top["displacement"] = [None, size, None]
    elif load == "follower":
        top["follower"] = {"expression": "sin(2*t)"} if time == "function" else 1.0
    elif load == "plate":
        top["plate"] = size
    else:
        boundary["y-"]["flux"] = size


def _time(time: str) -> dict[str, Any]:
    plan: dict[str, Any] = {
        "end": 0.4,
        "step": 0.1,
        "ramp_increments": 2,
        "ramp_step": 0.05,
        "profiles": [0.2],
    }
    if time == "tolerance":
        plan |= {"tolerance": 1e-2}
    if time == "curve":
        plan |= {"load_curve": [[0.1, 1.0], [0.2, 0.5]]}
    return plan
