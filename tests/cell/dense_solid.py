"""A made-up third backend of the solid: linear tetrahedra in dense numpy, with one slot for all its factors."""

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from porocore.cell.equilibrium.discrete import (
    DiscreteSolid,
    DomainIntegrals,
    FactorisedTangent,
    Iterate,
    LoadStepFailed,
    Sensitivities,
    second_derivatives,
)
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.symmetry import UNIT_LOADS, held_displacements
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.states import Status


class DenseIterate(Iterate):
    def __init__(self, solid, H, p, u):
        self.solid, self.H, self.p, self.u = solid, H, p, u
        self.F = np.eye(3) + H + np.einsum("eai,eaj->eij", u[solid.mesh.cells], solid.grad_N)
        self.stress = solid.material.stress(self.F) + p * cofactor(self.F)
        self.moduli = solid.material.tangent(self.F) + p * cofactor_tangent(self.F)

    @property
    def energy(self):
        return self.solid.volumes @ (
            self.solid.material.energy_density(self.F) + self.p * determinant(self.F)
        )

    @property
    def residual(self):
        return self.solid.forces(self.stress, "")

    @property
    def min_jacobian(self):
        return determinant(self.F).min()

    @property
    def displacement(self):
        return self.u


class DenseFactor(FactorisedTangent):
    """A factor in the one slot of its solid; displaced, it is computed again."""

    def __init__(self, solid, iterate, parity, shift):
        self.solid, self.iterate, self.parity, self.shift = solid, iterate, parity, shift
        self.negative = self.store()

    def store(self):
        K = self.solid.shifted(self.iterate, self.parity, self.shift)
        self.solid.slot = self, lu_factor(K)
        return int((np.linalg.eigvalsh(K) < 0).sum())

    def solve(self, rhs):
        if self.solid.slot[0] is not self:
            self.solid.displaced += 1
            self.store()
        return lu_solve(self.solid.slot[1], rhs)


class StaleFactor(DenseFactor):
    """A wrong one: it applies whatever the slot holds."""

    def solve(self, rhs):
        return lu_solve(self.solid.slot[1], rhs)


class DenseSolid(DiscreteSolid):
    """Π on the eighth of a cell, without contact."""

    kind_of_factor = DenseFactor

    def __init__(self, mesh, material):
        self.mesh, self.material, self.degree = mesh, material, 1
        edges = mesh.points[mesh.cells[:, 1:]] - mesh.points[mesh.cells[:, :1]]
        inner = np.linalg.inv(edges).swapaxes(1, 2)
        self.grad_N = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
        self.volumes = np.linalg.det(edges) / 6
        self.slot, self.displaced = (None, None), 0

    def free(self, parity):
        return ~held_displacements(self.mesh, parity).ravel()

    def forces(self, stress, parity):
        nodal = np.zeros_like(self.mesh.points)
        np.add.at(nodal, self.mesh.cells, np.einsum("e,eij,eaj->eai", self.volumes, stress, self.grad_N))
        return self.reduced(nodal, parity)

    def stress_change(self, iterate, dH, dp):
        return np.einsum("eijkl,kl->eij", iterate.moduli, dH) + dp * cofactor(iterate.F)

    def shifted(self, iterate, parity, shift):
        K = self.tangent(iterate, parity)
        return K - shift * np.diag(self.masses(parity)) if shift else K

    def iterate_at(self, H, p, displacement=None):
        return DenseIterate(
            self, H, p, np.zeros_like(self.mesh.points) if displacement is None else displacement
        )

    def moved(self, iterate, change, H, p):
        return DenseIterate(self, H, p, iterate.u + self.expanded(change, ""))

    def force_scale(self, iterate):
        size = np.maximum(np.linalg.norm(iterate.stress, axis=(1, 2)), 1e-3)
        return np.sqrt(((size * self.volumes)[:, None] ** 2 * (self.grad_N**2).sum(axis=2)).sum())

    def load_change(self, iterate, dH, dp):
        return self.forces(self.stress_change(iterate, dH, dp), "")

    def solve(self, iterate, rhs, accuracy):
        factor = self.factor(iterate, "")
        if factor.negative:
            raise LoadStepFailed(Status.not_converged)
        return factor.solve(rhs)

    def factor(self, iterate, parity, shift=0.0):
        return self.kind_of_factor(self, iterate, parity, shift)

    def release(self, parity):
        self.slot = None, None

    def tangent(self, iterate, parity):
        n, free = self.mesh.points.size, self.free(parity)
        blocks = np.einsum("e,eaj,eijkl,ebl->eaibk", self.volumes, self.grad_N, iterate.moduli, self.grad_N)
        places = (3 * self.mesh.cells[:, :, None] + np.arange(3)).reshape(-1, 12)
        K = np.zeros((n, n))
        np.add.at(K, (places[:, :, None], places[:, None]), blocks.reshape(-1, 12, 12))
        return K[np.ix_(free, free)]

    def reduced(self, values, parity):
        return values.ravel()[self.free(parity)]

    def expanded(self, x, parity):
        field = np.zeros(self.mesh.points.size)
        field[self.free(parity)] = x
        return field.reshape(-1, 3)

    def gradient(self, u):
        return np.einsum("eai,eaj->eij", u[self.mesh.cells], self.grad_N)

    def integrals(self, iterate):
        grad, energy = self.gradient(iterate.u), self.material.energy_density(iterate.F)
        return DomainIntegrals(
            grad=np.einsum("e,eij->ij", self.volumes, grad),
            stress=np.einsum("e,eij->ij", self.volumes, iterate.stress),
            volume=float(self.volumes @ determinant(iterate.F)),
            energy=float(self.volumes @ energy),
            largest_grad=np.abs(grad).max(axis=0),
            largest_energy=float(energy.max()),
        )

    def sensitivities(self, factor, columns):
        changes = [self.stress_change(factor.iterate, UNIT_LOADS[c], float(c == 9)) for c in columns]
        R = np.stack([self.forces(change, factor.parity) for change in changes], axis=1)
        U = -factor.solve(R)
        displacement = np.stack([self.expanded(u, factor.parity) for u in U.T])
        direct = np.stack([np.einsum("e,eij->ij", self.volumes, change).ravel() for change in changes])
        grad = np.stack([np.einsum("e,eij->ij", self.volumes, self.gradient(u)) for u in displacement])
        return Sensitivities(displacement, grad, second_derivatives(columns, direct) + R.T @ U)


class DenseCellSolver(EquilibriumCellSolver):
    """A cell solver without a fluid."""

    def solid(self, cell, mesh):
        return DenseSolid(mesh, cell.solid.on(mesh))

    def fluid(self, mesh):
        raise NotImplementedError
