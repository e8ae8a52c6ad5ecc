"""Repeats of a calibration of a body with other noise: how often and how far its intervals miss the truth."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.infer import Inference, infer
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.problem import Misfit
from porocore.commands.calibration.settings import FitSettings
from porocore.core.console import Console
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

pytest.importorskip("skfem")
pytestmark = pytest.mark.slow

REPEATS = 12
#: Chance of a statistic below, and above, its bounds.
CHANCE = 2e-2
TRUTH = {"radius": 0.22, "poisson_ratio": 0.32, "modulus": 1.2, "viscosity": 0.9}
GUESS = {"radius": 0.2, "poisson_ratio": 0.3, "modulus": 0.8, "viscosity": 1.5}
BOUNDS = {
    "radius": (0.12, 0.34),
    "poisson_ratio": (0.2, 0.44),
    "modulus": (0.2, 6.0),
    "viscosity": (0.1, 10.0),
}
SIDE = {"displacement": [0, None, 0]}
MACRO: dict[str, Any] = {
    "body": {"kind": "box", "elements": [1, 2, 1], "size": [0.1, 1.0, 0.1]},
    "boundary": {
        **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
        "y-": {"displacement": [0, 0, 0]},
        "y+": {"traction": [0, 1, 0], "pressure": 0},
    },
    "time": {"end": 100.0, "step": 40.0, "ramp_increments": 1, "ramp_step": 0.05, "profiles": []},
    "loads": [-0.05],
}


def between(squares: float, freedom: int) -> bool:
    """Whether a sum of squares is one of so many normal numbers."""
    low, high = chi2.ppf([CHANCE, 1 - CHANCE], freedom)
    return bool(low < squares < high)


def pull(value: float, ends: tuple[float | None, float | None], truth: float) -> float:
    """Distance of the truth from the value in standard deviations, by the end on its side."""
    end = ends[0] if truth < value else ends[1]
    assert end is not None
    return 1.96 * (truth - value) / abs(end - value)


def repeated(load: float, kinds: tuple[str, ...], share: float, seeds: int) -> list[tuple[Misfit, Inference]]:
    """Calibrations from a guess, with data of the truth and noise, a share of the largest value."""
    times = {"first": 0.1, "last": 60, "count": 12 // len(kinds)}
    unknowns = {
        name: {"lower": low, "upper": high, "start": GUESS[name]} for name, (low, high) in BOUNDS.items()
    }
    curves = {kind: {"quantity": kind, "deviation_share": share, "times": times} for kind in kinds}
    settings: dict[str, Any] = {
        "cell": {"viscosity": 1.0},
        "sampling": {"sampler": "sobol", "inputs": {"H22": {"range": [-0.1, 0.02]}}},
        "surrogate": {"backend": "polynomial"},
        "closure": "potential",
        "macro": {**MACRO, "loads": [load]},
        "calibration": {"unknowns": unknowns, "observations": curves},
    }
    plan = read_plan(settings, synthetic=True)
    cell = PorousFamilyLaw("radius", "poisson_ratio")
    law = ClosedLaw(cell, make_closure("potential", 0.6, NeoHookean(), np.eye(3), law="piola"))
    test = ExperimentModel(plan.experiments[0], plan.unknowns, law)
    model = StudiesModel([each.unknown for each in plan.unknowns], [test])
    exact = np.split(model.curves(np.array([*TRUTH.values()])).values, len(kinds))
    found = []
    for seed in range(seeds):
        made = [
            c.made_up(part, [seed, k]) for k, (c, part) in enumerate(zip(plan.curves, exact, strict=True))
        ]
        misfit = Misfit(model, curve_data(made))
        best = fit(misfit, FitSettings(starts=1), Console(StringIO())).best
        found.append((misfit, infer(misfit, best, rays=0)))
    return found


def test_intervals_are_as_wide_as_the_truth_is_away() -> None:
    found = repeated(-0.05, ("settlement", "pressure"), 0.01, REPEATS)
    rises, misfits, pulls = 0.0, 0.0, np.empty((REPEATS, len(TRUTH)))
    for row, (misfit, said) in enumerate(found):
        at = [one.coordinate(v) for one, v in zip(misfit.unknowns, TRUTH.values(), strict=True)]
        rises += 2 * (misfit.at(np.array(at)).cost - said.best.cost)
        misfits += 2 * said.best.cost
        for k, (interval, truth) in enumerate(zip(said.intervals, TRUTH.values(), strict=True)):
            pulls[row, k] = pull(said.values[k], interval.values, truth)
    data = len(found[0][0].data.values)
    assert between(rises, REPEATS * len(TRUTH))
    assert between(misfits, REPEATS * (data - len(TRUTH)))
    for name, squares in zip(TRUTH, np.square(pulls).sum(axis=0), strict=True):
        assert between(squares, REPEATS), name
    # Intervals that miss the truth are those with a pull above 1.96; four in twelve come once in 400 times.
    assert (np.abs(pulls) > 1.96).sum(axis=0).max() <= 3


def test_a_small_load_alone_leaves_one_direction_for_every_noise() -> None:
    """Drained modulus, ratio of first to last settlement and time scale are seen: three combinations of four."""
    names = [*TRUTH]
    for _, said in repeated(-0.005, ("settlement",), 0.003, 2):
        assert len(said.directions) == 1
        (unseen,) = said.directions
        step = dict(zip(names, unseen.step, strict=True))
        # A larger pore in a stiffer, more compressible solid, with a more viscous fluid.
        assert step["radius"] > 0 > step["poisson_ratio"]
        assert step["modulus"] > 0
        assert step["viscosity"] > 0
        assert not any(said.identifiable)
