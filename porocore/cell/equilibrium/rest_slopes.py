"""Slopes by parameters of the second derivatives of W in the undeformed state (hessian_slopes_at_rest).

At rest no stress acts. With D_k = δ_kH + ∇u_k and S_k = C:D_k + p_k I of the sensitivities u_k to the ten loads, where
p_k is 1 for the load p and 0 for all others::

    A_kl,θ = <q div V − S_l:(∇u_k ∇V) − S_k:(∇u_l ∇V) + D_k:C_θ:D_l>,  q = D_k:C:D_l + p_k tr D_l + p_l tr D_k
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.cell.equilibrium.discrete import DiscreteSolid
from porocore.cell.equilibrium.element_gradients import ElementGradients
from porocore.cell.equilibrium.solid_slopes import ExplicitDependence
from porocore.cell.symmetry.parity import UNIT_LOADS, classes
from porocore.states import Array


def hessian_slopes_at_rest(problem: DiscreteSolid, dependences: Sequence[ExplicitDependence]) -> Array:
    """Return the slopes (10, 10, m) of ∂²W/∂k∂l in the undeformed state by m parameters.

    Parameters
    ----------
    problem
        Solid.
    dependences
        Explicit dependence on each of the m parameters.

    Returns
    -------
    slopes : (10, 10, m)
        Loads H row by row, then p. The blocks are the slopes of ∂P_E/∂H, ∂P_E/∂p = −∂φ/∂H and −∂φ/∂p.

    Raises
    ------
    FactorError
        The solid has no stiffness.
    ValueError
        The solid is swollen, or a parameter swells it: then it has a stress at F = I.
    """
    if problem.material.mean_stretch != 1 or any(d.material and d.elasticity is None for d in dependences):
        raise ValueError(
            "expected a solid without stress in the undeformed state by every parameter, got one that swells"
        )
    found = np.zeros((10, 10, len(dependences)))
    gradients = ElementGradients(problem.mesh, problem.degree)
    F = np.broadcast_to(np.eye(3), (*gradients.weights.shape, 3, 3))
    moduli = problem.material.tangent(F).reshape(*gradients.weights.shape, 9, 9)
    at_rest = problem.iterate_at(np.zeros((3, 3)), 0.0)
    for parity, columns in classes(problem.mesh).items():
        if columns:
            answer = problem.sensitivities(problem.factor(at_rest, parity), columns)
            loads = _Loads(gradients, moduli, columns, answer.displacement)
            for m, dependence in enumerate(dependences):
                found[(*np.ix_(columns, columns), m)] = problem.copies * loads.slopes(dependence)
    return found


class _Loads:
    """Answers at rest to k loads of a class: ∇u, D and S as vectors of nine components, (M, q, k, 9)."""

    def __init__(self, gradients: ElementGradients, moduli: Array, columns: Sequence[int], u: Array) -> None:
        self.gradients = gradients
        self.grad = np.stack([gradients.gradient(one) for one in u], axis=2)
        self.pressed = np.array(columns) == 9
        unit = UNIT_LOADS[list(columns)]
        self.strain = (self.grad + unit).reshape(*self.grad.shape[:3], 9)
        self.stress = self.strain @ moduli.swapaxes(2, 3)
        self.volume = self.strain[..., ::4].sum(axis=-1)
        self.energy = self.stress @ self.strain.swapaxes(2, 3)
        mixed = self.pressed[:, None] * self.volume[:, :, None, :]
        self.energy += mixed + mixed.swapaxes(2, 3)
        self.stress[..., ::4] += self.pressed[:, None]

    def slopes(self, dependence: ExplicitDependence) -> Array:
        """Return the slopes (k, k) by one parameter."""
        found = np.zeros_like(self.energy)
        if dependence.velocity is not None:
            grad_V = self.gradients.gradient(dependence.velocity)
            turned = (self.grad @ grad_V[:, :, None]).reshape(self.strain.shape)
            work = turned @ self.stress.swapaxes(2, 3)
            div = np.trace(grad_V, axis1=2, axis2=3)[:, :, None, None]
            found += self.energy * div - work - work.swapaxes(2, 3)
        if dependence.elasticity is not None:
            C = dependence.elasticity.reshape(*dependence.elasticity.shape[:2], 9, 9)
            found += self.strain @ C @ self.strain.swapaxes(2, 3)
        return self.gradients.integral(found)
