"""Twin experiments of a solid that relaxes, in confined and unconfined compression: intervals, and what hides what."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.infer import Inference, infer
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import by_curve, curve_data
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import Misfit, slopes_at
from porocore.core.console import Console
from porocore.states import Array
from porocore.study.run.composition import with_memory
from tests.helpers.curve_experiment import STUDY, law

pytest.importorskip("skfem")

SEEDS = 5
#: Sections of plane strain: a layer that drains through its top, and a block between plates that drains at its side.
TESTS: dict[str, dict[str, Any]] = {
    "confined": {
        "body": {"kind": "plane-strain", "size": [0.5, 1], "elements": [1, 2]},
        "boundary": {"x+": {"normal": 0}, "y+": {"traction": [0, 1, 0], "pressure": 0}},
    },
    "unconfined": {
        "body": {"kind": "plane-strain", "size": [1, 0.5], "elements": [2, 1]},
        "boundary": {"x+": {"pressure": 0}, "y+": {"plate": 0.5}},
    },
}
UNKNOWNS: dict[str, Any] = {
    "radius": {"lower": 0.15, "upper": 0.3},
    "modulus": {"lower": 0.3, "upper": 3},
    "viscosity": {"lower": 0.1, "upper": 10},
    "relaxation.1.strength": {"lower": 0, "upper": 5},
    "relaxation.1.time": {"lower": 1, "upper": 1e4},
}
#: Drainage takes h²/c_v = 176 units of time.
TIME, FIRST, LAST, COUNT = 200.0, 2.0, 3000.0, 9


def planned(
    folder: Path, tests: tuple[str, ...] = tuple(TESTS), *, time: float = TIME, since: float = FIRST
) -> CalibrationPlan:
    """Return the twin of some tests; the settlement is measured from a time on."""
    times = np.geomspace(FIRST, LAST, COUNT)
    branches = [{"strength": 1.0, "time": time}]
    shared = {"fields": {"radius": 0.22, "poisson_ratio": 0.33}, "loads": [-0.05]}
    plan = {"end": LAST, "step": LAST, "ramp_increments": 1, "ramp_step": 1, "profiles": times[:-1].tolist()}
    experiments = {}
    for name in tests:
        own = TESTS[name]
        held = {"x-": {"normal": 0}, "y-": {"normal": 0}}
        study = {
            **STUDY,
            "cell": {"viscosity": 1.0, "material": {"relaxation": {"branches": branches}}},
            "macro": {**own, **shared, "boundary": {**held, **own["boundary"]}, "time": plan},
        }
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(study), encoding="utf-8")
        measured = {"first": since, "last": LAST, "count": COUNT}
        observed = {"quantity": "settlement", "deviation_share": 0.01, "times": measured}
        experiments[name] = {"study": str(path), "observations": {"settlement": observed}}
    return read_plan({"unknowns": UNKNOWNS, "experiments": experiments, "fit": {"starts": 1}}, synthetic=True)


def model_of(plan: CalibrationPlan) -> StudiesModel:
    laws = [with_memory(law(), each.config) for each in plan.experiments]
    models = [
        ExperimentModel(each, plan.unknowns, own) for each, own in zip(plan.experiments, laws, strict=True)
    ]
    return StudiesModel([each.unknown for each in plan.unknowns], models)


def truth(model: StudiesModel) -> Array:
    return np.array([one.start for one in model.unknowns])


def repeated(plan: CalibrationPlan, model: StudiesModel, exact: Array, seed: int) -> tuple[Inference, float]:
    """Return the inference from data with 1 % noise, and the rise of the sum of squares at the truth."""
    pairs = enumerate(zip(plan.curves, by_curve(exact, plan.curves), strict=True))
    misfit = Misfit(model, curve_data([each.made_up(values, [seed, k]) for k, (each, values) in pairs]))
    guess = misfit.start + np.array([0.01, 0.2, -0.2, 0.3, 0.4])
    found = fit(misfit, plan.fit, Console(io.StringIO()), [guess])
    said = infer(misfit, found.best, rays=0)
    return said, 2 * (misfit.at(misfit.start).cost - said.best.cost)


def deviations(plan: CalibrationPlan) -> tuple[Array, Array]:
    """Return standard deviations (5,) of the coordinates by 1 % noise to first order, and their correlations (5, 5)."""
    model = model_of(plan)
    found = model.curves(truth(model))
    noise = np.concatenate(
        [np.full(len(part), 0.01 * part.max()) for part in by_curve(found.values, plan.curves)]
    )
    coordinates = [one.coordinate(one.start) for one in model.unknowns]
    jacobian = found.slopes / noise[:, None] * slopes_at(model.unknowns, coordinates)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    sizes = np.sqrt(np.diag(covariance))
    return sizes, covariance / np.outer(sizes, sizes)


@pytest.mark.slow
def test_intervals_cover_the_truth(tmp_path: Path) -> None:
    """Both tests; the sum of squares rises at the truth by a χ² of five degrees of freedom."""
    plan = planned(tmp_path)
    model = model_of(plan)
    exact, inside, rises = model.curves(truth(model)).values, 0, 0.0
    for seed in range(SEEDS):
        said, rise = repeated(plan, model, exact, seed)
        rises += rise
        for each, value in zip(said.data_intervals, truth(model), strict=True):
            low, high = each.values
            inside += (low is None or low <= value) and (high is None or value <= high)
    # 99.9 % quantiles of the binomial distribution and of χ² with 25 degrees of freedom.
    assert inside >= 20
    assert 8.6 < rises < 52.7


def test_two_tests_separate_relaxation_from_drainage_which_one_does_not(tmp_path: Path) -> None:
    """The numbers are those of docs/calibration.md: relative deviations of all but the radius, and a correlation."""
    both, _ = deviations(planned(tmp_path))
    alone, correlation = deviations(planned(tmp_path, ("confined",)))
    np.testing.assert_allclose(both[1:], [0.054, 0.107, 0.031, 0.058], rtol=0.02)
    np.testing.assert_allclose(alone[1:], [0.087, 0.382, 0.184, 0.196], rtol=0.02)
    viscosity, strength = 2, 3
    assert correlation[viscosity, strength] == pytest.approx(-0.975, abs=0.002)


def test_a_time_before_the_first_datum_is_lost(tmp_path: Path) -> None:
    late, correlation = deviations(planned(tmp_path, time=20.0, since=100.0))
    strength, time = 3, 4
    assert late[[strength, time]].min() > 2
    assert correlation[strength, time] < -0.99
