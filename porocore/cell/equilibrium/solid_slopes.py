"""Slopes of the averages of the solid by parameters of the cell, from the equilibrium and its sensitivities.

Only the explicit dependence on a parameter counts for W, since Π is stationary. With the velocity V of the mesh,
X → X + δθ V, gradients change by −∇(·) ∇V and volumes by div V, so that at fixed nodal values of u¹::

    δ∫(Ψ + pJ) dV = ∫ (Ψ + pJ) div V − S:(∇u¹ ∇V) + Ψ_θ dV
    δS = −(A + p ∂cof F/∂F):(∇u¹ ∇V) + P_θ

with S = P + p cof F, and Ψ_θ, P_θ of the material. The slope R_θ of the residual and the sensitivities u_k of the
equilibrium to the loads give the mixed derivatives, W_θk = ∂²Π/∂θ∂k + R_θ·u_k. The displacement moves by
u_θ = −K⁻¹ R_θ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.cell.contact.slopes import contact_slopes
from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorisedTangent, Iterate
from porocore.cell.equilibrium.element_gradients import element_gradients
from porocore.cell.equilibrium.integrals import Sensitivities
from porocore.cell.symmetry.parity import classes, visible
from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.states import Array

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


@dataclass(frozen=True, eq=False)
class SolidSlopes:
    """Slopes of the averages of one state by m parameters; as in a response, the parameter is the last index.

    Attributes
    ----------
    potential : (m,), stress : (3, 3, m), fluid_volume : (m,), porosity : (m,), mean_grad : (3, 3, m)
        Slopes of W, P_E, φ, of the porosity φ_f and of <∇u¹>_s.
    displacement : (nodes, 3, m)
        u_θ, the slope of u¹ at the nodes, which move.
    """

    potential: Array
    stress: Array
    fluid_volume: Array
    porosity: Array
    mean_grad: Array
    displacement: Array


def solid_slopes(
    problem: DiscreteSolid,
    factor: FactorisedTangent,
    answer: Sensitivities,
    dependences: Sequence[ExplicitDependence],
) -> SolidSlopes:
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
    return SolidSlopes(
        potential=copies * np.array([one.energy for one in explicit]),
        stress=copies * seen * second[:9].reshape(3, 3, m),
        fluid_volume=-copies * second[9],
        porosity=-copies * np.array([one.volume for one in explicit]),
        mean_grad=copies * seen * np.moveaxis(np.reshape(grad, (m, 3, 3)), 0, -1),
        displacement=np.moveaxis(moved, 0, -1),
    )


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
    return _with_contact(found, problem, iterate, dependence)


def _with_contact(
    found: _Explicit, problem: DiscreteSolid, iterate: Iterate, dependence: ExplicitDependence
) -> _Explicit:
    if problem.contact is None or iterate.touching is None:
        return found
    points = problem.mesh.points
    velocity = np.zeros_like(points) if dependence.velocity is None else dependence.velocity
    F0 = np.eye(3) + iterate.H
    of_contact = contact_slopes(
        problem.contact, iterate.touching, F0, points, velocity, dependence.log_penalty
    )
    return replace(
        found,
        energy=found.energy + of_contact.energy,
        by_load=found.by_load + of_contact.by_load.ravel(),
        residual=found.residual + of_contact.by_displacement,
    )
