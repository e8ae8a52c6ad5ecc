"""(x) What parameters cost a whole body: 360 elements with one region, with ten regions of one family, and graded.

A cube pressed on a part of its drained top, in scikit-fem; mesh, steps and Newton iterations are the same for all, and
so is the surrogate but for that of the one cell without parameters. All take turns. The status is 1 where
ten regions take more than 1.3 times one, or iterations differ.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from common import in_turn, table
from parameters_cost import MIDDLE, RANGES, alone, law_of, of_family

from porocore.core.inputs import InputSpace
from porocore.interfaces.solution import MacroSolution
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.linear_systems import work_figures
from porocore.macro.problem import MacroProblem
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.porous_family import PARAMETERS
from porocore_fem_skfem.macro import SkfemMacroSolver

ELEMENTS, REGIONS, ROUNDS = (6, 10, 6), 10, 3
#: Most time of ten regions, in times one.
LIMIT = 1.3
#: Radius and Poisson's ratio at the bottom, and what is added up to the top.
LOWEST, RISE = (0.21, 0.28), (0.02, 0.04)


def problem(fields: dict[str, Any], regions: dict[str, Any]) -> MacroProblem:
    """Return the cube with parameters: twelve steps of two or three iterations."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "size": (1, 1, 1), "elements": ELEMENTS},
            "fields": fields,
            "regions": regions,
            "surfaces": {"strip": {"of": "y+", "x": (0, 0.5)}},
            "boundary": {
                "y-": {"displacement": (0, 0, 0)},
                "x-": {"normal": 0},
                "z-": {"normal": 0},
                "y+": {"pressure": 0},
                "strip": {"traction": (0, 1, 0), "pressure": 0},
            },
            "load": -0.01,
            "time": {"end": 3.0, "step": 0.25, "ramp_increments": 4, "ramp_step": 0.25, "profiles": ()},
        }
    )


def at(height: float) -> dict[str, float]:
    """Parameters at a height of the graded body."""
    return {name: low + rise * height for name, low, rise in zip(PARAMETERS, LOWEST, RISE, strict=True)}


def problems() -> dict[str, MacroProblem]:
    """Problems that are compared, by name."""
    layers = {
        f"layer-{k}": {
            "kind": "layer",
            "above": k / REGIONS,
            "below": (k + 1) / REGIONS,
            "fields": at((k + 0.5) / REGIONS),
        }
        for k in range(REGIONS)
    }
    graded = {name: f"{low} + {rise} * y" for name, low, rise in zip(PARAMETERS, LOWEST, RISE, strict=True)}
    return {
        "no parameters": problem({}, {}),
        "one region": problem(dict(zip(PARAMETERS, MIDDLE.tolist(), strict=True)), {}),
        "ten regions": problem({}, layers),
        "graded": problem(graded, {}),
    }


def laws(folder: Path) -> tuple[ClosedLaw, ClosedLaw]:
    """Laws of the one cell and of its family, for general states."""
    ranges = RANGES["seven inputs"]
    plain, inputs = InputSpace.from_ranges(ranges), InputSpace.from_ranges(ranges, PARAMETERS)
    cell, family = (PolynomialSurrogate().fit(data, seed=0) for data in (alone(plain), of_family(inputs)))
    return law_of(cell, folder), law_of(family, folder)


def solve(solver: SkfemMacroSolver, prepared: Any, law: ClosedLaw) -> Callable[[], MacroSolution]:
    return lambda: solver.solve(prepared, law)


def main() -> int:
    with TemporaryDirectory() as folder:
        cell, family = laws(Path(folder))
    solver = SkfemMacroSolver(checkpoint_seconds=1e9)
    works = {
        name: solve(solver, solver.prepare(each), cell if name == "no parameters" else family)
        for name, each in problems().items()
    }
    times, found = in_turn(list(works.values()), ROUNDS)
    rows, one = [], times[list(works).index("one region")]
    for name, time, solution in zip(works, times, found, strict=True):
        steps, figures = len(solution.history.time) - 1, work_figures(solution)
        rows.append([name, str(steps), str(figures["systems"]), f"{time:.2f}", f"{time / one:.2f}"])
    header = ["", "steps", "systems", "processor seconds", "of one region"]
    print(table(f"(x) A body of {int(np.prod(ELEMENTS))} elements", header, rows))
    ten = times[list(works).index("ten regions")]
    return int(ten > LIMIT * one or len({tuple(row[1:3]) for row in rows[1:]}) > 1)


if __name__ == "__main__":
    sys.exit(main())
