"""Calibration with exact derivatives beside one with differences, and a twin experiment of four unknowns.

    python benchmarks/calibration.py --out DIR [--seeds N]

Fit of radius, modulus and viscosity to the settlement of a column, made up with 1 % noise: the same bounded search
with exact slopes, one run with sensitivities for each evaluation, and with forward differences, as general programs for
inverse problems make them: one run more for each unknown. Both use our own runs. Then --seeds twins of confined and
unconfined compression under two loads (calibration.yaml), 1 % noise, radius, ν, modulus and viscosity unknown. DIR
keeps everything, and an interrupted script goes on.
"""

from __future__ import annotations

import argparse
import io
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from common import table

import porocore
from porocore.commands.calibration.cells import families
from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.interpolation import HistoryInterpolation
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.problem import Misfit
from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.plugins.border import body_solution_of
from porocore.study.run.composition import make_backend

CONFIG = Path(__file__).with_name("calibration.yaml")
#: Relative steps of the differences.
STEPS = (1e-3, 1e-6)
TRUTH = {"radius": 0.24, "poisson_ratio": 0.35, "modulus": 1.0, "viscosity": 1.0}
BOUNDS = {
    "radius": {"lower": 0.19, "upper": 0.29},
    "poisson_ratio": {"lower": 0.26, "upper": 0.44},
    "modulus": {"lower": 0.4, "upper": 2.5},
    "viscosity": {"lower": 0.2, "upper": 5},
}
LOADS = {"large": -0.05, "small": -0.005}


def studies(folder: Path) -> dict[str, Path]:
    """The confined test of calibration.yaml and an unconfined one with the same cells."""
    folder.mkdir(parents=True, exist_ok=True)
    confined = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    unconfined = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    unconfined["macro"]["body"] = {"kind": "box", "size": [1.0, 0.5, 0.1], "elements": [5, 1, 1]}
    planes = {name: {"normal": 0} for name in ("x-", "y-", "z-", "z+")}
    unconfined["macro"]["boundary"] = {**planes, "x+": {"pressure": 0}, "y+": {"plate": 0.1}}
    found = {}
    for name, study in {"confined": confined, "unconfined": unconfined}.items():
        found[name] = folder / f"{name}.yaml"
        found[name].write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return found


def settings(folder: Path, seed: int, unknowns: tuple[str, ...], tests: dict[str, float], count: int) -> Any:
    """Unknowns and experiments; the names of tests begin with that of their study."""
    times = {"first": 2, "last": 3000, "count": count}
    observed = {"settlement": {"quantity": "settlement", "deviation_share": 0.01, "times": times}}
    found = studies(folder)
    return {
        "title": "Twin",
        "unknowns": {name: BOUNDS[name] for name in unknowns},
        "experiments": {
            name: {"study": str(found[name.split()[0]].resolve()), "load": load, "observations": observed}
            for name, load in tests.items()
        },
        "fit": {"starts": 1, "seed": seed},
    }


def searches(folder: Path) -> str:
    """The table of both searches."""
    unknowns = ("radius", "modulus", "viscosity")
    plan = read_plan(settings(folder, 0, unknowns, {"confined": -0.05}, 12), synthetic=True)
    rows = []
    with ExitStack() as stack:
        store = ResultStore(folder / "store")
        (cells,) = families(plan, folder / "search", stack, Console(io.StringIO()), store)
        cells.learn()
        law = cells.laws()(plan.experiments[0].config)
        known = [each.unknown for each in plan.unknowns]
        model = StudiesModel(known, [ExperimentModel(plan.experiments[0], plan.unknowns, law)])
        truth = np.array([TRUTH[name] for name in unknowns])
        (curve,) = plan.curves
        misfit = Misfit(model, curve_data([curve.made_up(model.curves(truth).values, [0, 0])]))
        start = np.array([one.coordinate(0.9 * value) for one, value in zip(known, truth, strict=True)])
        best = None
        for name, step in (("exact", None), *((f"differences, step {s:g}", s) for s in STEPS)):
            end, evaluations, runs, seconds = search(misfit, start, step)
            best = end if best is None else best
            off = np.abs(end - best) / np.abs(best)
            digits = "–" if end is best else f"{-np.log10(max(off.max(), 1e-16)):.1f}"
            squares = 2 * misfit.at(end).cost
            rows.append([name, str(evaluations), str(runs), f"{seconds:.1f}", f"{squares:.6f}", digits])
    header = [
        "slopes",
        "evaluations",
        "runs of the body",
        "processor time [s]",
        "sum of squares",
        "digits as exact",
    ]
    return table("A calibration with exact slopes, and with differences", header, rows)


