"""(w) What sensitivities cost: a run of the benchmark's column with five unknowns over the same run without.

106 elements, a polynomial surrogate of a made-up family of cells (radius and Poisson's ratio beside H22 and p), the
potential closure, creep under 5 % of the modulus. The unknowns are radius, Poisson's ratio, modulus, viscosity and
load; runs take turns. The status is 1 where the ratio with five unknowns is beyond 2.5.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

import numpy as np
from common import in_turn, table

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.interfaces.sensitivities import (
    CellParameterChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import porosity, porous_training_set
from porocore.testing.synthetic.response import confined_column

CHANGES: tuple[MacroChange, ...] = (
    CellParameterChange("radius"),
    CellParameterChange("poisson_ratio"),
    ModulusChange(),
    ViscosityChange(),
    LoadChange(),
)
#: Times of the creep test, as shares of the consolidation time 7.5²/c_v of some 5,600.
TIME = {"end": 6000.0, "step": 150.0, "ramp_increments": 10, "ramp_step": 5.0, "profiles": ()}
LIMIT = 2.5


def law() -> ClosedLaw:
    """Return the potential closure of a polynomial surrogate of the family."""
    surrogate = registry().get("surrogate", "polynomial")()
    data = porous_training_set(60, seed=1)
    surrogate.fit(data, seed=0)
    surrogate.conductivity = None  # K carried along
    constants = make_closure("potential", float(1 - porosity(0.22)), NeoHookean(), np.eye(3))
    return ClosedLaw(surrogate, constants)


def problem(elements: int = 106) -> MacroProblem:
    """Return the column, loaded on top by 5 % of the modulus."""
    fields = {"radius": 0.24, "poisson_ratio": 0.35}
    return confined_column(elements, load=-0.05, fields=fields, time=TIME)


def runs(backend: str) -> list[str]:
    """Return a row of the table: seconds without, and ratios with one and with five unknowns."""
    solver, given = registry().get("macro solver", backend)(), law()
    prepared = solver.prepare(problem())

    def with_unknowns(count: int) -> Any:
        return solver.solve_with_sensitivities(prepared, given, CHANGES[-count:])

    works = [partial(solver.solve, prepared, given), *(partial(with_unknowns, k) for k in (1, 5))]
    times, results = in_turn(works, rounds=3)
    steps, iterations = len(results[0].history.time) - 1, results[0].history.iterations.sum()
    ratios = [seconds / times[0] for seconds in times[1:]]
    return [
        backend,
        str(steps),
        f"{iterations / steps:.1f}",
        f"{times[0]:.2f}",
        *(f"{r:.2f}" for r in ratios),
    ]


def main() -> int:
    rows = [runs(backend) for backend in sys.argv[1:] or ["skfem"]]
    header = ["backend", "steps", "iterations a step", "run, s", "one unknown", "five unknowns"]
    print(table("Cost of sensitivities over a run without", header, rows))
    return int(any(float(row[-1]) > LIMIT for row in rows))


if __name__ == "__main__":
    sys.exit(main())
