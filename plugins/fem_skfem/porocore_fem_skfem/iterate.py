"""Iterates of the discrete solid with their kinematics, and factorised tangents at them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from porocore.cell.equilibrium.discrete import FactorisedTangent, Iterate
from porocore.core.tensors.cofactors import cofactor, determinant
from porocore.states import Array
from porocore_fem_skfem.constraints import Constraints

if TYPE_CHECKING:
    from porocore_fem_skfem.solid import SkfemSolid


class SkfemIterate(Iterate):
    """Iterate with its kinematics, shared by energy, residual and tangent.

    Attributes
    ----------
    u : (3, nodes)
        u¹, periodic nodes merged.
    F, cof : (3, 3, points)
        Deformation gradient and its cofactor.
    J : (points,)
        det F.
    """

    def __init__(self, problem: SkfemSolid, H: Array, p: float, u: Array) -> None:
        self.problem, self.H, self.p, self.u = problem, H, p, u
        self.contact = problem.contact
        self.F = problem.gradient(u) + (np.eye(3) + H)[:, :, None]
        view = np.moveaxis(self.F, -1, 0)
        self.J, self.cof = determinant(view), np.moveaxis(cofactor(view), 0, -1)

    @cached_property
    def stress(self) -> Array:
        """Stress P + p cof F (3, 3, points)."""
        return self.problem.response.stress(self)

    @cached_property
    def tangent(self) -> Array:
        """Upper triangle of ∂²Π/∂u² without contact, entries in the order of the scatter's pattern."""
        return self.problem.response.stiffness(self)

    @cached_property
    def energy(self) -> float:
        energy = float(self.problem.w @ (self.problem.response.energy_density(self) + self.p * self.J))
        return energy if self.touching is None else energy + self.touching.forces.energy

    @cached_property
    def residual(self) -> Array:
        forces = self.problem.assemble(self.stress)
        if self.touching is not None:
            n = len(self.problem.mesh.points)
            forces += self.problem.merged(self.touching.forces.by_displacement(n))
        return forces.ravel()[self.problem.constraints().free]

    @property
    def min_jacobian(self) -> float:
        return float(self.J.min())

    @property
    def displacement(self) -> Array:
        return self.u[:, self.problem.nodes].T


class SkfemTangentFactor(FactorisedTangent):
    """Factorised tangent of one parity class; factorised again if the class has factorised another since."""

    iterate: SkfemIterate

    def __init__(
        self, iterate: SkfemIterate, parity: str, shift: float, constraints: Constraints, entries: Array
    ) -> None:
        self.iterate, self.parity, self.shift = iterate, parity, shift
        self.constraints, self.entries = constraints, entries
        self.negative = constraints.factorise(entries)

    def solve(self, rhs: Array) -> Array:
        self.constraints.factorise(self.entries)
        return self.constraints.precondition(rhs)
