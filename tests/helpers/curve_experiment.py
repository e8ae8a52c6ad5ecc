"""An experiment with a made-up law, its unknowns and observations, for tests of its curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.calibration.experiment import ExperimentModel
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.study.run.composition import with_memory
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

#: Difference of slopes from central differences, as a share of the largest slope of a curve.
ACCURACY = 1e-6
SIDE = {"displacement": [0, None, 0]}
BOUNDARY: dict[str, Any] = {
    **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
    "y-": {"displacement": [0, 0, 0]},
    "y+": {"traction": [0, 0.05, 0], "pressure": 0.002},
}
MACRO: dict[str, Any] = {
    "body": {"kind": "box", "elements": [1, 3, 1], "size": [0.5, 1.5, 0.5]},
    "boundary": BOUNDARY,
    "time": {"end": 1.0, "step": 0.8, "ramp_increments": 1, "ramp_step": 0.2, "profiles": []},
    "newton": {"tolerance": 1e-13},
    "probes": {"inside": [0.2, 0.6, 0.3]},
    "loads": [-1.0],
}
TIMES = {"first": 0.1, "last": 0.9, "count": 3}
CURVE = {"deviation": 0.01, "times": TIMES}
OBSERVATIONS = {
    "settlement": {"quantity": "settlement", **CURVE},
    "pressure": {"quantity": "pressure", "probe": "inside", **CURVE},
    "largest": {"quantity": "pressure", **CURVE},
    "move": {"quantity": "displacement", "probe": "inside", "component": 2, **CURVE},
    "drained": {"quantity": "drained", **CURVE},
    "inflow": {"quantity": "inflow", "surface": "y+", **CURVE},
    "force": {"quantity": "force", "surface": "y-", **CURVE},
    "heave": {"quantity": "heave", **CURVE},
    "least": {"quantity": "pressure_min", **CURVE},
    "sideways": {"quantity": "force", "surface": "x+", "component": 1, **CURVE},
}
UNKNOWNS: dict[str, Any] = {
    "radius": {"lower": 0.15, "upper": 0.3, "start": 0.21},
    "poisson_ratio": {"lower": 0.25, "upper": 0.4, "start": 0.33},
    "modulus": {"lower": 0.5, "upper": 2, "start": 1.3},
    "viscosity": {"lower": 0.3, "upper": 3, "start": 0.8},
    "pore": {"lower": 0.5, "upper": 2, "start": 1.2},
    "load": {"lower": -2, "upper": -0.5, "start": -0.9},
    "boundary.y+.pressure": {"lower": 0.001, "upper": 0.003, "start": 0.0021},
    "delay": {"of": "time_shift", "lower": -0.04, "upper": 0.1, "start": 0.03},
}
STUDY: dict[str, Any] = {
    "cell": {"viscosity": 1.0},
    "sampling": {"sampler": "sobol", "inputs": {"H22": {"range": [-0.1, 0.02]}}},
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
}


def planned(unknowns: dict[str, Any] = UNKNOWNS, **changes: Any) -> CalibrationPlan:
    settings: dict[str, Any] = {
        **STUDY,
        "macro": MACRO,
        "calibration": {"unknowns": unknowns, "observations": OBSERVATIONS},
        **changes,
    }
    return read_plan(settings, synthetic=True)


def law() -> ClosedLaw:
    cell = PorousFamilyLaw("radius", "poisson_ratio")
    return ClosedLaw(cell, make_closure("potential", 0.6, NeoHookean(), np.eye(3), law="piola"))


def model_of(plan: CalibrationPlan) -> ExperimentModel:
    (experiment,) = plan.experiments
    return ExperimentModel(experiment, plan.unknowns, with_memory(law(), experiment.config))


def starts(plan: CalibrationPlan) -> np.ndarray:
    return np.array([each.unknown.start for each in plan.unknowns])
