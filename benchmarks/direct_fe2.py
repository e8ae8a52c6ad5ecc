"""(e) Direct FE² on a short column against the surrogate of the potential, step by step."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from common import table

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.inputs import InputSpace
from porocore.interfaces.law import CellLaw
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.direct import DirectCellLaw, DirectWork
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.sampling.execution import CellPool
from porocore.states import Array, CellResponse, MacroState
from porocore.study.config.config import SamplingSettings
from porocore.study.run.composition import prepare_cell
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.response import confined_column
from porocore_fem_skfem.macro import SkfemMacroSolver

LOAD, ELEMENTS, STATES = -0.1, 10, 36
#: The column stays inside the sampled box, so there is no need to stop at the default degree, 4.
DEGREE = 8
INPUTS = InputSpace(("H22", "p"), (-0.22, -0.01), (0.02, 0.12))
#: Ten steps: five on the ramp, five of consolidation, to about nine tenths of the final settlement.
TIME = {"end": 40.0, "step": 7.0, "ramp_increments": 5, "ramp_step": 1.0, "profiles": (5.0,)}


@dataclass(frozen=True)
class Comparison:
    """Settlements at every step, and what they cost.

    Attributes
    ----------
    time, direct, surrogate, mean_gradient : (11,)
        Time, and the settlement by direct FE² and by the surrogate with the exact closure and the paper's.
    work
        Of direct FE².
    seconds
        Wall time: ``direct``, ``surrogate``, and ``training`` with its cell solves.
    """

    time: Array
    direct: Array
    surrogate: Array
    mean_gradient: Array
    work: DirectWork
    seconds: dict[str, float]

    @property
    def gaps(self) -> Array:
        """Error of the surrogate, at every loaded step, in per cent of the direct settlement there."""
        return 100 * (self.surrogate[1:] / self.direct[1:] - 1)


def compare(mesh_size: float = 0.2, workers: int | None = None) -> Comparison:
    """Solve the column with cells at every point, and with a polynomial fitted to a grid of solved cells."""
    cell = Cell(mesh=MeshSettings(size=mesh_size, fluid_size=max(0.07, mesh_size / 2)))
    workers = workers or SamplingSettings(inputs={"p": {"range": (0, 1)}}).worker_count()
    problem = confined_column(ELEMENTS, load=LOAD, time=TIME)
    solver, prepared = prepare_cell("skfem", {}, cell)
    rest = solver.solve(prepared, MacroState.zeros(1)).response
    assert rest.fluid_volume is not None
    closures = [
        closure(1 - float(rest.fluid_volume[0]), cell.material, solver.conductivity(prepared))
        for closure in (PotentialClosure, MeanGradientClosure)
    ]
    seconds: dict[str, float] = {}
    with CellPool(prepare_cell, ("skfem", {}, cell), workers=workers) as pool:
        surrogate, seconds["training"] = _timed(partial(train, pool, rest))
        cells = DirectCellLaw(pool, rest, "benchmark")
        direct, seconds["direct"] = _timed(partial(settle, problem, cells, closures[0]))
    fast, seconds["surrogate"] = _timed(partial(settle, problem, surrogate, closures[0]))
    paper = settle(problem, surrogate, closures[1])
    histories = [solution.history for solution in (direct, fast, paper)]
    assert all(np.array_equal(histories[0].time, history.time) for history in histories)
    return Comparison(histories[0].time, *(history.settlement for history in histories), cells.work, seconds)


def train(pool: CellPool, rest: CellResponse) -> PolynomialSurrogate:
    """From a grid that has the corners of the box and lies denser towards its sides."""
    axes = [
        (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * np.arange(6) / 5)
        for low, high in zip(INPUTS.lower, INPUTS.upper, strict=True)
    ]
    x = np.stack(np.meshgrid(*axes), axis=-1).reshape(STATES, 2)
    rows: dict[int, CellResponse] = {}
    queue = list(range(STATES))
    while queue or pool.pending:
        while queue and pool.has_room:
            pool.submit(str(queue[0]), INPUTS.scatter(x[queue.pop(0)]))
        outcome = pool.wait()
        rows[int(outcome.key)] = outcome.response
    responses = CellResponse.concatenate([rows[i] for i in range(STATES)])
    good = np.flatnonzero(responses.stable)
    data = TrainingSet(INPUTS.scatter(x)[good], responses[good], INPUTS, rest, "benchmark", {})
    return PolynomialSurrogate(degree=DEGREE).fit(data, seed=0)


def settle(problem: MacroProblem, cells: CellLaw, closure: Any) -> MacroSolution:
    """The column with one law."""
    solver = SkfemMacroSolver()
    return solver.solve(solver.prepare(problem), ClosedLaw(cells, closure))


def _timed(work: Any) -> tuple[Any, float]:
    began = time.perf_counter()
    return work(), time.perf_counter() - began


def main() -> str:
    found = compare()
    rows = [
        [f"{t:g}", f"{d:.5f}", f"{s:.5f}", f"{gap:+.4f} %", f"{100 * (m / d - 1):+.2f} %"]
        for t, d, s, gap, m in zip(
            found.time[1:],
            found.direct[1:],
            found.surrogate[1:],
            found.gaps,
            found.mean_gradient[1:],
            strict=True,
        )
    ]
    header = ["t", "direct FE²", "polynomial potential", "gap", "gap of the mean-gradient closure"]
    text = table(
        f"(e) Settlement of {ELEMENTS} elements under P = {LOAD}, direct FE² against a surrogate",
        header,
        rows,
    )
    work, seconds = found.work, found.seconds
    return text + (
        f"\nDirect: {work.solves} cells solved ({work.failed} without solution) for {work.points} responses, "
        f"{work.seconds:.0f} s in the cells, {seconds['direct']:.1f} s in all. "
        f"Surrogate: {STATES} cells and the fit {seconds['training']:.1f} s, then {seconds['surrogate']:.2f} s: "
        f"{seconds['direct'] / seconds['surrogate']:.0f} times faster, "
        f"{seconds['direct'] / (seconds['surrogate'] + seconds['training']):.0f} times with its training.\n"
    )


if __name__ == "__main__":
    print(main())
