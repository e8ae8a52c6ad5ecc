"""The discrete solid of a cell (SkfemSolid), its iterates and factorised tangents.

Arrays at quadrature points are component-first, (3, 3, points).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy import sparse

from porocore.cell.contact.wall_contact import ContactModel
from porocore.cell.equilibrium.discrete import (
    DiscreteSolid,
    DomainIntegrals,
    FactorisedTangent,
    Iterate,
    Sensitivities,
    load_basis,
    second_derivatives,
)
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry import UNIT_LOADS, held_displacements
from porocore.core.tensors import cofactor, determinant
from porocore.states import Array, IntArray
from porocore_fem_skfem.constraints import Constraints, Widenings
from porocore_fem_skfem.iterative import IterativeConstraints
from porocore_fem_skfem.linalg import choice_in_words, iterates
from porocore_fem_skfem.node_grid import NodeGrid, node_grid
from porocore_fem_skfem.operators import Operators, Scatter
from porocore_fem_skfem.response import GeneralResponse, NeoHookeanResponse, SolidResponse


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


#: Nodes up to which the undeformed iterate is kept with its tangent, a sixteenth of a solve from rest; 20 MB at 26,000.
MOST_AT_REST = 100_000


class SkfemSolid(DiscreteSolid[SkfemIterate, SkfemTangentFactor]):
    """Solid by batched numpy assembly on scikit-fem's elements; its factor is kept from load to load."""

    def __init__(
        self,
        mesh: CellMesh,
        material: StrainEnergy,
        *,
        degree: int,
        solver: str,
        contact: ContactModel | None = None,
    ) -> None:
        self.mesh, self.material, self.solver = mesh, material, solver
        self.degree, self.contact = degree, contact
        self.nodes = mesh.periodic_class
        self.n_nodes = int(self.nodes.max()) + 1
        self.operators = Operators(mesh, degree, self.nodes[mesh.cells])
        self.B = self.operators.gradient(self.n_nodes)
        self.B_T = self.B.T.tocsr()
        self.w = self.operators.weights
        #: ∫ ∂N/∂Y_j dV, (nodes, 3).
        self.grad_weights = self.B_T @ np.kron(np.eye(3), self.w).T
        self.scatter = Scatter(self.operators.cells, self.n_nodes, 3)
        self.response: SolidResponse = (
            NeoHookeanResponse(material, self.operators, self.scatter)
            if isinstance(material, NeoHookean)
            else GeneralResponse(material, self.operators, self.scatter)
        )
        self._least_stress = 1e-3 * material.mean_moduli()[1]
        self._constraints: dict[str, Constraints] = {}
        self._widenings = Widenings(self.scatter.pattern)

    # ---- constraints ----------------------------------------------------------------------------

    def constraints(self, parity: str = "") -> Constraints:
        """Return the free unknowns of fields that are odd under the mirrors of the named axes (eighth only)."""
        if parity not in self._constraints:
            fixed = np.zeros((3, self.n_nodes), dtype=bool)
            fixed[:, self.nodes] = held_displacements(self.mesh, parity).T
            free = np.flatnonzero(~fixed.ravel())
            kind = IterativeConstraints if iterates(len(free), self.solver) else Constraints
            self._constraints[parity] = kind(self.scatter.pattern, free, self._grid(free), self.solver)
        return self._constraints[parity]

    def _grid(self, free: IntArray) -> NodeGrid:
        component, node = np.divmod(free, self.n_nodes)
        return node_grid(self.mesh, 3 * node + component, 3)

    def reset(self) -> None:
        """Discard the factors of the last solve and the pattern of its contact."""
        self._widenings.reset()
        self.constraints().reset(lambda: self.iterate_at(self.unstressed, 0.0).tangent)

    # ---- the discrete solid ---------------------------------------------------------------------

    def iterate_at(self, H: Array, p: float, displacement: Array | None = None) -> SkfemIterate:
        if (
            displacement is None
            and p == 0
            and np.array_equal(H, self.unstressed)
            and self.n_nodes <= MOST_AT_REST
        ):
            return self._at_rest
        u = np.zeros((3, self.n_nodes))
        if displacement is not None:
            u[:, self.nodes] = displacement.T
        return SkfemIterate(self, H, p, u)

    @cached_property
    def _at_rest(self) -> SkfemIterate:
        return SkfemIterate(self, self.unstressed, 0.0, np.zeros((3, self.n_nodes)))

    def moved(self, iterate: SkfemIterate, change: Array, H: Array, p: float) -> SkfemIterate:
        return SkfemIterate(self, H, p, iterate.u + self.field(change))

    def force_scale(self, iterate: SkfemIterate) -> float:
        size = np.sqrt((iterate.stress * iterate.stress).sum(axis=(0, 1)))
        size = np.maximum(size, self._least_stress) * self.w
        nodal = abs(self.B_T) @ np.tile(size, 3)
        return float(np.linalg.norm((np.tile(nodal, 3) / 3)[self.constraints().free]))

    def load_change(self, iterate: SkfemIterate, dH: Array, dp: float) -> Array:
        change = self.response.tangent_apply(iterate, dH[:, :, None]) + dp * iterate.cof
        return self._load_vector(iterate, "", change, dH).ravel()[self.constraints().free]

    def _load_vector(self, iterate: SkfemIterate, parity: str, stress: Array, dH: Array) -> Array:
        """Return the change of the forces (3, nodes) by that of the stress under a load, and of contact."""
        forces = self.assemble(stress)
        if iterate.touching is not None:
            forces += self.merged(iterate.touching.blocks(parity).load_change(len(self.mesh.points), dH))
        return forces

    def solve(self, iterate: SkfemIterate, rhs: Array, accuracy: float) -> Array:
        constraints, entries = self.system(iterate, "")
        return constraints.direction(entries, rhs, accuracy)

    def factor(self, iterate: SkfemIterate, parity: str, shift: float = 0.0) -> SkfemTangentFactor:
        constraints, entries = self.system(iterate, parity)
        if shift:
            entries[constraints.diagonal] -= shift * self.masses(parity)
        return SkfemTangentFactor(iterate, parity, shift, constraints, entries)

    @property
    def choice(self) -> str:
        constraints = self.constraints()
        iteration = "conjugate gradients" if isinstance(constraints, IterativeConstraints) else ""
        return choice_in_words(len(constraints.free), self.solver, iteration)

    def negative_eigenvalues(self, factor: SkfemTangentFactor) -> int:
        constraints = factor.constraints
        if factor.negative < 0 and isinstance(constraints, IterativeConstraints):
            return constraints.negative(factor.entries)
        return factor.negative

    def release(self, parity: str) -> None:
        self._constraints.pop(parity, None)
        self._widenings.release(parity)

    def tangent(self, iterate: SkfemIterate, parity: str) -> sparse.csr_matrix:
        constraints, entries = self.system(iterate, parity)
        return constraints.pattern.full(entries)

    def reduced(self, values: Array, parity: str) -> Array:
        return self.merged(values).ravel()[self.constraints(parity).free]

    def expanded(self, x: Array, parity: str) -> Array:
        return self.field(x, parity)[:, self.nodes].T

    def integrals(self, iterate: SkfemIterate) -> DomainIntegrals:
        grad = iterate.F - (np.eye(3) + iterate.H)[:, :, None]
        energy = self.response.energy_density(iterate)
        return DomainIntegrals(
            grad=grad @ self.w,
            stress=iterate.stress @ self.w,
            volume=float(self.w @ iterate.J),
            energy=float(self.w @ energy),
            largest_grad=np.abs(grad).max(axis=2),
            largest_energy=float(energy.max()),
        )

    def sensitivities(self, factor: SkfemTangentFactor, columns: Sequence[int]) -> Sensitivities:
        iterate, parity, constraints = factor.iterate, factor.parity, factor.constraints
        # ∂(P + p cof F)/∂θ at fixed u¹
        loads = [
            iterate.cof
            if column == 9
            else self.response.tangent_apply(iterate, UNIT_LOADS[column][..., None])
            for column in columns
        ]
        forces = [
            self._load_vector(iterate, parity, load, UNIT_LOADS[column])
            for load, column in zip(loads, columns, strict=True)
        ]
        R = np.stack([force.ravel()[constraints.free] for force in forces], axis=1)
        basis = load_basis(iterate.H, columns)
        turned = [(spin @ iterate.u).ravel()[constraints.free] for spin in basis.spins]
        known = np.reshape(turned, (-1, len(constraints.free))).T
        solved = constraints.sensitivities(factor.entries, R @ basis.loads, known)
        back = np.linalg.inv(basis.loads)
        direct = second_derivatives(columns, np.stack([(load @ self.w).ravel() for load in loads]))
        fields = [self.field(u, parity) for u in (solved.U @ back).T]
        grad = np.stack([field @ self.grad_weights for field in fields])
        displacement = np.stack([field[:, self.nodes].T for field in fields])
        return Sensitivities(displacement, grad, direct + back.T @ solved.curvature @ back, solved.negative)

    def solve_forces(self, factor: SkfemTangentFactor, forces: Array) -> Array:
        residuals = np.stack([-self.reduced(force, factor.parity) for force in forces], axis=1)
        none = np.zeros((len(residuals), 0))
        solved = factor.constraints.sensitivities(factor.entries, residuals, none)
        return np.stack([self.expanded(x, factor.parity) for x in solved.U.T])

    def merged(self, values: Array) -> Array:
        """Return the sums (3, nodes) over periodic nodes of values (nodes of the mesh, 3)."""
        return np.stack([np.bincount(self.nodes, column, self.n_nodes) for column in values.T])

    def system(self, iterate: SkfemIterate, parity: str) -> tuple[Constraints, Array]:
        """Return the constraints of a class and the entries of its ∂²Π/∂u².

        Walls that touch couple unknowns that share no element, so contact may widen the pattern.
        """
        constraints = self.constraints(parity)
        if iterate.touching is None:
            return constraints, constraints.restrict(iterate.tangent)
        rows, columns, values = iterate.touching.blocks(parity).entries
        rows, columns = (i % 3 * self.n_nodes + self.nodes[i // 3] for i in (rows, columns))
        places = self.scatter.pattern
        keys, upper = places.upper(rows, columns)
        wide = self._widenings.add(parity, keys, constraints)
        if wide is not None:
            return wide.constraints, wide.entries(iterate.tangent, keys, values[upper])
        return constraints, constraints.restrict(iterate.tangent + places.sum(keys, values[upper]))

    def field(self, values: Array, parity: str = "") -> Array:
        """Return the field (3, nodes) of the free unknowns of a class."""
        field = np.zeros(3 * self.n_nodes)
        field[self.constraints(parity).free] = values
        return field.reshape(3, -1)

    # ---- physics --------------------------------------------------------------------------------

    def gradient(self, u: Array) -> Array:
        """Return ∂u_i/∂Y_j (3, 3, points) of u (3, nodes)."""
        n = self.operators.n_points
        return np.stack([(self.B @ u_i).reshape(3, n) for u_i in u])

    def assemble(self, stress: Array) -> Array:
        """Return ∫ S:∇v (3, nodes) for all nodal v, of S (3, 3, points)."""
        weighted = (stress * self.w).reshape(3, -1)
        return np.stack([self.B_T @ row for row in weighted])
