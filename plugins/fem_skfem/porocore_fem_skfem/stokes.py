"""The fluid cell problem: Stokes flow through the undeformed pore under unit forces.

Quadratic velocity and linear pressure (Taylor–Hood, inf–sup stable). The velocity components do not couple,
so the Schur complement of the pressure is solved by conjugate gradients with one Laplacian factor for
each set of constraints; every solver that does elasticity does this too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from porocore.cell.mesh import CellMesh
from porocore.cell.parity import held_pressures, held_velocities
from porocore.errors import PorocoreError
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients
from porocore_fem_skfem.operators import Operators, Scatter

TOLERANCE = 1e-9


class StokesProblem:
    """Discrete Stokes problem with unit viscosity on the eighth or the whole of the fluid."""

    def __init__(self, mesh: CellMesh, solver: str) -> None:
        mesh = mesh.quadratic
        self.mesh, self.solver = mesh, solver
        nodes = mesh.periodic_class
        self.n = int(nodes.max()) + 1
        velocity = Operators(mesh, 4, nodes[mesh.cells])
        pressure = Operators(mesh, 4, nodes[mesh.cells[:, :4]])
        self.w = velocity.weights
        B = velocity.gradient(self.n)
        e, q = velocity.grad_N.shape[:2]
        points = np.arange(e * q).reshape(e, q)
        corners, first, inverse = np.unique(pressure.cells, return_index=True, return_inverse=True)
        # Pressure basis values at the points, one column for each corner node.
        N = sparse.csr_matrix(
            (
                np.tile(pressure.values.T, (e, 1)).ravel(),
                (np.repeat(points.ravel(), 4), np.repeat(inverse.reshape(e, 4), q, axis=0).ravel()),
            ),
            shape=(e * q, len(corners)),
        )
        weighted = sparse.diags(self.w) @ N
        #: ∫ ψ ∂v/∂Y_j, one (pressures, nodes) matrix for each j.
        self.divergence = [(weighted.T @ B[j * e * q : (j + 1) * e * q]).tocsr() for j in range(3)]
        self.pressure_mass = np.asarray(weighted.sum(axis=0)).ravel()
        self.load = self._integrals(velocity)
        grad = velocity.grad_N.transpose(0, 2, 1, 3).reshape(e, -1, q * 3)
        blocks = np.matmul(grad * np.repeat(self.w.reshape(e, 1, q), 3, axis=2), grad.transpose(0, 2, 1))
        self.scatter = Scatter(velocity.cells, self.n)
        self.laplacian = self.scatter(blocks)
        self._inverses: dict[bytes, Any] = {}
        #: A mesh node of each pressure unknown.
        self._pressure_nodes = mesh.cells[:, :4].ravel()[first]

    def _integrals(self, velocity: Operators) -> Any:
        """∫ N_a for each velocity node."""
        e, q = velocity.grad_N.shape[:2]
        contributions = self.w.reshape(e, q) @ velocity.values.T
        return np.bincount(velocity.cells.ravel(), contributions.ravel(), minlength=self.n)

    def inverse(self, held: Any) -> Any:
        """x ↦ A⁻¹ x for a velocity component that vanishes at the nodes in ``held`` (mesh nodes,)."""
        if held.tobytes() not in self._inverses:
            free = np.setdiff1d(np.arange(self.n), self.mesh.periodic_class[held])
            indptr, indices, kept = self.scatter.pattern.restricted(free)
            data = self.laplacian[kept]
            matrix = SymmetricPattern(indptr, indices).full(data)
            factor = choose_factor(indptr, indices, solver=self.solver, near_kernel=np.ones((len(free), 1)))
            factor.factor(data)

            def apply(rhs: Any) -> Any:
                solved = conjugate_gradients(matrix, rhs[free], factor.solve, tolerance=1e-12, limit=100)
                x = np.zeros(self.n)
                x[free] = solved.x
                return x

            self._inverses[held.tobytes()] = apply
        return self._inverses[held.tobytes()]

    def flow(self, j: int) -> Any:
        """w^j (3, nodes) under the unit force e_j.

        Raises
        ------
        PorocoreError
            The iteration does not converge.
        """
        inverses = [self.inverse(held) for held in held_velocities(self.mesh, j).T]
        force = inverses[j](self.load)
        even = ~held_pressures(self.mesh, j)[self._pressure_nodes]

        def schur(pressures: Any) -> Any:
            out = np.zeros_like(pressures)
            for i in range(3):
                out += self.divergence[i] @ inverses[i](self.divergence[i].T @ pressures)
            return out * even

        operator = _Columnwise(schur)
        rhs = -(self.divergence[j] @ force) * even
        solved = conjugate_gradients(
            operator,
            rhs,
            lambda r: r / (self.pressure_mass[:, None] if r.ndim == 2 else self.pressure_mass),
            tolerance=TOLERANCE,
            limit=400,
        )
        if not solved.converged:
            raise PorocoreError("the Stokes cell problem did not converge; refine the mesh (cell.mesh.size)")
        w = np.stack([inverses[i](self.divergence[i].T @ solved.x) for i in range(3)])
        w[j] += force
        return w


class _Columnwise:
    """A function of vectors as an operator on the columns of a matrix."""

    def __init__(self, function: Any) -> None:
        self._function = function

    def __matmul__(self, columns: Any) -> Any:
        return np.stack([self._function(column) for column in columns.T], axis=1)


def flow(mesh: CellMesh, solver: str = "auto") -> Any:
    """∫ w^j_i dV (3, 3) over the mesh, for unit viscosity."""
    problem = StokesProblem(mesh, solver)
    return np.stack([problem.flow(j) @ problem.load for j in range(3)], axis=1)
