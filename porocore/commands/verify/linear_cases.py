"""Cases of linear poroelasticity: Terzaghi, Mandel, a cylinder under compression, the limit of small loads.

PorePy (Keilegavlen et al. 2021, Comput. Geosci. 25) tests its Biot models against Terzaghi's and Mandel's solutions
and keeps the errors that it finds, in the discrete L² norm of the values in the middle of the cells. Here the same
bodies are solved with cells of the same size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.verify.case import Check, VerificationCase, observed_order
from porocore.interfaces.law import CellLaw, MacroLaw, fingerprint
from porocore.interfaces.macro import MacroSolver
from porocore.macro.analytic import Mandel, Terzaghi, UnconfinedCompression
from porocore.macro.body.mesh import Facets
from porocore.macro.laws.closure import PotentialClosure
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.states import Array, CellResponse, MacroState
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.response import CONDUCTIVITY, confined_column, linear_law, mean_gradient_law

#: A load cannot act at once: it is there after this share of the first step.
SUDDEN = 1e-6
#: Time [s] → PorePy's errors of the pressure and of the degree of consolidation, 10 cells, steps of 0.05 s.
TERZAGHI = {0.05: (0.06884858, 0.02700531), 0.1: (0.04553479, 0.01883910), 0.3: (0.02239158, 0.01092739)}
#: Time [s] → PorePy's errors of the pressure and of the displacement, cells of 2 m, steps of 25 s.
MANDEL = {25.0: (0.0247, 7.4e-4), 50.0: (0.0160, 7.1e-4)}
PUBLISHED = "PorePy's error at the same resolution"
#: The quarter of a block of 200 × 20 m under 2 × 0.6 GN per m; units of m, s and GPa.
BLOCK = Mandel(100.0, 0.6, 1.65, 2.475, 1.0, 6.0606e-11 / 1e-9, 9.869e-14 / 1e-12)
#: Errors at the published times, of two quantities each.
Errors = list[tuple[float, float]]


def isotropic_law(
    lame: float, shear: float, biot: float, storage: float, conductivity: float
) -> LinearPoroelasticity:
    """Return the law of λ and μ of the drained frame, α, 1/M_B and k/μ_f, in units that fit together."""
    one = np.eye(3)
    stiffness = lame * np.einsum("ij,kl->ijkl", one, one)
    stiffness += shear * (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one))
    M, Q = np.zeros((3, 3, 3, 3)), np.zeros((3, 3))
    return LinearPoroelasticity(
        LinearCoefficients(stiffness, biot * one, biot * one, storage, conductivity * one, M, Q)
    )


def relative_l2(found: Array, exact: Array) -> float:
    """Return the discrete norm of the difference over that of the exact field, of cells of equal volume."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def largest_error(found: Array, exact: Array) -> float:
    """Return the largest error of a history, as a share of its largest value."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _loaded_at_once(step: float, times: Sequence[float]) -> dict[str, Any]:
    """Return equal steps behind a first one that is next to none."""
    return {
        "end": times[-1],
        "step": step,
        "ramp_increments": 1,
        "ramp_step": SUDDEN * step,
        "smallest_step": SUDDEN * step / 100,
        "profiles": times[:-1],
    }


def _published_checks(
    published: dict[float, tuple[float, float]],
    errors: Sequence[Errors],
    sizes: Sequence[float],
    names: Sequence[str],
    more: str = "",
) -> list[Check]:
    """Return the errors of the coarsest resolution against PorePy's, with the order in all ``sizes``."""
    checks = []
    for i, (time, allowed) in enumerate(published.items()):
        for j, name in enumerate(names):
            found = [each[i][j] for each in errors]
            order = observed_order(sizes, found, exact=0.0) if len(sizes) > 1 else None
            checks.append(
                Check(f"{name}, {time:g} s{more}", found[0], allowed[j], order=order, note=PUBLISHED)
            )
    return checks


