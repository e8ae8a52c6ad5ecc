"""Slopes of the averages of the solid by parameters of the cell, and of the tangent at rest.

Only the explicit dependence on a parameter counts for W, since Π is stationary. With the velocity V of the mesh,
X → X + δθ V, gradients change by −∇(·) ∇V and volumes by div V, so that at fixed nodal values of u¹::

    δ∫(Ψ + pJ) dV = ∫ (Ψ + pJ) div V − S:(∇u¹ ∇V) + Ψ_θ dV
    δS = −(A + p ∂cof F/∂F):(∇u¹ ∇V) + P_θ

with S = P + p cof F, and Ψ_θ, P_θ of the material. The slope R_θ of the residual and the sensitivities u_k of the
equilibrium to the loads give the mixed derivatives, W_θk = ∂²Π/∂θ∂k + R_θ·u_k. The displacement moves by
u_θ = −K⁻¹ R_θ.

At rest no stress acts. With D_k = δ_kH + ∇u_k and S_k = C:D_k + p_k I of the sensitivities u_k to the ten loads, where
p_k is 1 for the load p and 0 for all others::

    A_kl,θ = <q div V − S_l:(∇u_k ∇V) − S_k:(∇u_l ∇V) + D_k:C_θ:D_l>,  q = D_k:C:D_l + p_k tr D_l + p_l tr D_k
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.cell.contact.wall_contact import contact_slopes
from porocore.cell.equilibrium.discrete import (
    DiscreteSolid,
    ElementGradients,
    FactorisedTangent,
    Iterate,
    Sensitivities,
    element_gradients,
)
from porocore.cell.symmetry import UNIT_LOADS, classes, visible
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.states import Array, CellSlopes

#: Ψ_θ (M, q) and P_θ (M, q, 3, 3) at F (M, q, 3, 3).
MaterialSlopes = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class ExplicitDependence:
    """Explicit dependence of a discrete solid on one parameter.

    Attributes
    ----------
    velocity : (nodes, 3)
        V of the mesh, which preserves periodicity and mirrors; None where the parameter moves no node.
    material
        Slopes of Ψ and P by the parameter; None where the material does not depend on it.
    elasticity : (M or 1, 1, 3, 3, 3, 3)
        Slope of the material's elasticity at F = I, that of each element or of all; None where it is 0.
    log_penalty : float
        Slope of the logarithm of the penalty of contact times the length of its elements, as of Young's modulus.
    """

    velocity: Array | None = None
    material: MaterialSlopes | None = None
    elasticity: Array | None = None
    log_penalty: float = 0.0


def solid_slopes(
    problem: DiscreteSolid,
    factor: FactorisedTangent,
    answer: Sensitivities,
    dependences: Sequence[ExplicitDependence],
) -> tuple[CellSlopes, Array]:
    """Return the slopes at the equilibrium of ``factor``, the unshifted one of the class "" of even perturbations.

    The velocities keep the mirrors of the eighth, so that all slopes by other loads than those of this class vanish.

    Parameters
    ----------
    problem
        Solid.
    factor
        Factorised tangent.
    answer
        Sensitivities to all loads of the class, in their order.
    dependences
        Explicit dependence on each of the m parameters.

    Returns
    -------
    slopes
        One row, without the conductivity.
    displacement : (m, nodes, 3)
        u_θ, the slope of u¹ at the nodes, which move.

    Raises
    ------
    FactorError
        The factor cannot be applied.
    """
    columns, m = classes(problem.mesh)[""], len(dependences)
    point_values = PointValues(problem, factor.iterate)
    explicit = [_explicit(problem, point_values, dependence) for dependence in dependences]
    residuals = np.reshape([one.residual for one in explicit], (m, -1, 3))
    moved = -problem.solve_forces(factor, residuals)
    mixed = np.tensordot(answer.displacement, residuals, axes=([1, 2], [1, 2]))  # (k, m)
    second = np.zeros((10, m))
    second[list(columns)] = mixed
    direct = np.reshape([np.append(one.by_load, one.by_pressure) for one in explicit], (m, 10)).T
    second += direct
    seen, copies = visible(problem.mesh)[:, :, None], problem.copies
    grad = [
        point_values.gradients.integral(point_values.gradients.gradient(u)) + one.grad
        for u, one in zip(moved, explicit, strict=True)
    ]
    mean_grad = copies * seen * np.moveaxis(np.reshape(grad, (m, 3, 3)), 0, -1)
    slopes = CellSlopes(
        potential=copies * np.array([[one.energy for one in explicit]]),
        stress=(copies * seen * second[:9].reshape(3, 3, m))[None],
        fluid_volume=-copies * second[9:],
        porosity=-copies * np.array([[one.volume for one in explicit]]),
        mean_grad=mean_grad[None],
    )
    return slopes, moved


class PointValues:
    """Fields of one equilibrium at the quadrature points, shared by all parameters.

    Attributes
    ----------
    grad : (M, q, 3, 3)
        ∇u¹.
    F, cof : (M, q, 3, 3), J : (M, q)
        Deformation gradient, its cofactor and determinant.
    stress : (M, q, 3, 3), energy : (M, q)
        S = P + p cof F and Ψ + pJ.
    """

    def __init__(self, problem: DiscreteSolid, iterate: Iterate) -> None:
        self.iterate, self._material = iterate, problem.material
        self.gradients = element_gradients(problem.mesh, problem.degree)
        self.grad = self.gradients.gradient(iterate.displacement)
        self.F = self.grad + np.eye(3) + iterate.H
        self.cof, self.J = cofactor(self.F), determinant(self.F)
        self.stress = problem.material.stress(self.F) + iterate.p * self.cof
        self.energy = problem.material.energy_density(self.F) + iterate.p * self.J
        self._moduli: Array | None = None

    def stress_change(self, dF: Array) -> Array:
        """Return (A + p ∂cof F/∂F):δF (M, q, 3, 3) of δF (M, q, 3, 3)."""
        if self._moduli is None:
            moduli = self._material.tangent(self.F)
            if self.iterate.p:
                moduli = moduli + self.iterate.p * cofactor_tangent(self.F)
            self._moduli = np.ascontiguousarray(moduli.reshape(*self.J.shape, 9, 9))
        return np.asarray((self._moduli @ dF.reshape(*self.J.shape, 9, 1)).reshape(self.F.shape))


@dataclass(frozen=True, eq=False)
class _Explicit:
    """Slopes of the integrals over the domain at fixed nodal values of u¹, contact included."""

    energy: float  #: of Π
    volume: float  #: of the undeformed volume
    grad: Array  #: (3, 3)  of ∫ ∇u¹ dV
    by_load: Array  #: (9,)  of ∂Π/∂H
    by_pressure: float  #: of ∂Π/∂p
    residual: Array  #: (nodes, 3)  of ∂Π/∂u


def _explicit(problem: DiscreteSolid, at: PointValues, dependence: ExplicitDependence) -> _Explicit:
    gradients, iterate = at.gradients, at.iterate
    energy, grad = np.zeros_like(at.J), np.zeros_like(at.F)
    change, forces = np.zeros(at.F.shape), np.zeros(at.F.shape)
    volume, by_pressure = np.zeros_like(at.J), np.zeros_like(at.J)
    if dependence.velocity is not None:
        grad_V = gradients.gradient(dependence.velocity)
        volume = np.trace(grad_V, axis1=2, axis2=3)
        div = volume[:, :, None, None]
        turned = at.grad @ grad_V
        energy += at.energy * volume - (at.stress * turned).sum(axis=(2, 3))
        grad = at.grad * div - turned
        change += at.stress * div - at.stress_change(turned)
        forces -= at.stress @ grad_V.swapaxes(2, 3)
        by_pressure = at.J * volume - (at.cof * turned).sum(axis=(2, 3))
    if dependence.material is not None:
        energy_slope, stress_slope = dependence.material(at.F)
        energy += energy_slope
        change += stress_slope
    found = _Explicit(
        energy=float(gradients.integral(energy)),
        volume=float(gradients.integral(volume)),
        grad=gradients.integral(grad),
        by_load=gradients.integral(change).ravel(),
        by_pressure=float(gradients.integral(by_pressure)),
        residual=gradients.forces(change + forces),
    )
    if problem.contact is None or iterate.touching is None:
        return found
    points, V, F0 = problem.mesh.points, dependence.velocity, np.eye(3) + iterate.H
    of_contact, by_load, by_displacement = contact_slopes(
        problem.contact,
        iterate.touching,
        F0,
        points,
        np.zeros_like(points) if V is None else V,
        dependence.log_penalty,
    )
    return replace(
        found,
        energy=found.energy + of_contact,
        by_load=found.by_load + by_load.ravel(),
        residual=found.residual + by_displacement,
    )


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
