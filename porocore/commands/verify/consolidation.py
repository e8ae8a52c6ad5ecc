"""Cases of linear consolidation: Terzaghi, Mandel; errors beside those of a finite-volume code.

PorePy (Keilegavlen et al. 2021, Comput. Geosci. 25) tests its Biot models against Terzaghi's and Mandel's solutions
and keeps the errors that it finds, in the discrete L² norm of the values in the middle of the cells. Here the same
bodies are solved with cells of the same size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from porocore.commands.verify.case import Check, VerificationCase, observed_order
from porocore.commands.verify.small_strain import isotropic_coefficients, relative_l2
from porocore.interfaces.macro import MacroSolver
from porocore.macro.analytic import Mandel, Terzaghi
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import confined_column

#: A load cannot act at once: it is there after this share of the first step.
SUDDEN = 1e-6
#: Time [s] → PorePy's errors of the pressure and of the degree of consolidation, 10 cells, steps of 0.05 s.
TERZAGHI = {0.05: (0.06884858, 0.02700531), 0.1: (0.04553479, 0.01883910), 0.3: (0.02239158, 0.01092739)}
#: Time [s] → PorePy's errors of the pressure and of the displacement, cells of 2 m, steps of 25 s.
MANDEL = {25.0: (0.0247, 7.4e-4), 50.0: (0.0160, 7.1e-4)}
PUBLISHED = "PorePy's error at the same resolution"


def terzaghi(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """A column of 1 m under 0.6 GPa; units of m, s and GPa."""
    coefficients = isotropic_coefficients(
        lame=1.65, shear=1.475, biot=1.0, storage=0.0, conductivity=9.86e-14 / 1e-12
    )
    layer = Terzaghi.from_coefficients(coefficients, height=1.0, load=0.6)
    law = LinearPoroelasticity(coefficients)
    # The error is that of the steps and of the elements: both are refined, steps with the square.
    cells = (10, 20, 40) if long else (10, 20)
    errors = [_terzaghi_errors(solver, law, layer, n, 0.05 * (10 / n) ** 2) for n in cells]
    sizes = [1 / n for n in cells]
    checks = []
    for i, (time, published) in enumerate(TERZAGHI.items()):
        for j, quantity in enumerate(("pressure, relative L²", "degree of consolidation, absolute")):
            order = observed_order(sizes, [e[i][j] for e in errors], exact=0.0)
            found = errors[0][i][j]
            checks.append(Check(f"{quantity}, {time:g} s", found, published[j], order=order, note=PUBLISHED))
    return checks


def _terzaghi_errors(
    solver: MacroSolver, law: LinearPoroelasticity, layer: Terzaghi, cells: int, step: float
) -> list[tuple[float, float]]:
    plan = _plan(step, tuple(TERZAGHI))
    problem = confined_column(cells, load=-layer.load, size=(1, 1, 1), time=plan)
    solution = solver.solve(solver.prepare(problem), law)
    middle = (np.arange(cells) + 0.5) / cells
    found = []
    for time, profile in zip(TERZAGHI, solution.after_rest, strict=True):
        pressure = relative_l2(profile.element_p, layer.pressure(middle, time))
        degree = -float(profile.u[:, 1].min()) / layer.final_settlement
        found.append((pressure, abs(degree - float(layer.degree(time)))))
    return found


def pushed_plates(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Mandel's problem as it is: rigid plates under a given force, whose motion is part of the answer."""
    steps = (10.0, 5.0, 2.5) if long else (10.0,)
    errors = [_mandel_errors(solver, step, {"plate": -1.0}, _force(), ()) for step in steps]
    return _mandel_checks(steps, errors)


def moved_plates(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Solve Mandel's problem as PorePy does: the closed form prescribes the motion of the plates."""
    block = _block()
    steps = (25.0, 12.5, 6.25) if long else (25.0,)
    errors = []
    for step in steps:
        times = (SUDDEN * step, *np.arange(step, 50 + step / 2, step))
        way = [10 * block.strain(float(time)) for time in times]
        curve = tuple((float(time), y / way[-1]) for time, y in zip(times, way, strict=True))
        errors.append(_mandel_errors(solver, step, {"displacement": (None, 1, None)}, way[-1], curve))
    return _mandel_checks(steps, errors)


def _block() -> Mandel:
    """The quarter of a block of 200 × 20 m under 2 × 0.6 GN per m; units of m, s and GPa."""
    storage, conductivity = 6.0606e-11 / 1e-9, 9.869e-14 / 1e-12
    return Mandel(100.0, 0.6, 1.65, 2.475, 1.0, storage, conductivity)


def _force() -> float:
    """Return the force on the plate of a slice of 2 m."""
    return 2 * _block().force


def _mandel_checks(steps: Sequence[float], errors: list[list[tuple[float, float]]]) -> list[Check]:
    checks = []
    for i, (time, published) in enumerate(MANDEL.items()):
        for j, name in enumerate(("pressure", "displacement")):
            quantity = f"{name}, relative L², {time:g} s, steps of {steps[0]:g} s"
            # The error is that of the time steps.
            order = observed_order(steps, [e[i][j] for e in errors], exact=0.0) if len(steps) > 1 else None
            checks.append(Check(quantity, errors[0][i][j], published[j], order=order, note=PUBLISHED))
    return checks


def _mandel_errors(
    solver: MacroSolver, step: float, top: dict[str, Any], load: float, curve: tuple[tuple[float, float], ...]
) -> list[tuple[float, float]]:
    block = _block()
    x, y, z = ({"displacement": tuple(0.0 if i == j else None for j in range(3))} for i in range(3))
    coefficients = isotropic_coefficients(
        block.lame, block.shear, block.biot, block.storage, block.conductivity
    )
    problem = MacroProblem.model_validate(
        {
            "body": {"size": (block.half_width, 10, 2), "elements": (50, 5, 1)},
            "boundary": {"x-": x, "y-": y, "z-": z, "z+": z, "x+": {"pressure": 0}, "y+": top},
            "load": load,
            "time": _plan(step, tuple(MANDEL)) | {"load_curve": curve},
        }
    )
    solution = solver.solve(solver.prepare(problem), LinearPoroelasticity(coefficients))
    in_middle = solution.cells[:, 26]
    place = solution.points[in_middle]
    found = []
    for time, profile in zip(MANDEL, solution.after_rest, strict=True):
        u = np.column_stack([block.lateral(place[:, 0], time), block.strain(time) * place[:, 1]])
        pressure = relative_l2(profile.element_p, block.pressure(place[:, 0], time))
        found.append((pressure, relative_l2(profile.u[in_middle][:, :2], u)))
    return found


def _plan(step: float, times: tuple[float, ...]) -> dict[str, Any]:
    """Equal steps behind a first one that is next to none."""
    return {
        "end": times[-1],
        "step": step,
        "ramp_increments": 1,
        "ramp_step": SUDDEN * step,
        "smallest_step": SUDDEN * step / 100,
        "profiles": times[:-1],
    }


TERZAGHI_CASE = VerificationCase(
    "terzaghi",
    "One-dimensional consolidation",
    "Terzaghi 1923; errors to be undercut: PorePy 1.8, tests of terzaghi_biot",
    "macro solver",
    {"10 cells": terzaghi},
)
MANDEL_CASE = VerificationCase(
    "mandel",
    "Block between rigid plates",
    "Mandel 1953; Cheng & Detournay 1988; errors to be undercut: PorePy 1.8, tests of mandel_biot",
    "macro solver",
    {"moved plates": moved_plates, "pushed plates": pushed_plates},
)
