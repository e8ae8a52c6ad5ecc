"""Studies of calibration_coverage.py (CoverageStudy): unknowns, their true values and first guesses, tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from calibration import BOUNDS, CONFIG, LOADS, TRUTH, settings

#: First values of the searches, a guess that does not know the truth.
GUESS = {"radius": 0.225, "poisson_ratio": 0.33, "modulus": 0.8, "viscosity": 1.5}
#: Fewer states, on coarse meshes, and fewer steps of fewer elements.
COARSE_STATES = 32


@dataclass(frozen=True)
class CoverageStudy:
    """A calibration that is repeated with other noise.

    Attributes
    ----------
    words
        What it is, for the heading of the table.
    given
        Settings of the calibration, with the folder for its files.
    repeats
        Usual number of repeats.
    """

    words: str
    given: Callable[[Path], dict[str, Any]]
    repeats: int


def _guessed(given: dict[str, Any]) -> dict[str, Any]:
    """Settings whose unknowns start at the guess."""
    unknowns = {name: {**BOUNDS[name], "start": GUESS[name]} for name in TRUTH}
    return {**given, "unknowns": unknowns}


def _twin(folder: Path) -> dict[str, Any]:
    tests = {f"{name} {size}": load for name in ("confined", "unconfined") for size, load in LOADS.items()}
    return _guessed(settings(folder, 0, tuple(TRUTH), tests, 40))


def _confined(folder: Path) -> dict[str, Any]:
    return _guessed(settings(folder, 0, tuple(TRUTH), {"confined small": LOADS["small"]}, 40))


def _coarse(folder: Path) -> dict[str, Any]:
    """The confined test at the large load, with settlement and pressure at ten times each."""
    study = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    study["cell"]["mesh"] = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    study["sampling"] |= {
        "inputs": {"H22": {"range": [-0.2, 0.03]}, "p": {"range": [-0.02, 0.08]}},
        "options": {"count": COARSE_STATES, "corners": True, "states_per_member": 4},
        "test": {"count": 1},
        "workers": 1,
    }
    study["macro"]["body"]["elements"] = [1, 3, 1]
    study["macro"]["time"] = {"end": 4000, "step": 800, "ramp_increments": 1, "ramp_step": 2, "profiles": []}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "coarse.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    shared = {"deviation_share": 0.003, "times": {"first": 5, "last": 3000, "count": 10}}
    observed = {kind: {"quantity": kind, **shared} for kind in ("settlement", "pressure")}
    test = {"study": str(path.resolve()), "load": LOADS["large"], "observations": observed}
    return _guessed({"experiments": {"confined large": test}, "fit": {"starts": 1}})


#: Depths of the ball, and the times at which it has reached them, from rest and from the first.
DEPTHS, REACHED = (0.06, 0.12), (20, 320)


def _indentation(folder: Path) -> dict[str, Any]:
    """A ball pressed into a disc to one depth, held, pressed on and held again; force, contact radius, pressure."""
    study = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    study["cell"]["mesh"] = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    study["sampling"] |= {
        "inputs": {
            "p": {"range": [-0.02, 0.08]},
            "H22": {"range": [-0.2, 0.05]},
            "H11": {"range": [-0.03, 0.1]},
            "H33": {"range": [-0.03, 0.1]},
            "H12": {"range": [-0.12, 0.12]},
        },
        "options": {"count": 96, "corners": False, "states_per_member": 4},
        "test": {"count": 1},
        "workers": 1,
    }
    first, second = DEPTHS
    start, end = REACHED
    ball = {
        "shape": {"kind": "sphere", "radius": 2},
        "place": [0, 1, 0],
        "displacement": {"table": [[0, 0], [start, first], [end - start, first], [end, second]]},
        "surfaces": ["y+"],
        "under": "sealed",
        "outside": "drained",
        "penalty": 30,
    }
    study["macro"] = {
        "body": {"kind": "axisymmetric", "radius": 2, "height": 1, "elements": [4, 2], "grading": [4, 0.5]},
        "fields": study["macro"]["fields"],
        "boundary": {"y-": {"displacement": [0, 0, 0]}, "side": {"normal": 0}},
        "contact": {"ball": ball},
        "loads": [1],
        "time": {"end": 640, "step": 320, "ramp_increments": 2, "ramp_step": 10, "profiles": []},
    }
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "indentation.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    shared = {"deviation_share": 0.01, "times": {"first": 20, "last": 640, "count": 6}}
    observed = {
        kind: {"quantity": kind, "indenter": "ball", **shared} for kind in ("force", "contact_radius")
    }
    observed["pressure"] = {"quantity": "pressure", **shared}
    test = {"study": str(path.resolve()), "observations": observed}
    return _guessed({"experiments": {"sphere": test}, "fit": {"starts": 1}})


STUDIES = {
    "indentation": CoverageStudy(
        "a ball at two depths, force, contact radius and pressure, 1 % noise", _indentation, 100
    ),
    "twin": CoverageStudy("confined and unconfined, two loads, 1 % noise", _twin, 50),
    "coarse": CoverageStudy("coarse, confined, settlement and pressure, 0.3 % noise", _coarse, 200),
    "confined": CoverageStudy("confined at the small load alone, 1 % noise", _confined, 10),
}
