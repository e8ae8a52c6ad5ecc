"""(ab) What a filmed test costs: values, all slopes, and the gradient of the sum of squares, over a run alone.

2,000 points, two components, 40 times, and 20 unknown values of the radius on a grid; a body of 81 elements under a
pull at one side, in scikit-fem, with the law of the conformance kit. All take turns. The status is 1 where the gradient
takes more than three runs, or is not that of the slopes.

    python benchmarks/films.py [ELEMENTS_X,Y,Z]
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from common import in_turn, table

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.calibration.experiment import ExperimentModel
from porocore.commands.calibration.loading import read_plan
from porocore.interfaces.solution import MacroSolution
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.composed import BoundLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.plugins.border import body_solution_of
from porocore.study.run.solving import prepared_body
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

ELEMENTS, ROUNDS = (3, 9, 3), 1
#: Most time of a gradient, in runs.
LIMIT = 3.0
DEVIATION = 5e-4


def study(elements: tuple[int, ...], place: str) -> dict[str, Any]:
    """Column that is pulled at one side, and its film."""
    side = {"displacement": [0, None, 0]}
    field = {
        "grid": {"y": np.linspace(0, 1.5, 10).tolist(), "x": [0.0, 0.5]},
        "start": (0.2 + 0.06 * np.random.default_rng(0).random(20)).tolist(),
        "smoothing": 0.02,
    }
    return {
        "cell": {"viscosity": 1.0},
        "sampling": {"sampler": "sobol", "inputs": {"H22": {"range": [-0.1, 0.02]}}},
        "surrogate": {"backend": "polynomial"},
        "closure": "potential",
        "macro": {
            "body": {"kind": "box", "elements": list(elements), "size": [0.5, 1.5, 0.5]},
            "boundary": {
                **dict.fromkeys(("x-", "z-", "z+"), side),
                "x+": {"displacement": [None, None, None], "traction": [0.01, 0, 0]},
                "y-": {"displacement": [0, 0, 0]},
                "y+": {"traction": [0, 0.05, 0], "pressure": 0.002},
            },
            "time": {"end": 2.0, "step": 0.05, "ramp_increments": 1, "ramp_step": 0.05, "profiles": []},
            "loads": [-1.0],
        },
        "calibration": {
            "unknowns": {"radius": {"lower": 0.15, "upper": 0.3, "field": field}},
            "points": {
                "film": {
                    "grid": [20, 100, 1],
                    "fixed": {"z": 0.0},
                    "times": {"first": 0.05, "last": 2.0, "count": 40, "spacing": "linear"},
                    "quantities": ["u1", "u2"],
                    "deviation": DEVIATION,
                    "place": place,
                }
            },
        },
    }


def model_of(elements: tuple[int, ...], place: str) -> tuple[ExperimentModel, np.ndarray]:
    """Model of the experiment, and the first values of the unknowns."""
    plan = read_plan(study(elements, place), synthetic=True)
    closed = ClosedLaw(
        PorousFamilyLaw("radius", "poisson_ratio"),
        make_closure("potential", 0.6, NeoHookean(), np.eye(3), law="piola"),
    )
    law = BoundLaw(closed, {"poisson_ratio": 0.33})
    starts = np.array([each.unknown.start for each in plan.unknowns])
    return ExperimentModel(plan.experiments[0], plan.unknowns, law), starts


def main() -> int:
    elements = tuple(map(int, sys.argv[1].split(","))) if len(sys.argv) > 1 else ELEMENTS
    rows, worst, exact = [], 0.0, True
    for place in ("reference", "deformed"):
        model, at = model_of(elements, place)
        problem = model.body(at).problem

        def run(model: ExperimentModel = model, problem: Any = problem) -> MacroSolution:
            prepared = prepared_body(model._solver, model.config.macro_backend, problem)
            return body_solution_of(model._solver, prepared, model.law, problem)

        works = [
            run,
            lambda model=model, at=at: model.values(at),
            lambda model=model, at=at: model.curves(at),
            lambda model=model, at=at: model.gradient(at, lambda values: values / DEVIATION**2),
        ]
        times, (solution, _, curves, (_, gradient)) = in_turn(works, ROUNDS)
        wanted = (curves.values / DEVIATION**2) @ curves.slopes
        exact &= bool(np.abs(gradient - wanted).max() <= 1e-6 * np.abs(wanted).max())
        shares = [time / times[0] for time in times]
        worst = max(worst, shares[3])
        steps, iterations = len(solution.history.time) - 1, int(np.sum(solution.history.iterations))
        rows.append(
            [
                place,
                str(steps),
                f"{iterations / steps:.1f}",
                f"{times[0]:.2f}",
                *(f"{x:.2f}" for x in shares[1:]),
            ]
        )
    header = ["places", "steps", "iterations a step", "run, s", "values", "all slopes", "gradient"]
    title = (
        f"(ab) A film of 2,000 points and 40 times on {int(np.prod(elements))} elements, 20 unknowns, in runs"
    )
    print(table(title, header, rows))
    return int(worst > LIMIT or not exact)


if __name__ == "__main__":
    sys.exit(main())
