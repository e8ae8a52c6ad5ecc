"""The solid cell problem in UFL: the energy is written down, its derivatives are UFL's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import ufl

from porocore.cell.cell import Cell
from porocore.cell.mesh import CellMesh
from porocore.cell.parity import held_displacements
from porocore.equilibrium.discrete import (
    DiscreteSolid,
    FactorError,
    Iterate,
    Sensitivities,
    StepFailed,
    Sums,
)
from porocore.states import Status
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.condensation import Condensation
from porocore_fem_dolfinx.linalg import SymmetricSolver
from porocore_fem_dolfinx.material import energy_density

#: More iterations than this cost more than a new factor.
PATIENCE = 18


class State(Iterate):
    """u¹ as the values ``u`` of the function space's dofs, flat; everything else is computed when it is asked for."""

    def __init__(self, problem: SolidProblem, H: Any, p: float, u: Any) -> None:
        self.problem, self.H, self.p, self.u = problem, H, p, u

    @cached_property
    def values(self) -> Any:
        """∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""
        self.problem.load(self)
        return self.problem.domain.evaluate(self.problem.state_expression)

    @cached_property
    def energy(self) -> float:
        return self.problem.integral(self.values[:, :, 18] + self.p * self.values[:, :, 19])

    @cached_property
    def residual(self) -> Any:
        self.problem.load(self)
        return self.problem.free("").reduce(compat.assemble_vector(self.problem.residual_form))

    @property
    def min_jacobian(self) -> float:
        return float(self.values[:, :, 19].min())

    @property
    def displacement(self) -> Any:
        return self.problem.to_nodes(self.u)


class SolidProblem(DiscreteSolid):
    """Π and its derivatives on one mesh; compiled once, with H, p and the material's constants as constants."""

    def __init__(
        self, cell: Cell, mesh: CellMesh, *, degree: int, solver: str, petsc: Mapping[str, Any]
    ) -> None:
        self.mesh, self.material = mesh, cell.material
        self._solver, self._petsc = solver, petsc
        self.domain = CellDomain(mesh, degree)
        space = self.domain.lagrange(mesh.order, (3,))
        self._node = self.domain.nodes_of(compat.cell_dofs(space.dofmap))
        self._dof = np.argsort(self._node)
        self._function = compat.fem.Function(space)
        self._H = compat.constant(self.domain.domain, np.zeros((3, 3)))
        self._p = compat.constant(self.domain.domain, 0.0)
        self._dH = compat.constant(self.domain.domain, np.zeros((3, 3)))
        self._dp = compat.constant(self.domain.domain, 0.0)
        self._compile(space)
        self._free: dict[str, Condensation] = {}
        self._solvers: dict[str, SymmetricSolver] = {}
        self._loaded: State | None = None
        self._base: SymmetricSolver | None = None
        self._kept: SymmetricSolver | None = None
        self._full: Any = None
        self._full_of: State | None = None

    def _compile(self, space: Any) -> None:
        domain, dx = self.domain, self.domain.dx
        v = ufl.TestFunction(space)
        grad_u = ufl.grad(self._function)
        F = ufl.variable(ufl.Identity(3) + self._H + grad_u)
        J = ufl.det(F)
        energy = energy_density(self.material, F, domain.domain)
        stress = ufl.diff(energy + self._p * J, F)
        cofactor = ufl.diff(J, F)
        i, j, k, m = ufl.indices(4)
        change = ufl.as_tensor(ufl.diff(stress, F)[i, j, k, m] * self._dH[k, m], (i, j)) + self._dp * cofactor
        self.residual_form = compat.form(ufl.inner(stress, ufl.grad(v)) * dx)
        self._tangent_form = compat.form(
            ufl.derivative(ufl.inner(stress, ufl.grad(v)) * dx, self._function, ufl.TrialFunction(space))
        )
        self._change_form = compat.form(ufl.inner(change, ufl.grad(v)) * dx)
        self._mean_form = compat.form(ufl.inner(self._dH, ufl.grad(v)) * dx)
        self.state_expression = domain.expression(ufl.as_vector([*_flat(grad_u), *_flat(stress), energy, J]))
        self._change_expression = domain.expression(ufl.as_vector(_flat(change)))

    # ---- what a state is ------------------------------------------------------------------------

    def load(self, here: State) -> None:
        """Put a state into the function and the constants that the forms refer to."""
        if self._loaded is not here:
            self._function.x.array[:] = here.u
            self._H.value[...] = here.H
            self._p.value = here.p
            self._loaded = here

    def to_nodes(self, u: Any) -> Any:
        """(nodes, 3) in the order of the mesh, of values at the dofs."""
        return u.reshape(-1, 3)[self._dof]

    def integral(self, values: Any) -> Any:
        """∫ over the domain of values (cells, q, ...)."""
        return np.tensordot(self.domain.weights, values, axes=2)

    def free(self, odd: str) -> Condensation:
        """The free unknowns of a class of perturbations."""
        if odd not in self._free:
            images = 3 * self.mesh.periodic_class[self._node][:, None] + np.arange(3)
            held = held_displacements(self.mesh, odd)[self._node]
            self._free[odd] = Condensation(images.ravel(), held.ravel())
        return self._free[odd]

    # ---- the discrete solid ---------------------------------------------------------------------

    def iterate(self, H: Any, p: float, displacement: Any = None) -> State:
        u = np.zeros((len(self.mesh.points), 3)) if displacement is None else displacement
        return State(self, H, p, np.ascontiguousarray(u[self._node]).ravel())

    def moved(self, here: Any, change: Any, H: Any, p: float) -> State:
        return State(self, H, p, here.u + self.free("").expand(change))

    def force_scale(self, here: Any) -> float:
        size = np.linalg.norm(here.values[:, :, 9:18], axis=2)
        size = np.maximum(size, 1e-3 * self.material.mu) * self.domain.weights
        # ∇N is about the inverse of the length of an element.
        length = np.cbrt(6 * self.domain.weights.sum(axis=1))
        forces = np.repeat(size.sum(axis=1) / length, 3 * len(self._cell_nodes[0]))
        nodes = 3 * self._cell_nodes[:, :, None] + np.arange(3)
        nodal = np.bincount(nodes.ravel(), forces, minlength=3 * len(self._node))
        return float(np.linalg.norm(self.free("").restrict(nodal)))

    @cached_property
    def _cell_nodes(self) -> Any:
        return compat.cell_dofs(self._function.function_space.dofmap)

    def load_change(self, here: Any, dH: Any, dp: float) -> Any:
        self.load(here)
        return self.free("").reduce(self._load_vector(dH, dp))

    def _load_vector(self, dH: Any, dp: float) -> Any:
        self._dH.value[...] = dH
        self._dp.value = dp
        return compat.assemble_vector(self._change_form)

    def begin(self) -> None:
        self._kept = None

    def _kept_factor(self) -> SymmetricSolver:
        """The factor made last on this path, at first the undeformed cell's, which is made only once."""
        if self._kept is None:
            if self._base is None:
                self._base = SymmetricSolver(self._solver, self._petsc, self.free("").size)
                self._base.use(self._matrix(self.iterate(np.zeros((3, 3)), 0.0), ""))
            self._kept = self._base
        return self._kept

    def solve(self, here: Any, rhs: Any, accuracy: float) -> Any:
        try:
            kept = self._kept_factor()
            if kept.is_factor:
                x = kept.iterate(self._matrix(here, ""), rhs, accuracy, PATIENCE)
                if x is not None:
                    return x
            if self._factor(here, "", accuracy) <= 0:
                try:
                    return self._solvers[""].solve(rhs)
                except FactorError:
                    if self._solvers[""].negative <= 0:
                        raise
            return self._shifted(here, rhs)
        except FactorError as error:
            raise StepFailed(Status.not_converged) from error

    def _matrix(self, here: State, odd: str) -> Any:
        """The tangent for the free unknowns of a class; the next call for this class changes it."""
        if self._full_of is not here:
            self.load(here)
            self._full = compat.assemble_matrix(self._tangent_form, self._full)
            self._full_of = here
        return self.free(odd).matrix(self._full)

    def _factor(self, here: State, odd: str, accuracy: float = 1e-12, shift: float = 0.0) -> int:
        """Make the tangent of a class, with ``shift`` added to its diagonal, the solver's; its negative pivots."""
        matrix = self._matrix(here, odd)
        if shift:
            matrix.shift(shift * float(np.abs(matrix.getDiagonal().array).mean()))
        if odd not in self._solvers:
            self._solvers[odd] = SymmetricSolver(self._solver, self._petsc, self.free(odd).size)
        solver = self._solvers[odd]
        if not odd:
            self._kept = None  # should the factorisation break down, what is left of it must not be used
        solver.use(matrix, accuracy)
        if not odd:
            self._kept = solver
        return solver.negative

    def _shifted(self, here: State, rhs: Any) -> Any:
        shift = 1e-3
        while shift < 10:
            if self._factor(here, "", shift=shift) <= 0:
                try:
                    x = self._solvers[""].solve(rhs)
                except FactorError:
                    x = -rhs
                if x @ rhs > 0:
                    return x
            shift *= 4
        raise StepFailed(Status.not_converged)

    def negative_pivots(self, here: Any, odd: str) -> int:
        return self._factor(here, odd)

    def sums(self, here: Any) -> Sums:
        total = self.integral(here.values)
        return Sums(
            grad=total[:9].reshape(3, 3),
            stress=total[9:18].reshape(3, 3),
            volume=float(total[19]),
            energy=float(total[18]),
            largest_grad=np.abs(here.values[:, :, :9]).max(axis=(0, 1)).reshape(3, 3),
            largest_energy=float(here.values[:, :, 18].max()),
        )

    def sensitivities(self, here: Any, odd: str, columns: Sequence[int]) -> Sensitivities:
        self.load(here)
        condensation, solver = self.free(odd), self._solvers[odd]
        R, explicit = [], []
        for column in columns:
            unit = np.zeros(10)
            unit[column] = 1.0
            R.append(condensation.reduce(self._load_vector(unit[:9].reshape(3, 3), unit[9])))
            explicit.append(self.integral(self.domain.evaluate(self._change_expression)))
        U, indefinite = [], False
        for r in R:
            try:
                U.append(-solver.solve(r))
            except FactorError:
                U.append(np.full(condensation.size, np.nan))
                indefinite = indefinite or solver.negative > 0
        grad = np.array([[g @ condensation.expand(u) for g in self._mean_vectors] for u in U])
        # ∂²Π/∂θ∂θ' at fixed u¹; Π is linear in p.
        direct = [
            [explicit[a][j] if j < 9 else (explicit[b][i] if i < 9 else 0.0) for b, j in enumerate(columns)]
            for a, i in enumerate(columns)
        ]
        return Sensitivities(
            grad.reshape(-1, 3, 3), np.array(direct) + np.array(R) @ np.array(U).T, indefinite
        )

    @cached_property
    def _mean_vectors(self) -> list[Any]:
        """g with g·u = ∫ ∂u_i/∂Y_j dV, for each (i, j)."""
        vectors = []
        for unit in np.eye(9).reshape(9, 3, 3):
            self._dH.value[...] = unit
            vectors.append(compat.assemble_vector(self._mean_form))
        return vectors


def _flat(tensor: Any) -> list[Any]:
    return [tensor[i, j] for i in range(3) for j in range(3)]