def terzaghi(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Check a column of 1 m under 0.6 GPa; units of m, s and GPa."""
    law = isotropic_law(lame=1.65, shear=1.475, biot=1.0, storage=0.0, conductivity=9.86e-14 / 1e-12)
    layer = Terzaghi.from_coefficients(law.coefficients, height=1.0, load=0.6)
    # The error is that of the steps and of the elements: both are refined, steps with the square.
    cells = (10, 20, 40) if long else (10, 20)
    errors = [_terzaghi_errors(solver, law, layer, n, 0.05 * (10 / n) ** 2) for n in cells]
    names = ("pressure, relative L²", "degree of consolidation, absolute")
    return _published_checks(TERZAGHI, errors, [1 / n for n in cells], names)


def _terzaghi_errors(
    solver: MacroSolver, law: LinearPoroelasticity, layer: Terzaghi, cells: int, step: float
) -> Errors:
    plan = _loaded_at_once(step, tuple(TERZAGHI))
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
    """Check Mandel's problem as it is: rigid plates under a given force, whose motion is part of the answer."""
    steps = (10.0, 5.0, 2.5) if long else (10.0,)
    # The force on the plate of a slice of 2 m.
    return _mandel(
        steps, [_mandel_errors(solver, step, {"plate": -1.0}, 2 * BLOCK.force, ()) for step in steps]
    )


def moved_plates(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Check Mandel's problem as PorePy solves it: the closed form prescribes the motion of the plates."""
    steps = (25.0, 12.5, 6.25) if long else (25.0,)
    errors = []
    for step in steps:
        times = (SUDDEN * step, *np.arange(step, 50 + step / 2, step))
        way = [10 * BLOCK.strain(float(time)) for time in times]
        curve = tuple((float(time), y / way[-1]) for time, y in zip(times, way, strict=True))
        errors.append(_mandel_errors(solver, step, {"displacement": (None, 1, None)}, way[-1], curve))
    return _mandel(steps, errors)


def _mandel(steps: Sequence[float], errors: Sequence[Errors]) -> list[Check]:
    names = ("pressure, relative L²", "displacement, relative L²")
    # The error is that of the time steps.
    return _published_checks(MANDEL, errors, steps, names, f", steps of {steps[0]:g} s")


def _mandel_errors(
    solver: MacroSolver, step: float, top: dict[str, Any], load: float, curve: tuple[tuple[float, float], ...]
) -> Errors:
    block = BLOCK
    x, y, z = ({"displacement": tuple(0.0 if i == j else None for j in range(3))} for i in range(3))
    problem = MacroProblem.model_validate(
        {
            "body": {"size": (block.half_width, 10, 2), "elements": (50, 5, 1)},
            "boundary": {"x-": x, "y-": y, "z-": z, "z+": z, "x+": {"pressure": 0}, "y+": top},
            "load": load,
            "time": _loaded_at_once(step, tuple(MANDEL)) | {"load_curve": curve},
        }
    )
    law = isotropic_law(block.lame, block.shear, block.biot, block.storage, block.conductivity)
    solution = solver.solve(solver.prepare(problem), law)
    in_middle = solution.cells[:, 26]
    place = solution.points[in_middle]
    found = []
    for time, profile in zip(MANDEL, solution.after_rest, strict=True):
        u = np.column_stack([block.lateral(place[:, 0], time), block.strain(time) * place[:, 1]])
        pressure = relative_l2(profile.element_p, block.pressure(place[:, 0], time))
        found.append((pressure, relative_l2(profile.u[in_middle][:, :2], u)))
    return found


TERZAGHI_CASE = VerificationCase(
    "terzaghi",
    "Terzaghi 1923; errors to be undercut: PorePy 1.8, tests of terzaghi_biot",
    "macro solver",
    {"10 cells": terzaghi},
)
MANDEL_CASE = VerificationCase(
    "mandel",
    "Mandel 1953; Cheng & Detournay 1988; errors to be undercut: PorePy 1.8, tests of mandel_biot",
    "macro solver",
    {"moved plates": moved_plates, "pushed plates": pushed_plates},
)

#: Error allowed, of the largest value of each quantity over time.
ALLOWED_OF_LARGEST = 0.01
#: 1/M_B of the cylinder. Its fluid and solid are incompressible; 1/M_B = 0 exactly is no law of a cell.
STORAGE = 1e-9
HEIGHT = 0.5


def unconfined(
    body: dict[str, Any], planes: tuple[str, ...], solver: MacroSolver, long: bool
) -> Sequence[Check]:
    """Check a part of a cylinder between its symmetry planes against Armstrong's solution."""
    exact = UnconfinedCompression(1.0, -0.01, lame=0.3, shear=0.4, conductivity=1.0, ramp=0.05)
    # The error of a step goes with its square and that of the history with the step.
    tolerances = (5e-4, 1.25e-4) if long else (5e-4,)
    found = [unconfined_errors(solver, exact, body, planes, tolerance) for tolerance in tolerances]
    checks = []
    for i, quantity in enumerate(("force on the plates", "radius", "pressure on the axis")):
        steps, errors = np.sqrt(tolerances).tolist(), [errors[i] for errors in found]
        order = observed_order(steps, errors, exact=0.0) if long else None
        checks.append(Check(f"{quantity}, of its largest", errors[-1], ALLOWED_OF_LARGEST, order=order))
    return checks


def unconfined_errors(
    solver: MacroSolver,
    exact: UnconfinedCompression,
    body: dict[str, Any],
    planes: tuple[str, ...],
    tolerance: float,
) -> list[float]:
    """Return the largest error of each quantity over the history."""
    boundary: dict[str, Any] = {name: {"normal": 0} for name in (*planes, "y-")}
    boundary["y+"] = {"displacement": (None, exact.strain * HEIGHT, None)}
    boundary["side"] = {"pressure": 0}
    time = {"end": 1.0, "step": 0.1, "ramp_increments": 10, "ramp_step": exact.ramp / 10, "profiles": ()}
    problem = MacroProblem.model_validate(
        {
            "body": {"radius": exact.radius, "height": HEIGHT, "elements": (7, 1, 1), **body},
            "boundary": boundary,
            "probes": {"rim": (exact.radius, 0.0, 0.0), "axis": (0.0, 0.0, 0.0)},
            "time": time | {"tolerance": tolerance},
        }
    )
    law = isotropic_law(exact.lame, exact.shear, 1.0, STORAGE, exact.conductivity)
    solution = solver.solve(solver.prepare(problem), law)
    mesh = body_mesh(problem)
    area = float(Facets(mesh, mesh.surfaces["y+"]).areas.sum())
    later = solution.history.time > 0
    times = solution.history.time[later].tolist()
    ours = (
        solution.reactions["y+"][later, 1] / area,
        solution.probes["rim"][later, 0],
        solution.probes["axis"][later, 3],
    )
    theirs = (
        [exact.stress(t) for t in times],
        [float(exact.lateral(exact.radius, t)) for t in times],
        [float(exact.pressure(0.0, t)) for t in times],
    )
    return [largest_error(a, np.array(b)) for a, b in zip(ours, theirs, strict=True)]


UNCONFINED = VerificationCase(
    "unconfined",
    "Armstrong, Lai & Mow 1984, J. Biomech. Eng. 106, 165–173",
    "macro solver",
    {
        "quarter": partial(unconfined, {"kind": "quarter-cylinder"}, ("x-", "z-")),
        # A twelfth, one plane of which is oblique.
        "wedge": partial(unconfined, {"kind": "wedge", "angle": 30}, ("oblique", "z-")),
        "meridian": partial(unconfined, {"kind": "axisymmetric", "elements": (12, 1)}, ()),
    },
)

#: Loads that tend to zero; the largest moves the top by a tenth of the height.
LOADS = (0.04, 0.02, 0.01, 0.005)
QUANTITIES = {
    "settlement": "settlement",
    "pressure_max": "largest pressure",
    "drained": "drained volume",
}
#: Difference between nonlinear and linear at the smallest load, and distance of the order from 1.
ALLOWED_AT_LIMIT, ALLOWED_ORDER = 0.03, 0.1


class _PotentialCell(CellLaw):
    """The made-up cell with a potential, in closed form."""

    identity = fingerprint(potential_cell.IDENTITY)

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return all responses."""
        return potential_cell.respond(states)


def mean_gradient() -> tuple[MacroLaw, LinearPoroelasticity]:
    """Return the closure on <∇u¹>_s = M:H + Q p, and its linear limit."""
    return mean_gradient_law(), linear_law()


def potential() -> tuple[MacroLaw, LinearPoroelasticity]:
    """Return the closure on a cell with a potential W that is no polynomial, and its linear limit."""
    tangent = potential_cell.respond(MacroState.zeros(1)).tangent
    C, minus_biot, storage, M, Q = (
        getattr(tangent, name)[0]
        for name in ("stress_grad_u", "stress_p", "fluid_volume_p", "mean_grad_grad_u", "mean_grad_p")
    )
    linear = LinearCoefficients(C, -minus_biot, -minus_biot, float(storage), CONDUCTIVITY, M, Q)
    closure = PotentialClosure(potential_cell.SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    return ClosedLaw(_PotentialCell(), closure), LinearPoroelasticity(linear)


def limit(
    make: Callable[[], tuple[MacroLaw, LinearPoroelasticity]], solver: MacroSolver, long: bool
) -> Sequence[Check]:
    """Check histories of a column under smaller and smaller loads."""
    laws = make()
    loads = (*LOADS, LOADS[-1] / 2, LOADS[-1] / 4) if long else LOADS
    plan = {"end": 20.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.25, "profiles": ()}
    differences: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for load in loads:
        problem = confined_column(20 if long else 8, load=-load, time=plan, newton={"tolerance": 1e-11})
        prepared = solver.prepare(problem)
        one, other = (solver.solve(prepared, law).history for law in laws)
        for name, found in differences.items():
            found.append(largest_error(getattr(one, name), getattr(other, name)))
    checks = []
    for name, values in differences.items():
        order = observed_order(loads[-3:], values[-3:], exact=0.0)
        quantity = f"{QUANTITIES[name]}, nonlinear against linear, load {loads[-1]:g}"
        checks.append(Check(quantity, values[-1], ALLOWED_AT_LIMIT, order=order))
        checks.append(Check(f"{QUANTITIES[name]}, order in the load less 1", abs(order - 1), ALLOWED_ORDER))
    return checks


SMALL_STRAIN = VerificationCase(
    "small-strain",
    "Biot 1941, with the coefficients of the same cell",
    "macro solver",
    {"mean-gradient": partial(limit, mean_gradient), "potential": partial(limit, potential)},
)
