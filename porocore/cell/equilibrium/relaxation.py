"""Path of a cell whose solid relaxes, step by step, with the stress history of each quadrature point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from porocore.cell.equilibrium.discrete import DiscreteSolid, Iterate, element_gradients
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.materials.prony import Relaxation, step_factors
from porocore.cell.materials.relaxing import RelaxingSolid, second_stress
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore.states import Array, CellResponse, MacroState

#: Response of a solid under (H, p), reached from an iterate, and its equilibrium; None where there is none.
Solve = Callable[[DiscreteSolid, Iterate, Array, float], tuple[CellResponse, Iterate | None]]


def require_path(path: MacroState, times: Array) -> None:
    """Refuse a path that cannot be followed.

    Raises
    ------
    ConfigurationError
        There is no state, or not one time for each; times are not finite, or fall; no cell can be in a state.
    """
    if len(path) < 1 or np.shape(times) != (len(path),):
        raise ConfigurationError(
            f"path: expected one time for each of at least one state, got {len(path)} states and times of shape "
            f"{np.shape(times)}"
        )
    if not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise ConfigurationError(f"path: expected finite times that never fall, got {echo(list(times))}")
    with np.errstate(invalid="ignore"):
        volume = np.linalg.det(np.eye(3) + path.grad_u)
    possible = (volume > 0) & np.isfinite(path.p)
    if not possible.all():
        k = int(np.argmin(possible))
        raise ConfigurationError(
            f"path: expected finite states with det (I + H) > 0, got H = {path.grad_u[k].tolist()}, p = {path.p[k]:g} "
            f"at the time {times[k]:g}"
        )


@dataclass(frozen=True, eq=False)
class _History:
    """Stress S_∞ (M, q, 3, 3) and overstresses Q_i (b, M, q, 3, 3) at the quadrature points at the last time."""

    stress: Array
    overstresses: Array

    def solid(self, elastic: StrainEnergy, decays: Array, gains: Array) -> RelaxingSolid:
        """Return the solid of the next step."""
        gain = float(gains.sum())
        return RelaxingSolid(
            elastic, gain, np.tensordot(decays, self.overstresses, axes=1) - gain * self.stress
        )

    def after(self, stress: Array, decays: Array, gains: Array) -> _History:
        """Return the history behind the next step, which ends at another S_∞."""
        kept = decays[:, None, None, None, None] * self.overstresses
        return _History(stress, kept + np.multiply.outer(gains, stress - self.stress))


def follow_relaxing(
    solid: DiscreteSolid,
    make: Callable[[StrainEnergy], DiscreteSolid],
    solve: Solve,
    path: MacroState,
    times: Array,
    relaxation: Relaxation,
) -> Iterator[tuple[CellResponse, Iterate | None]]:
    """Yield response and equilibrium of each state; behind one without values, its status and None.

    Parameters
    ----------
    solid
        Solid in equilibrium, on the domain of the path.
    make
        Gives the solid of another material on the same mesh.
    solve
        Solves one state.
    path, times
        n states at n times.
    relaxation
        Overstress of the solid.
    """
    branches = relaxation.acting
    gradients = element_gradients(solid.mesh, solid.degree)
    history: _History | None = None
    start = solid.iterate_at(solid.unstressed, 0.0)
    for k, (H, p) in enumerate(zip(path.grad_u, path.p, strict=True)):
        step, factors = solid, step_factors(branches, float(times[k] - times[k - 1])) if k else None
        if history is not None and factors is not None:
            step = make(history.solid(solid.material, *factors))
            start = step.iterate_at(start.H, start.p, start.displacement)
        response, found = solve(step, start, H, float(p))
        response = replace(response, potential=None)
        if found is None:
            yield from [(response, None)] * (len(path) - k)
            return
        yield response, found
        if branches:
            F = np.eye(3) + H + gradients.gradient(found.displacement)
            S = second_stress(solid.material, F)
            if history is None or factors is None:
                history = _History(S, np.zeros((len(branches), *S.shape)))
            else:
                history = history.after(S, *factors)
        start = solid.iterate_at(H, float(p), found.displacement)
