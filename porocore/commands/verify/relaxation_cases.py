"""Case of a cell whose solid relaxes: limits, closed forms, and the law of the body against it along paths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.drawn import NoPores
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.prony import Branch, Relaxation
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.crosscheck.relaxation import CellPath, load_and_reload, ramp_and_hold, run_path
from porocore.commands.verify.case import Check, Solve, VerificationCase
from porocore.core.fields import provided
from porocore.interfaces.cell import CellSolver
from porocore.states import Array, MacroState
from porocore.testing.cell_checks import identities

LINEAR = MeshSettings(size=0.25, fluid_size=0.25, element="linear")
FINE = MeshSettings(size=0.2, fluid_size=0.2)
#: The instantaneous stiffness is twice that of equilibrium.
ONE = Relaxation(branches=(Branch(strength=1.0, time=1.0),))
TWO = Relaxation(branches=(Branch(strength=1.0, time=0.3), Branch(strength=0.5, time=4.0)))
STATE = np.diag([0.02, -0.1, 0.03]), 0.05
EXACT, LINEARISED = 1e-10, 1e-6
#: Of the law in stress and in the fluid's change: while a load is held, and with a second ramp, which it follows less.
HELD, RELOADED = (2e-3, 5e-3), (1e-2, 1e-2)


def _cell(long: bool) -> Cell:
    return Cell(geometry=OrthogonalChannels(radius=0.25), mesh=FINE if long else LINEAR)


def limits(solver: CellSolver, long: bool) -> Sequence[Check]:
    """P_E = a P_E,∞(H, p/a) with a = 1 + Σγ at once, and that of equilibrium in the end."""
    prepared, (H, p), a = solver.prepare(_cell(long)), STATE, 2.5
    states = MacroState(np.stack([np.zeros((3, 3)), H, H]), np.array([0.0, p, p]))
    found = solver.relax(prepared, states, np.array([0.0, 0.0, 1e14]), TWO).response
    checks = []
    for k, name, stiffer in ((1, "at once", a), (2, "in the end", 1.0)):
        elastic = solver.solve_one(prepared, H, p / stiffer, tangent=False)
        P, phi = provided(elastic.stress)[0], provided(elastic.fluid_volume)[0]
        checks += [
            Check(f"P_E {name}", identities.misfit(provided(found.stress)[k], stiffer * P), EXACT),
            Check(f"φ {name}", float(abs(provided(found.fluid_volume)[k] / phi - 1)), EXACT),
        ]
    return checks


def without_pores(solver: CellSolver, long: bool) -> Sequence[Check]:
    """P_E = (1 + Σ γ τ/Δt (1 − e^{−Δt/τ}) e^{−t/τ}) P(I + H) after a ramp of the stress over Δt."""
    mesh = MeshSettings(size=0.15 if long else 0.3)
    prepared = solver.prepare(Cell(geometry=NoPores(kind="no-pores"), mesh=mesh))
    H, ramp, after = np.array([[0.1, 0.2, 0], [0, -0.15, 0.05], [0, 0, 0.1]]), 0.2, 1.5
    states = MacroState(np.stack([np.zeros((3, 3)), H, H]), np.full(3, 0.3))
    found = provided(solver.relax(prepared, states, np.array([0, ramp, ramp + after]), TWO).response.stress)
    P = NeoHookean().stress(np.eye(3) + H)
    over = [
        sum(
            one.strength * one.time / ramp * (1 - np.exp(-ramp / one.time)) * np.exp(-t / one.time)
            for one in TWO.branches
        )
        for t in (0.0, after)
    ]
    return [
        Check(f"P_E {name}", identities.misfit(found[k], (1 + over[k - 1]) * P), EXACT)
        for k, name in ((1, "at the end of the ramp"), (2, "behind it"))
    ]


def small_strain(solver: CellSolver, long: bool) -> Sequence[Check]:
    """P_E = g(t) C:H drained, g = 1 + Σ γ e^{−t/τ}; the fluid stays."""
    prepared = solver.prepare(_cell(long))
    rest = solver.solve_one(prepared, np.zeros((3, 3)))
    C = provided(provided(rest.tangent).stress_grad_u)[0]
    H: Array = 1e-7 * np.diag([0.3, -1.0, 0.2])
    times = np.array([0.0, 0.0, 0.1, 1.0, 5.0])
    states = MacroState(np.stack([np.zeros((3, 3)), H, H, H, H]), np.zeros(5))
    found = solver.relax(prepared, states, times, TWO).response
    g = 1 + sum(one.strength * np.exp(-times[1:] / one.time) for one in TWO.branches)
    wanted = np.asarray(g)[:, None, None] * np.einsum("ijkl,kl->ij", C, H)
    changes = np.diff(provided(found.fluid_volume))
    return [
        Check("P_E = g(t) C:H", identities.misfit(provided(found.stress)[1:], wanted), LINEARISED),
        Check(
            "φ creeps, of its sudden change", float(np.abs(changes[1:]).max() / abs(changes[0])), LINEARISED
        ),
    ]


def law(
    make: Callable[..., CellPath],
    state: tuple[Array, float],
    allowed: tuple[float, float],
    solver: CellSolver,
    long: bool,
) -> Sequence[Check]:
    """The law over the cell in equilibrium against the cell with its history."""
    cell = _cell(long)
    run = run_path(solver, solver.prepare(cell), cell, make("", *state, ONE), ONE, "")
    return [
        Check("P_E of the law, of the largest", run.stress_error, allowed[0]),
        Check("φ of the law, of its change", run.fluid_error, allowed[1]),
    ]


def _if_it_relaxes(solve: Solve) -> Solve:
    """Return the item, without any check for a solver that follows no cell whose solid relaxes."""

    def checks(solver: CellSolver, long: bool) -> Sequence[Check]:
        return solve(solver, long) if solver.relaxes else []

    return checks


_PRESSED: Array = np.diag([0.0, -0.1, 0.0])
_ITEMS: dict[str, Solve] = {
    "limits": limits,
    "without pores": without_pores,
    "small strain": small_strain,
    "law, held": partial(law, ramp_and_hold, (_PRESSED, 0.0), HELD),
    "law, held, p = 0.1": partial(law, ramp_and_hold, (_PRESSED, 0.1), HELD),
    "law, in two ramps": partial(law, load_and_reload, (_PRESSED, 0.0), RELOADED),
}
RELAXATION = VerificationCase(
    "relaxation",
    "linear viscoelasticity and the elastic limits in closed form; the cell with its history",
    "cell solver",
    {name: _if_it_relaxes(solve) for name, solve in _ITEMS.items()},
)
