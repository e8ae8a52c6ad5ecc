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


STUDIES = {
    "twin": CoverageStudy("confined and unconfined, two loads, 1 % noise", _twin, 50),
    "coarse": CoverageStudy("coarse, confined, settlement and pressure, 0.3 % noise", _coarse, 200),
    "confined": CoverageStudy("confined at the small load alone, 1 % noise", _confined, 10),
}
