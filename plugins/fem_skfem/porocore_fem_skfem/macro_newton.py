"""One time step: Newton's iteration with the exact tangent."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from porocore.laws import LawMemory, MacroLaw, MacroResponse
from porocore.problem import NewtonSettings
from porocore_fem_skfem.macro_assembly import Assembler, Residual, System

#: How many units of round-off of the terms of a residual count as none.
ROUND_OFF = 20 * float(np.finfo(float).eps)


class StepFailed(Exception):
    """Newton's iteration did not arrive; the time stepping shortens the step."""


@dataclass(frozen=True, eq=False)
class Step:
    """A solved step.

    Attributes
    ----------
    x : (unknowns,)
        Displacements, then pressures.
    response
        Of the law there.
    residual
        What is left, and the reactions.
    iterations
        Linear systems solved.
    misfits
        Residual over its scale (the larger of force and volume) before each iteration and at the end.
    """

    x: Any
    response: MacroResponse
    residual: Residual
    iterations: int
    misfits: list[float] = field(default_factory=list)


def newton_step(
    assembler: Assembler,
    law: MacroLaw,
    memory: LawMemory,
    x: Any,
    dt: float,
    factor: float,
    settings: NewtonSettings,
) -> Step:
    """Solve one backward Euler step of length ``dt`` under ``factor`` (load × ramp) from the unknowns ``x``.

    The first iteration linearises at the old state and moves prescribed values as part of the linear system,
    so that a jump at the boundary does not fold the elements beside it.

    Raises
    ------
    StepFailed
        No convergence, no values of the law, or a singular matrix.
    """
    space = assembler.space
    x = x.copy()
    misfits: list[float] = []
    for iteration in range(settings.iterations + 1):
        jump = factor * space.values - x[space.prescribed]
        states, grad_p = assembler.states(x)
        response = law.respond(states, grad_p, memory)
        residual = assembler.residual(response, dt, factor)
        if not np.isfinite(residual.values).all():
            raise StepFailed(_without_values(response))
        # A first guess within the tolerance is improved all the same: over many steps its errors add up.
        allowed = settings.tolerance if iteration else 0.0
        misfit, system = _misfit(assembler, residual), None
        if misfit > allowed or jump.any():
            assert response.tangent is not None
            system = assembler.system(response.tangent, dt)
            misfit = _misfit(assembler, residual, _round_off(assembler, system, x, response))
        misfits.append(misfit)
        if system is None or (misfit <= allowed and not jump.any()):
            return Step(x, response, residual, iteration, misfits)
        if iteration < settings.iterations:
            right = residual.values[assembler.free]
            if jump.any():
                right = right + system.coupling @ jump
            x[assembler.free] -= _solve(system.free, right)
            x[space.prescribed] = factor * space.values
    raise StepFailed(
        f"Newton's iteration stood at {misfits[-1]:.2g} of the force and volume scale after "
        f"{settings.iterations} iterations (newton.tolerance = {settings.tolerance:g})"
    )


def _solve(matrix: Any, right: Any) -> Any:
    try:
        solution = splu(matrix).solve(right)
    except RuntimeError as error:
        raise StepFailed(f"{error}: the body may not be held against rigid motions") from error
    if not np.isfinite(solution).all():
        raise StepFailed("the tangent is singular: the body may not be held against rigid motions")
    return solution


def _without_values(response: MacroResponse) -> str:
    bad = ~np.isfinite(response.stress).all(axis=(1, 2)) | ~np.isfinite(response.storage)
    which = f"{int(bad.sum())} of {len(bad)} points"
    return f"the law has no values at {which} (det F̄ ≤ 0, or a cell without solution)"


def _misfit(assembler: Assembler, residual: Residual, round_off: tuple[float, float] = (0.0, 0.0)) -> float:
    """Largest free residual over its scale, of forces and volumes; zero where only round-off is left."""
    values, is_force = np.abs(residual.values[assembler.free]), assembler.free < assembler.space.n_u
    largest = [float(values[block].max(initial=0.0)) for block in (is_force, ~is_force)]
    scales = (residual.force_scale, residual.volume_scale)
    return max(r / s if r > floor else 0.0 for r, s, floor in zip(largest, scales, round_off, strict=True))


def _round_off(assembler: Assembler, system: System, x: Any, response: MacroResponse) -> tuple[float, float]:
    """Forces and volumes that are round-off of the terms which cancel in them.

    These are |A| |x|, and for forces also the stress of the 1 in I + H, which hides loads below some 1e-12.
    """
    assert response.tangent is not None
    free, space = assembler.free, assembler.space
    terms = abs(system.free) @ np.abs(x[free]) + abs(system.coupling) @ np.abs(x[space.prescribed])
    force = float(terms[free < space.n_u].max(initial=0.0))
    force += float(np.abs(response.tangent.stress_grad_u).max()) * assembler.stretch
    return ROUND_OFF * force, ROUND_OFF * float(terms[free >= space.n_u].max(initial=0.0))
