"""Cases of laws with a memory: a layer whose solid relaxes, fixed charges in a bath."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from porocore.commands.verify.case import Check, VerificationCase, relative_check
from porocore.commands.verify.linear_cases import largest_error, potential
from porocore.core.formulas import TimeFunction
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.macro.analytic import ChargedCell, ChargedLayer, LayeredConsolidation, SoilLayer
from porocore.macro.laws.charges import ChargedLaw, OsmoticPressure
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore.testing.synthetic.response import confined_column, linear_law

#: Height of the columns, and of their elements in the short and in the long form.
HEIGHT, ELEMENTS = 7.5, (16, 24)
#: Error of a step in time that is tolerated, in the short and in the long form.
TOLERANCES = 5e-5, 2e-5
#: Load, strength and time of two branches: one relaxes before the layer drains, the other one while it does.
LOAD, BRANCHES = 1e-4, ((1.0, 2.0), (0.5, 40.0))
#: Error of a curve, of its largest value.
ALLOWED = 2e-3
#: Concentration of the charges, that of the bath, and osmotic pressure per concentration [E].
DENSITY, BATH, OSMOTIC = 0.2, 0.15, 0.25
#: Relative change of the bath.
CHANGE = -1e-3
CONFINED, FREE = np.diag([0.0, 1.0, 0.0]), np.eye(3)


def relaxing(held: bool, solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Check a layer under a load, or whose top is ``held`` at a settlement, that comes in a moment."""
    coefficients = linear_law().coefficients
    layer = SoilLayer.from_coefficients(coefficients, HEIGHT, BRANCHES)
    exact = LayeredConsolidation([layer], LOAD, ramp=1e-3)
    time = {"end": 60.0, "step": 20.0, "ramp_increments": 1, "ramp_step": 1e-3, "profiles": ()}
    fields = {
        f"relaxation.{i}.{name}": value
        for i, branch in enumerate(BRANCHES, 1)
        for name, value in zip(("strength", "time"), branch, strict=True)
    }
    problem = confined_column(
        ELEMENTS[long],
        -LOAD,
        time=time | {"tolerance": TOLERANCES[long]},
        fields=fields,
        probes={"bottom": (0.05, 0.0, 0.05)},
    )
    settlement = exact.settlement(60.0)
    if held:
        problem = with_top(problem, displacement=(0, settlement / LOAD, 0), traction=(0, 0, 0))
    solution = solver.solve(
        solver.prepare(problem), RelaxingLaw(linear_law(), len(BRANCHES), small_strain=True)
    )
    # Before, the front of the pressure is no wider than two elements.
    later = solution.history.time > 0.3
    times, pressure = solution.history.time[later].tolist(), solution.probes["bottom"][later, 3]
    if held:
        force = -solution.reactions["y+"][later, 1] / 0.01
        loads = np.array([exact.held_load(settlement, t) for t in times])
        bottom = np.array([exact.held_pressure(settlement, 0.0, t)[0] for t in times])
        first = Check("force that holds the top", largest_error(force, loads), ALLOWED)
    else:
        moved = np.array([exact.settlement(t) for t in times])
        bottom = np.array([exact.pressure(0.0, t)[0] for t in times])
        first = Check("settlement", largest_error(solution.history.settlement[later], moved), ALLOWED)
    return [first, Check("pressure at the base", largest_error(pressure, bottom), ALLOWED)]


def with_top(problem: MacroProblem, **conditions: Any) -> MacroProblem:
    """Return the problem with other conditions on the top."""
    top = problem.boundary["y+"].model_copy(update=conditions)
    return problem.model_copy(update={"boundary": {**problem.boundary, "y+": top}})


def equilibrium(law: MacroLaw, direction: Array, load: float = 0.0) -> tuple[float, float, float, float]:
    """Return strain, pressure, fluid volume and charge of a cell in the bath, by its scalar equations."""
    rest, still = law.initial(1), np.zeros((1, 3))

    def response(H: Array, p: float) -> tuple[Array, float]:
        found = law.respond(MacroState.single(H, p), still, rest)
        return found.stress[0], float(found.memory.fluid_volume[0])

    charge = DENSITY * float(rest.fluid_volume[0])
    strain, p = ChargedCell(response, charge, BATH, OSMOTIC).equilibrium(direction, load)
    return strain, p, response(strain * direction, p)[1], charge


