"""Changes of the responses of a cell at fixed (H, p) under unknowns: its parameters, modulus, viscosity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.core.fields import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw, PointChanges
from porocore.states import Array, CellResponse, CellSlopes, CellTangent, MacroState


@dataclass(frozen=True, eq=False)
class CellChanges(Batch):
    """Derivatives of a cell's responses by k unknowns at fixed (H, p); those that a cell does not provide are None.

    Attributes
    ----------
    modulus : (n, k)
        Relative change of the modulus of the solid.
    mean_grad : (n, 3, 3, k)
        Of <∇u¹>_s.
    porosity : (n, k)
        Of φ_f of the undeformed cell.
    conductivity : (n, 3, 3, k)
        Of K_ref where the response has it, else of K of the undeformed cell.
    stress : (n, 3, 3, k)
        Of P_E.
    fluid_volume : (n, k)
        Of φ.
    """

    modulus: Array
    mean_grad: Array
    porosity: Array
    conductivity: Array
    stress: Array | None = None
    fluid_volume: Array | None = None


def cell_changes(
    law: CellLaw,
    states: MacroState,
    cell: CellResponse,
    changes: PointChanges,
    undeformed: Array | None,
    needed: tuple[str, ...],
) -> CellChanges:
    """Return the changes of the cell's responses.

    W = E w(H, p/E), so that E ∂P_E/∂E = P_E − p ∂P_E/∂p and E ∂φ/∂E = −p ∂φ/∂p, and so on; K is in inverse proportion
    to the viscosity.

    Parameters
    ----------
    cell
        Responses with their tangent.
    undeformed
        K of the undeformed cells, (3, 3) or (n, 3, 3); None where the flux goes by K_ref of the deformed ones.
    needed
        Responses whose slopes by the parameters must be known.

    Raises
    ------
    ConfigurationError
        The cell law does not know a derivative.
    """
    tangent = cell.tangent
    assert tangent is not None
    if undeformed is None and tangent.conductivity_p is None:
        raise ConfigurationError(
            f"the cell law {type(law).__name__} gives no derivatives of the conductivity of the deformed pore, without "
            "which a run has no sensitivities; choose conductivity: piola, or a surrogate"
        )
    found = _without_parameters(cell, tangent, states.p, changes, undeformed)
    if changes.parameters is None or not changes.parameters.any():
        return found
    if undeformed is not None and cell.conductivity is not None:
        raise ConfigurationError(
            f"the cell law {type(law).__name__} gives derivatives of the conductivity of the deformed pore by its "
            "parameters, and not of the undeformed one; choose conductivity: deformed"
        )
    return _with_parameters(found, law, law.slopes(states), changes.parameters, needed)


def _without_parameters(
    cell: CellResponse, tangent: CellTangent, p: Array, changes: PointChanges, undeformed: Array | None
) -> CellChanges:
    """Return the changes by modulus and viscosity."""
    n, k = changes.modulus.shape
    scaled = changes.modulus

    def by_modulus(value: Array | None, by_p: Array | None, power: int, *shape: int) -> Array | None:
        if value is None or by_p is None:
            return None
        change = (power * value - p.reshape(n, *(1 for _ in shape)) * by_p).reshape(n, -1, 1)
        return np.asarray(change * scaled[:, None, :]).reshape(n, *shape, k)

    mean_grad = by_modulus(cell.mean_grad, tangent.mean_grad_p, 0, 3, 3)
    K = cell.conductivity if undeformed is None else np.broadcast_to(undeformed, (n, 3, 3))
    assert mean_grad is not None
    assert K is not None
    flow = -K[..., None] * changes.viscosity[:, None, None, :]
    moved = by_modulus(K, tangent.conductivity_p, 0, 3, 3) if undeformed is None else None
    fluid = tangent.fluid_volume_p
    return CellChanges(
        modulus=scaled,
        mean_grad=mean_grad,
        porosity=np.zeros_like(scaled),
        conductivity=flow if moved is None else flow + moved,
        stress=by_modulus(cell.stress, tangent.stress_p, 1, 3, 3),
        fluid_volume=None if fluid is None else -(p * fluid)[:, None] * scaled,
    )


def _with_parameters(
    found: CellChanges, law: CellLaw, slopes: CellSlopes, changes: Array, needed: tuple[str, ...]
) -> CellChanges:
    """Return the changes with those by the parameters (n, m, k) added."""

    def by_parameters(name: str, slope: Array | None, change: Array | None) -> Array | None:
        if slope is None:
            if name in needed:
                raise ConfigurationError(
                    f"the cell law {type(law).__name__} gives no derivatives of {name} by the parameters of the cell, "
                    "without which a run has no sensitivities to them; choose a surrogate with the closure potential"
                )
            return change
        n, m, k = changes.shape
        moved = np.asarray(slope.reshape(n, -1, m) @ changes).reshape(*slope.shape[:-1], k)
        return moved if change is None else change + moved

    mean_grad = by_parameters("mean_grad", slopes.mean_grad, found.mean_grad)
    porosity = by_parameters("porosity", slopes.porosity, found.porosity)
    conductivity = by_parameters("conductivity", slopes.conductivity, found.conductivity)
    assert mean_grad is not None
    assert porosity is not None
    assert conductivity is not None
    return CellChanges(
        found.modulus,
        mean_grad,
        porosity,
        conductivity,
        by_parameters("stress", slopes.stress, found.stress),
        by_parameters("fluid_volume", slopes.fluid_volume, found.fluid_volume),
    )
