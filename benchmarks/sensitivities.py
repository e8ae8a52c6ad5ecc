"""(w) What sensitivities cost: a run of the benchmark's column with five unknowns over the same run without.

106 elements, a polynomial surrogate of a made-up family of cells (radius and Poisson's ratio beside H22 and p), the
potential closure, creep under 5 % of the modulus. The unknowns are radius, Poisson's ratio, modulus, viscosity and
load. The same with the mean-gradient closure of one made-up cell, whose unknowns are modulus, viscosity, load, pressure
on top and initial pressure. Runs take turns. The status is 1 where the ratio with five unknowns is beyond 2.5.

Then the same column with 5, 20 and 50 unknowns, control values of the radius over the depth: sensitivities, and the
gradients of one sum and of as many sums as 40 values of measured curves by a pass backwards.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

import numpy as np
from common import in_turn, table

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    HatFunction,
    HistoryWeights,
    InitialPressureChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.interfaces.solution import MacroSolution
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.cell import SOLID_FRACTION, synthetic_training_set
from porocore.testing.synthetic.porous_family import porosity, porous_training_set
from porocore.testing.synthetic.response import CONDUCTIVITY, confined_column

#: Unknowns by closure; one unknown is the load.
COMMON: tuple[MacroChange, ...] = (ModulusChange(), ViscosityChange(), LoadChange())
CHANGES: dict[str, tuple[MacroChange, ...]] = {
    "potential": (CellParameterChange("radius"), CellParameterChange("poisson_ratio"), *COMMON),
    "mean-gradient": (BoundaryChange("y+", "pressure"), InitialPressureChange(), *COMMON),
}
#: Times of the creep test, as shares of the consolidation time 7.5²/c_v of some 5,600.
TIME = {"end": 6000.0, "step": 150.0, "ramp_increments": 10, "ramp_step": 5.0, "profiles": ()}
LIMIT = 2.5
#: Numbers of unknowns of the second table, and of sums that stand for data.
MANY, DATA = (5, 20, 50), 40


def law(closure: str) -> ClosedLaw:
    """Return the closure of a polynomial surrogate, of the family or of one cell."""
    surrogate = registry().get("surrogate", "polynomial")()
    if closure == "mean-gradient":
        surrogate.fit(synthetic_training_set(), seed=0)
        return ClosedLaw(surrogate, make_closure(closure, SOLID_FRACTION, NeoHookean(), CONDUCTIVITY))
    surrogate.fit(porous_training_set(60, seed=1), seed=0)
    surrogate.conductivity = None  # K carried along
    constants = make_closure(closure, float(1 - porosity(0.22)), NeoHookean(), np.eye(3))
    return ClosedLaw(surrogate, constants)


def problem(closure: str, elements: int = 106) -> MacroProblem:
    """Return the column, loaded on top by 5 % of the modulus, until it is at rest again."""
    if closure == "mean-gradient":
        return confined_column(
            elements, load=-0.05, time=TIME | {"end": 40.0, "step": 1.0, "ramp_step": 0.05}
        )
    fields = {"radius": 0.24, "poisson_ratio": 0.35}
    return confined_column(elements, load=-0.05, fields=fields, time=TIME)


def runs(backend: str, closure: str) -> list[str]:
    """Return a row of the table: seconds without, and ratios with one and with five unknowns."""
    solver, given = registry().get("macro solver", backend)(), law(closure)
    prepared = solver.prepare(problem(closure))

    def with_unknowns(count: int) -> Any:
        return solver.solve_with_sensitivities(prepared, given, CHANGES[closure][-count:])

    works = [partial(solver.solve, prepared, given), *(partial(with_unknowns, k) for k in (1, 5))]
    times, results = in_turn(works, rounds=3)
    steps, iterations = len(results[0].history.time) - 1, results[0].history.iterations.sum()
    ratios = [f"{seconds / times[0]:.2f}" for seconds in times[1:]]
    return [backend, closure, str(steps), f"{iterations / steps:.1f}", f"{times[0]:.2f}", *ratios]


def weights(count: int, solution: MacroSolution) -> HistoryWeights:
    """Return the weights of so many values of the settlement, spread over the run; of one sum all values together."""
    steps = len(solution.history.time)
    at = np.eye(steps)[:, np.linspace(1, steps - 1, count).astype(int)]
    return HistoryWeights(count, settlement=at if count > 1 else np.ones((steps, 1)))


def many_unknowns(backend: str) -> list[str]:
    """Return a row of the second table: ratios to a run without, of sensitivities and of gradients."""
    solver, given = registry().get("macro solver", backend)(), law("potential")
    prepared = solver.prepare(problem("potential"))

    def changes(count: int) -> list[MacroChange]:
        places = tuple(np.linspace(0.0, 7.5, count).tolist())
        hats = (HatFunction.along(1, places, i) for i in range(count))
        return [CellParameterChange("radius", weight=hat) for hat in hats]

    def forward(count: int) -> Any:
        return solver.solve_with_sensitivities(prepared, given, changes(count))

    def backward(count: int, sums: int) -> Any:
        return solver.solve_with_gradients(prepared, given, changes(count), partial(weights, sums))

    works = [partial(solver.solve, prepared, given), *(partial(forward, k) for k in MANY)]
    works += [partial(backward, k, 1) for k in MANY]
    works += [partial(backward, MANY[-1], DATA)]
    times, _ = in_turn(works, rounds=2)
    return [backend, f"{times[0]:.2f}", *(f"{seconds / times[0]:.2f}" for seconds in times[1:])]


def main() -> int:
    rows = [runs(backend, closure) for backend in sys.argv[1:] or ["skfem"] for closure in CHANGES]
    header = ["backend", "closure", "steps", "iterations a step", "run, s", "one unknown", "five unknowns"]
    print(table("Cost of sensitivities over a run without", header, rows))
    columns = [f"{k} unknowns" for k in MANY] + [f"one sum, {k}" for k in MANY] + [f"{DATA} sums, {MANY[-1]}"]
    many = [many_unknowns(backend) for backend in sys.argv[1:] or ["skfem"]]
    print(table("Many unknowns: sensitivities, then gradients", ["backend", "run, s", *columns], many))
    return int(any(float(row[-1]) > LIMIT for row in rows))


if __name__ == "__main__":
    sys.exit(main())
