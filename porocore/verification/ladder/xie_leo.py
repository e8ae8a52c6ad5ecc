"""Case of large-strain consolidation of a clay layer (Xie & Leo 2004), as a column."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution
from porocore.macro.analytic.xie_leo import XieLeo
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import confined_column
from porocore.verification.ladder.case import Check, VerificationCase, observed_order, relative_check
from porocore.verification.ladder.clay_law import ClayLaw

#: Time [s] → degree of consolidation by settlement, by pressure, and settlement [m] of the paper's layer.
PUBLISHED = {6.3496e8: (0.449463, 0.414164, 1.481789), 1.4775e9: (0.674157, 0.634112, 2.222560)}
ALLOWED = 0.01


def column(layer: XieLeo, elements: int, steps: int, times: Sequence[float]) -> MacroProblem:
    """The layer as a column of one element's width that is loaded at once; fields are kept at the times."""
    end = times[-1]
    plan = {
        "end": end,
        "step": end / steps,
        "ramp_increments": 1,
        "ramp_step": 1e-6 * end / steps,
        "smallest_step": 1e-9 * end / steps,
        "profiles": tuple(times[:-1]),
    }
    return confined_column(elements, load=-layer.load, size=(1, layer.height, 1), time=plan)


def mean_pressure(solution: MacroSolution, profile: int) -> float:
    """Mean of p over a, by the trapezoidal rule: between the corners of the elements p is linear."""
    y, first = np.unique(np.round(solution.points[:, 1], 9), return_index=True)
    p = solution.after_rest[profile].p[first]
    return float(((p[1:] + p[:-1]) / 2 @ np.diff(y)) / y[-1])


def closed_form(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """The published numbers against the closed form, to the digits that are published; no solver is asked."""
    layer, checks = XieLeo(), []
    for t, (by_settlement, by_pressure, settlement) in PUBLISHED.items():
        ours = float(layer.settlement(t))
        degree = ours / layer.final_settlement
        # The times are published with five digits, so the numbers are good for some 1e-5.
        checks += [
            relative_check(f"U_s, {t:.5g} s", by_settlement, degree, 1e-4),
            relative_check(f"U_p, {t:.5g} s", by_pressure, layer.degree_by_pressure(t), 1e-4),
            relative_check(f"settlement [m], {t:.5g} s", settlement, ours, 1e-4),
        ]
    return checks


def layer_of_clay(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """The column against the published numbers, and against the closed form over its history."""
    layer, law, times = XieLeo(), ClayLaw(XieLeo()), tuple(PUBLISHED)
    runs = (100, 200, 400) if long else (50, 100)
    elements = 40 if long else 20
    solutions = [solver.solve(solver.prepare(column(layer, elements, n, times)), law) for n in runs]
    errors = [_history_error(layer, solution) for solution in solutions]
    order = observed_order([1 / n for n in runs], errors, exact=0.0)
    last, checks = solutions[-1], []
    for i, (t, (by_settlement, by_pressure, settlement)) in enumerate(PUBLISHED.items()):
        found = -float(last.after_rest[i].u[:, 1].min())
        degree = 1 - mean_pressure(last, i) / layer.load
        checks += [
            relative_check(f"U_s, {t:.5g} s", by_settlement, found / layer.final_settlement, ALLOWED),
            relative_check(f"U_p, {t:.5g} s", by_pressure, degree, ALLOWED),
            relative_check(f"settlement [m], {t:.5g} s", settlement, found, ALLOWED),
        ]
        depth = layer.height - last.points[:, 1]
        error = float(np.abs(last.after_rest[i].p - layer.pressure(depth, t)).max() / layer.load)
        checks.append(Check(f"pressure anywhere, of the load, {t:.5g} s", error, ALLOWED))
    quantity = "settlement from a tenth of the time on, of the last"
    return [*checks, Check(quantity, errors[-1], ALLOWED, order=order)]


def _history_error(layer: XieLeo, solution: MacroSolution) -> float:
    """Return the error after a tenth of the time; no time step resolves the initial root of time."""
    history = solution.history
    later = history.time >= 0.1 * history.time[-1]
    exact = layer.settlement(history.time[later])
    return float(np.abs(history.settlement[later] - exact).max() / layer.final_settlement)


CASE = VerificationCase(
    "xie-leo",
    "Large-strain consolidation of clay",
    "Xie & Leo 2004, Comput. Geotech. 31, 301–314",
    "macro solver",
    {"closed form": closed_form, "layer": layer_of_clay},
)
