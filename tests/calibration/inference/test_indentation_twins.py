"""Twin experiments of an indentation at two depths: intervals of numbers of the cell and scales; made-up law."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.experiment import StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.problem import Misfit
from porocore.core.console import Console
from tests.helpers.curve_experiment import model_of, planned

pytest.importorskip("skfem")

SEEDS = 5
TRUTH = {"radius": 0.22, "poisson_ratio": 0.32, "modulus": 1.0, "viscosity": 1.0}
UNKNOWNS = {
    "radius": {"lower": 0.15, "upper": 0.3, "start": 0.21},
    "poisson_ratio": {"lower": 0.2, "upper": 0.42, "start": 0.3},
    "modulus": {"lower": 0.3, "upper": 3, "start": 1.3},
    "viscosity": {"lower": 0.2, "upper": 5, "start": 0.8},
}
BALL = {
    "shape": {"kind": "sphere", "radius": 2},
    "place": [0, 1, 0],
    "displacement": {"table": [[0, 0], [0.5, 0.04], [15.5, 0.04], [16, 0.08]]},
    "surfaces": ["y+"],
    "under": "sealed",
    "outside": "drained",
    "penalty": 30,
}
MACRO: dict[str, Any] = {
    "body": {"kind": "axisymmetric", "radius": 2, "height": 1, "elements": [3, 2], "grading": [3, 0.5]},
    "boundary": {"y-": {"displacement": [0, 0, 0]}, "side": {"normal": 0}},
    "contact": {"ball": BALL},
    "time": {"end": 32, "step": 16, "ramp_increments": 2, "ramp_step": 0.25, "profiles": []},
    "loads": [1.0],
}
CURVE = {"deviation_share": 0.01, "times": {"first": 0.5, "last": 32, "count": 7}}
OBSERVED = {
    "force": {"quantity": "force", "indenter": "ball", **CURVE},
    "radius": {"quantity": "contact_radius", "indenter": "ball", **CURVE},
    "pressure": {"quantity": "pressure", **CURVE},
}


@pytest.mark.slow
def test_intervals_cover_the_truth() -> None:
    """1 % noise; the sum of squares rises at the truth by a χ² of four degrees of freedom."""
    section = {"unknowns": UNKNOWNS, "observations": OBSERVED, "fit": {"starts": 1}}
    plan = planned({}, macro=MACRO, calibration=section)
    model = StudiesModel([each.unknown for each in plan.unknowns], [model_of(plan)])
    truth = np.array([*TRUTH.values()])
    exact, inside, rises = np.split(model.curves(truth).values, len(plan.curves)), 0, 0.0
    for seed in range(SEEDS):
        pairs = enumerate(zip(plan.curves, exact, strict=True))
        curves = [each.made_up(values, [seed, k]) for k, (each, values) in pairs]
        misfit = Misfit(model, curve_data(curves))
        found = fit(misfit, plan.fit, Console(io.StringIO()))
        said = infer(misfit, found.best, rays=0)
        at = np.array([one.coordinate(float(v)) for one, v in zip(model.unknowns, truth, strict=True)])
        rises += 2 * (misfit.at(at).cost - said.best.cost)
        for each, value in zip(said.data_intervals, truth, strict=True):
            low, high = each.values
            inside += (low is None or low <= value) and (high is None or value <= high)
    # 99.9 % quantiles of the binomial distribution and of χ² with twenty degrees of freedom.
    assert inside >= 15
    assert 5.9 < rises < 45.3