def swollen(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Check a cube that swells freely, and a column under a load that it bears at last."""
    law, load, checks = potential()[0], 0.03, []
    time = {"end": 4e4, "step": 5e3, "ramp_increments": 2, "ramp_step": 1.0, "profiles": ()}
    fields = {"charges.density": DENSITY, "charges.bath": BATH}
    more: dict[str, Any] = {"time": time, "fields": fields, "newton": {"tolerance": 1e-12}}
    slides, bath = {"normal": 0}, {"pressure": 0}
    cube = {
        "body": {"kind": "box", "elements": (2, 2, 2) if long else (1, 1, 1), "size": (1, 1, 1)},
        "boundary": {"x-": slides, "y-": slides, "z-": slides, "x+": bath, "y+": bath, "z+": bath},
        "probes": {"far": (1.0, 1.0, 1.0)},
    }
    column = confined_column(6 if long else 3, -load, probes={"far": (0.05, HEIGHT, 0.05)}, **more)
    bodies = {
        "swelling stretch less 1 of a free cube": (MacroProblem.model_validate(cube | more), FREE, 0.0, 1.0),
        "strain of a column under a load": (column, CONFINED, load, HEIGHT),
    }
    for quantity, (problem, direction, pressing, length) in bodies.items():
        solution = solver.solve(solver.prepare(problem), ChargedLaw(law, OSMOTIC))
        strain = equilibrium(law, direction, pressing)[0]
        ours = float(solution.probes["far"][-1, 1]) / length
        checks.append(relative_check(quantity, strain, ours, 1e-8))
    return checks


def diluted(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """Check a column, at rest under a load, whose bath is diluted a little, against the linear theory."""
    law, load = linear_law(), 0.01
    strain, p, fluid, charge = equilibrium(law, CONFINED, load)
    state = MacroState.single(strain * CONFINED, p)
    tangent = law.respond(state, np.zeros((1, 3)), law.initial(1)).tangent
    assert tangent is not None
    osmotic = OsmoticPressure.at(np.array([fluid]), np.array([charge]), np.array([BATH]), OSMOTIC)
    layer = ChargedLayer(
        HEIGHT,
        float(tangent.stress_grad_u[0, 1, 1, 1, 1]),
        float(tangent.storage_grad_u[0, 1, 1]),
        float(tangent.storage_p[0]),
        -float(tangent.flux_grad_p[0, 1, 1]),
        float(osmotic.by_fluid[0]),
        float(osmotic.by_bath[0]),
    )
    scale, change = HEIGHT**2 / layer.loaded(1.0).consolidation_coefficient, CHANGE * BATH
    moment = 1e-6 * scale
    bath = {"formula": repr(BATH + change), "initial": BATH, "over": {"ramp": 1.0, "until": moment}}
    time = {"end": 0.8 * scale, "step": scale / 50, "ramp_increments": 1, "ramp_step": moment, "profiles": ()}
    problem = confined_column(
        ELEMENTS[long],
        -load,
        time=time | {"tolerance": TOLERANCES[long]},
        fields={"charges.density": DENSITY, "charges.bath": bath},
        initial={"gradient": (strain * CONFINED).tolist()},
        newton={"tolerance": 1e-12},
        probes={"top": (0.05, HEIGHT, 0.05), "bottom": (0.05, 0.0, 0.05)},
    )
    always = TimeFunction(table=((0.0, 1.0), (1.0, 1.0)))
    problem = with_top(problem, traction=(0.0, always, 0.0))
    solution = solver.solve(solver.prepare(problem), ChargedLaw(law, OSMOTIC))
    later = solution.history.time > 0.02 * scale
    times = solution.history.time[later]
    rise = solution.probes["top"][later, 1] - strain * HEIGHT
    pressure = solution.probes["bottom"][later, 3]
    return [
        Check("rise of the top", largest_error(rise, layer.rise(change, times)), 5e-3),
        Check(
            "effective pressure at the base",
            largest_error(pressure, layer.effective_pressure(change, 0.0, times)),
            5e-3,
        ),
    ]


RELAXING_LAYER = VerificationCase(
    "relaxing-layer",
    "Biot 1956, J. Appl. Phys. 27, 459 (correspondence principle); the transform inverted",
    "macro solver",
    {"load": partial(relaxing, False), "held": partial(relaxing, True)},
)
CHARGES = VerificationCase(
    "charges",
    "Overbeek 1956, Prog. Biophys. 6, 58; Lai, Hou & Mow 1991, J. Biomech. Eng. 113, 245",
    "macro solver",
    {"equilibrium": swollen, "diluted bath": diluted},
)
