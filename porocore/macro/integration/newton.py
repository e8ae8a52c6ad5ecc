"""Newton's iteration of one time step: convergence, round-off, refusal of missing values."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.body_fields import EVERYWHERE_ALIKE, CellsAtPoints
from porocore.macro.integration.discretisation import Discretisation, Residual, StepFailed
from porocore.macro.integration.linearisation import Linearisation, Linearisations
from porocore.macro.problem import NewtonSettings
from porocore.states import Array

#: How many units of round-off of the terms of a residual count as none.
ROUND_OFF = 20 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Step:
    """Solved time step.

    Attributes
    ----------
    x : (local unknowns,)
        Displacements and pressures.
    response
        Of the law there, without tangent where it was not needed.
    residual
        What is left, and the reactions.
    iterations
        Linear systems solved.
    misfits
        Residual over its scale (the larger of force and volume) before each iteration and at the end.
    """

    x: Array
    response: MacroResponse
    residual: Residual
    iterations: int
    misfits: list[float] = field(default_factory=list)


def newton_step(
    d: Discretisation,
    law: MacroLaw,
    memory: LawMemory,
    x: Array,
    dt: float,
    loads: Loads,
    settings: NewtonSettings,
    *,
    guess: Array | None = None,
    linearisations: Linearisations | None = None,
    fields: CellsAtPoints = EVERYWHERE_ALIKE,
) -> Step:
    """Solve one backward Euler step of length ``dt`` under ``loads`` from the unknowns ``x``.

    The first iteration linearises at the old state and moves prescribed values as part of the linear system,
    so that a jump at the boundary does not fold the elements beside it.

    Parameters
    ----------
    guess
        First iterate, instead of ``x``; where it leads nowhere, the iteration begins again at ``x``.
    linearisations
        Those of the solve; without, every iteration linearises anew.
    fields
        Parameters and places of the points at the end of the step.

    Raises
    ------
    StepFailed
        No convergence, no values of the law, or a singular matrix; on all processes alike.
    """
    linearisations = linearisations or Linearisations(d, law, chords=0)
    if guess is not None:
        with suppress(StepFailed):
            return _iterated(d, law, memory, guess, dt, loads, settings, linearisations, fields)
    return _iterated(d, law, memory, x, dt, loads, settings, linearisations, fields)


def _iterated(
    d: Discretisation,
    law: MacroLaw,
    memory: LawMemory,
    x: Array,
    dt: float,
    loads: Loads,
    settings: NewtonSettings,
    linearisations: Linearisations,
    fields: CellsAtPoints,
) -> Step:
    x = x.copy()
    linear = linearisations.begin(dt, loads)
    misfits: list[float] = []
    for iteration in range(settings.iterations + 1):
        jump = loads.values - x[d.prescribed]
        moving = d.communicator.max(float(jump.any())) > 0
        states, grad_p = d.states(x)
        states = fields.given_to(states)
        # Most iterates beyond the first are the last, whose tangent nobody needs.
        response = law.respond(states, grad_p, memory, tangent=linear is None)
        _refuse_missing_values(d, response)
        residual = d.residual(response, dt, loads, x)
        linear = linear or linearisations.at(response, dt, x, loads)
        # A first guess within the tolerance is improved all the same: over many steps its errors add up.
        allowed = settings.tolerance if iteration else 0.0
        misfit = misfit_of(d, residual)
        if misfit > allowed:
            share = max(ROUND_OFF, law.noise)
            misfit = misfit_of(d, residual, _round_off(d, linear, x, share, begun=iteration > 0))
        misfits.append(misfit)
        if misfit <= allowed and not moving:
            return Step(x, response, residual, iteration, misfits)
        if iteration < settings.iterations:
            if iteration and not linearisations.serves(misfits, settings.tolerance):
                linear = linearisations.at(law.respond(states, grad_p, memory), dt, x, loads)
            before = misfits[-2] if iteration else None
            accuracy = linearisations.accuracy(misfit, before, settings.tolerance, loads)
            x -= d.solve(linear.system, residual.values, -jump, again=iteration > 0, accuracy=accuracy)
            x[d.prescribed] = loads.values
    raise StepFailed(
        f"the relative residual of Newton's method was still {misfits[-1]:.2g} after {settings.iterations} iterations "
        f"(newton.tolerance = {settings.tolerance:g})"
    )


def _refuse_missing_values(d: Discretisation, response: MacroResponse) -> None:
    parts = (response.stress, response.storage, response.flux)
    bad = np.zeros(d.n_points, bool)
    for part in parts:
        finite = np.isfinite(part)
        if not finite.all():  # seldom
            bad |= ~finite.reshape(d.n_points, -1).all(axis=1)
    count, points = d.communicator.sum(np.array([bad.sum(), len(bad)]))
    if count:
        which = f"{int(count)} of {int(points)} points"
        raise StepFailed(f"the law has no values at {which} (det F̄ ≤ 0, or a cell without solution)")


def misfit_of(d: Discretisation, residual: Residual, round_off: tuple[float, float] = (0.0, 0.0)) -> float:
    """Return the largest free residual over its scale, of forces and volumes; zero where only round-off is left."""
    scales = (residual.force_scale, residual.volume_scale)
    return max(
        r / s if r > floor else 0.0
        for r, s, floor in zip(largest_free(d, residual.values), scales, round_off, strict=True)
    )


def largest_free(d: Discretisation, values: Array) -> tuple[float, float]:
    """Return the largest free force and the largest free volume over all processes."""
    magnitude, is_force = np.abs(d.equations(values)), d.is_force[d.free[d.leading]]
    blocks = (magnitude[is_force], magnitude[~is_force])
    force, volume = (d.communicator.max(float(block.max(initial=0.0))) for block in blocks)
    return force, volume


def _round_off(
    d: Discretisation, tangent: Linearisation, x: Array, share: float, *, begun: bool
) -> tuple[float, float]:
    """Return the forces and volumes that are round-off, a ``share`` of the terms that cancel in them.

    These are |A| |x|, and for forces also the stress of the 1 in I + H, which hides loads below some 1e-12. Volumes
    differ by what a step takes up, and their round-off is that of the fluid volume itself, again of the 1 in I + H: a
    step 1e-7 of the consolidation time long takes up so little that it was 2e-9 of it, and no step could be short
    enough. Of a first guess (not ``begun``) that counts as an error, for over many steps such errors add up.
    """
    force, volume = largest_free(d, d.magnitudes(tangent.system, x))
    filled = tangent.fullest * d.mesh.share_of_volume if begun else 0.0
    return share * (force + tangent.stiffest * d.stretch), share * (volume + filled)