def search(misfit: Misfit, start: np.ndarray, step: float | None) -> tuple[np.ndarray, int, int, float]:
    """Best coordinates, evaluations of the search, runs of the body and processor time of one search."""
    from scipy.optimize import least_squares

    began, runs = time.process_time(), 0
    model = misfit.model
    experiment = model.experiments[0]  # type: ignore[attr-defined]

    def plain(x: np.ndarray) -> np.ndarray:
        """Residuals of a run without sensitivities."""
        nonlocal runs
        runs += 1
        values = values_alone(experiment, misfit.values(x))
        return np.asarray((values - misfit.data.values) / misfit.data.deviations)

    def exact(x: np.ndarray) -> np.ndarray:
        nonlocal runs
        runs += 1
        return misfit.at(x).residuals

    how: dict[str, Any] = {
        "bounds": misfit.bounds,
        "x_scale": "jac",
        "xtol": 1e-10,
        "ftol": 1e-10,
        "gtol": 1e-10,
    }
    if step is None:
        found = least_squares(exact, start, jac=lambda x: misfit.at(x).jacobian, **how)
    else:
        found = least_squares(plain, start, jac="2-point", diff_step=step, **how)
    return np.asarray(found.x), int(found.nfev), runs, time.process_time() - began


def values_alone(model: ExperimentModel, values: np.ndarray) -> np.ndarray:
    """Curves of an experiment by a run without sensitivities."""
    body = model.body(values)
    solver = make_backend("macro solver", model.config)
    solved = body_solution_of(solver, solver.prepare(body.problem), model.law, body.problem)
    whole = whole_specimen(solved, body.problem)
    steps = whole.history.time * body.scales.factor("time")
    (curve,) = model.experiment.curves
    series = HistoryInterpolation.at(steps, curve.times).values(curve.series.values(whole))
    return np.asarray(series * curve.factor * body.scales.factor(curve.series.quantity))


def twins(folder: Path, seeds: int) -> str:
    """The table of twin experiments."""
    tests = {f"{name} {size}": load for name in ("confined", "unconfined") for size, load in LOADS.items()}
    inside = dict.fromkeys(TRUTH, 0)
    known = dict.fromkeys(TRUTH, 0)
    solves, seconds = 0, []
    for seed in range(seeds):
        given = settings(folder, seed, tuple(TRUTH), tests, 40)
        done = porocore.calibrate(
            given,
            folder / f"twin-{seed}",
            synthetic=True,
            resume=True,
            progress=False,
            store=folder / "store",
        )
        solves, seconds = done.cell_solves, [*seconds, done.seconds]
        for name, value in TRUTH.items():
            low, high = done.intervals[name]
            inside[name] += (low is None or low <= value) and (high is None or value <= high)
            known[name] += done.identifiable[name]
    rows = [[name, f"{inside[name]} of {seeds}", f"{known[name]} of {seeds}"] for name in TRUTH]
    title = f"Twins: {solves} cell solves, {min(seconds):.0f} to {max(seconds):.0f} s"
    return table(title, ["unknown", "truth in the 95 % interval", "identifiable"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of all results")
    parser.add_argument("--seeds", type=int, default=3, help="twin experiments; 0: none")
    given = parser.parse_args()
    print(searches(given.out), flush=True)
    if given.seeds:
        print(twins(given.out, given.seeds))


if __name__ == "__main__":
    main()
