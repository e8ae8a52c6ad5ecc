"""The discrete fluid in UFL: Stokes flow on Taylor–Hood elements, one saddle-point system."""

from __future__ import annotations

import numpy as np
import ufl
from petsc4py import PETSc
from scipy import sparse

from porocore.cell.conductivity.pore import DiscreteFluid, FlowFields
from porocore.cell.meshing.connectivity import joined_by_nodes
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry import held_pressures, held_velocities
from porocore.states import Array
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain, Condensation, to_petsc, to_scipy
from porocore_fem_dolfinx.linalg import SymmetricSolver

#: The rule must integrate p ∇·v of straight elements exactly; one degree more serves the curved ones.
QUADRATURE_DEGREE = 4


class DolfinxStokes(DiscreteFluid):
    """Stokes problem ∫ ∇w:∇v − p̃ ∇·v − q ∇·w = ∫ e_j·v of unit viscosity on the eighth or the whole fluid."""

    def __init__(self, mesh: CellMesh) -> None:
        self.mesh = mesh = mesh.quadratic
        self._domain = domain = CellDomain(mesh, QUADRATURE_DEGREE)
        velocity, pressure = domain.lagrange(2, (3,)), domain.lagrange(1)
        w, v = ufl.TrialFunction(velocity), ufl.TestFunction(velocity)
        q = ufl.TestFunction(pressure)
        self._laplacian = compat.form(ufl.inner(ufl.grad(w), ufl.grad(v)) * domain.dx)
        self._divergence = compat.form(-q * ufl.div(w) * domain.dx)
        self._force = compat.constant(domain.domain, np.zeros(3))
        self._load = compat.form(ufl.inner(self._force, v) * domain.dx)
        self._velocity_node = velocity_node = domain.nodes_of(compat.cell_dofs(velocity.dofmap))
        self._pressure_node = pressure_node = domain.nodes_of(compat.cell_dofs(pressure.dofmap))
        part = joined_by_nodes(mesh)[pressure_node]
        #: Forces whose flows vanish at the same places, and the free unknowns of these flows.
        self._classes: list[tuple[list[int], Condensation, Condensation]] = []
        alike: dict[bytes, list[int]] = {}
        for j in range(3):
            pattern = held_velocities(mesh, j).tobytes() + held_pressures(mesh, j).tobytes()
            alike.setdefault(pattern, []).append(j)
        for members in alike.values():
            images = 3 * mesh.periodic_class[velocity_node][:, None] + np.arange(3)
            free = Condensation(images.ravel(), held_velocities(mesh, members[0])[velocity_node].ravel())
            images = mesh.periodic_class[pressure_node]
            held = held_pressures(mesh, members[0])[pressure_node]
            # Where nothing holds the pressure of a part of the fluid only its gradient acts.
            for loose in np.setdiff1d(part, part[held]):
                held = held | (images == images[part == loose][0])
            self._classes.append((members, free, Condensation(images, held)))

    def integrals(self, points: Array) -> Array:
        return self.fields(points).integrals

    def fields(self, points: Array) -> FlowFields:
        self._domain.move(points)
        A = _into_scipy(compat.assemble_matrix(self._laplacian))
        B = _into_scipy(compat.assemble_matrix(self._divergence))
        loads = np.empty((3, A.shape[0]))
        for i in range(3):
            self._force.value[:] = np.eye(3)[i]
            loads[i] = compat.assemble_vector(self._load)
        n, integrals = len(self.mesh.points), np.zeros((3, 3))
        velocities, pressures = np.zeros((n, 3, 3)), np.zeros((n, 3))
        for members, velocity, pressure in self._classes:
            condensed = velocity.T.T @ A @ velocity.T, pressure.T.T @ B @ velocity.T
            flows = _saddle_point(*condensed, [velocity.reduce(loads[j]) for j in members])
            for j, (w, p) in zip(members, flows, strict=True):
                flow = velocity.expand(w)
                integrals[:, j] = loads @ flow
                velocities[self._velocity_node, :, j] = flow.reshape(-1, 3)
                pressures[self._pressure_node, j] = pressure.expand(p)
        return FlowFields(velocities, pressures, integrals)


def _saddle_point(
    A: sparse.csr_matrix, B: sparse.csr_matrix, loads: list[Array]
) -> list[tuple[Array, Array]]:
    """Return w and p of [A Bᵀ; B 0] (w, p) = (f, 0) for each f."""
    n, m = A.shape[0], B.shape[0]
    # A stored zero on the diagonal: PETSc's factorisations want to find one there.
    nothing = sparse.csr_matrix((np.zeros(m), (range(m), range(m))), (m, m))
    solver = SymmetricSolver("mumps", {}, n + m)
    matrix = to_petsc(sparse.bmat([[A, B.T], [B, nothing]], "csr"))
    try:
        solver.use(matrix)
        solved = [solver.solve(np.concatenate([f, np.zeros(m)])) for f in loads]
        return [(x[:n], x[n:]) for x in solved]
    finally:
        solver.destroy()
        matrix.destroy()


def _into_scipy(matrix: PETSc.Mat) -> sparse.csr_matrix:
    """Return a scipy matrix, and free that of PETSc, which dolfinx leaves to its caller."""
    copy = to_scipy(matrix)
    matrix.destroy()
    return copy
