"""The fluid cell problem in UFL: Taylor–Hood elements, velocity and pressure solved for together."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from scipy import sparse

from porocore.cell.connectivity import joined_by_nodes
from porocore.cell.mesh import CellMesh
from porocore.cell.parity import held_pressures, held_velocities
from porocore.equilibrium.discrete import FactorError
from porocore.errors import PorocoreError
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.condensation import Condensation, to_petsc, to_scipy
from porocore_fem_dolfinx.linalg import SymmetricSolver

#: The rule must integrate p ∇·v of straight elements exactly; one degree more serves the curved ones.
QUADRATURE_DEGREE = 4


class StokesProblem:
    """∫ ∇w:∇v − p̃ ∇·v − q ∇·w = ∫ e_j·v on the eighth or the whole of the fluid, with unit viscosity."""

    def __init__(self, mesh: CellMesh) -> None:
        mesh = mesh.quadratic
        self.mesh = mesh
        domain = CellDomain(mesh, QUADRATURE_DEGREE)
        velocity, pressure = domain.lagrange(2, (3,)), domain.lagrange(1)
        w, v = ufl.TrialFunction(velocity), ufl.TestFunction(velocity)
        q = ufl.TestFunction(pressure)
        laplacian = compat.form(ufl.inner(ufl.grad(w), ufl.grad(v)) * domain.dx)
        divergence = compat.form(-q * ufl.div(w) * domain.dx)
        self._A = _taken(compat.assemble_matrix(laplacian))
        self._B = _taken(compat.assemble_matrix(divergence))
        force = compat.constant(domain.domain, np.zeros(3))
        load = compat.form(ufl.inner(force, v) * domain.dx)
        #: ∫ v_i for each unit vector e_i, (3, velocity dofs).
        self.loads = np.empty((3, self._A.shape[0]))
        for i in range(3):
            force.value[:] = np.eye(3)[i]
            self.loads[i] = compat.assemble_vector(load)
        self._velocity_node = domain.nodes_of(compat.cell_dofs(velocity.dofmap))
        self._pressure_node = domain.nodes_of(compat.cell_dofs(pressure.dofmap))
        self._part = joined_by_nodes(mesh)

    def flow(self, j: int) -> Any:
        """∫ w^j dV (3,) over the mesh under the unit force e_j.

        Raises
        ------
        PorocoreError
            The system cannot be solved.
        """
        periodic = self.mesh.periodic_class
        held = held_velocities(self.mesh, j)[self._velocity_node]
        images = 3 * periodic[self._velocity_node][:, None] + np.arange(3)
        velocity = Condensation(images.ravel(), held.ravel())
        held = held_pressures(self.mesh, j)[self._pressure_node]
        images = periodic[self._pressure_node]
        part = self._part[self._pressure_node]
        # Where nothing holds the pressure of a part of the fluid only its gradient acts.
        for free in np.setdiff1d(part, part[held]):
            held = held | (images == images[part == free][0])
        pressure = Condensation(images, held)
        B = pressure.T.T @ self._B @ velocity.T
        A = velocity.T.T @ self._A @ velocity.T
        w = _saddle_point(A, B, velocity.reduce(self.loads[j]))
        return self.loads @ velocity.expand(w)


def _saddle_point(A: Any, B: Any, f: Any) -> Any:
    """w of [A Bᵀ; B 0] (w, p) = (f, 0)."""
    n, m = len(f), B.shape[0]
    # A stored zero on the diagonal: PETSc's factorisations want to find one there.
    nothing = sparse.csr_matrix((np.zeros(m), (range(m), range(m))), (m, m))
    solver = SymmetricSolver("mumps", {}, n + m)
    try:
        solver.use(to_petsc(sparse.bmat([[A, B.T], [B, nothing]], "csr")))
        return solver.solve(np.concatenate([f, np.zeros(m)]))[:n]
    except FactorError as error:
        raise PorocoreError(
            f"the Stokes cell problem cannot be solved ({error}); refine the mesh (cell.mesh.fluid_size)"
        ) from error
    finally:
        solver.destroy()


def _taken(matrix: Any) -> Any:
    """As a scipy matrix; that of PETSc is freed, which dolfinx leaves to its caller."""
    copy = to_scipy(matrix)
    matrix.destroy()
    return copy


def flow(mesh: CellMesh) -> Any:
    """∫ w^j_i dV (3, 3) over the mesh, for unit viscosity."""
    problem = StokesProblem(mesh)
    return np.stack([problem.flow(j) for j in range(3)], axis=1)
