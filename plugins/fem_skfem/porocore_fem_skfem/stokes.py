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
from porocore.errors import PorocoreError
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients
from porocore_fem_skfem.operators import Operators, Scatter

TOLERANCE = 1e-9


class StokesProblem:
    """Discrete Stokes problem with unit viscosity on the eighth or the whole of the fluid."""

    def __init__(self, mesh: CellMesh, solver: str) -> None:
        mesh = mesh if mesh.order == 2 else _with_midpoints(mesh)
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
        self._inverses: dict[str, Any] = {}
        wall = np.zeros(self.n, dtype=bool)
        wall[nodes[mesh.wall]] = True
        self._wall = wall
        at = mesh.points[mesh.cells[:, :4].ravel()[first]]
        #: Pressure nodes on the planes of each axis, where a pressure odd under that mirror vanishes.
        self._pressure_on_plane = ((at == 0.0) | (at == 0.5)) & (mesh.domain == "eighth")
        self._on_plane = np.zeros((self.n, 3), dtype=bool)
        if mesh.domain == "eighth":
            self._on_plane[:] = (mesh.points == 0.0) | (mesh.points == 0.5)

    def _integrals(self, velocity: Operators) -> Any:
        """∫ N_a for each velocity node."""
        e, q = velocity.grad_N.shape[:2]
        contributions = self.w.reshape(e, q) @ velocity.values.T
        return np.bincount(velocity.cells.ravel(), contributions.ravel(), minlength=self.n)

    def inverse(self, planes: str) -> Any:
        """x ↦ A⁻¹ x for a velocity component that vanishes on the wall and on the planes of the named axes."""
        if planes not in self._inverses:
            fixed = self._wall | self._on_plane[:, ["xyz".index(a) for a in planes]].any(axis=1)
            free = np.flatnonzero(~fixed)
            indptr, indices, kept = self.scatter.restricted(free)
            data = self.laplacian[kept]
            matrix = SymmetricPattern(indptr, indices).full(data)
            factor = choose_factor(indptr, indices, solver=self.solver, near_kernel=np.ones((len(free), 1)))
            factor.factor(data)

            def apply(rhs: Any) -> Any:
                solved = conjugate_gradients(matrix, rhs[free], factor.solve, tolerance=1e-12, limit=100)
                x = np.zeros(self.n)
                x[free] = solved.x
                return x

            self._inverses[planes] = apply
        return self._inverses[planes]

    def flow(self, j: int) -> Any:
        """w^j (3, nodes) under the unit force e_j.

        Raises
        ------
        PorocoreError
            The iteration does not converge.
        """
        axis = "xyz"[j]
        # Odd under the mirror of its own axis, even under the others.
        planes = ["".join(sorted({axis, "xyz"[i]})) if i != j else "" for i in range(3)]
        if self.mesh.domain == "whole":
            planes = ["", "", ""]
        inverses = [self.inverse(p) for p in planes]
        force = inverses[j](self.load)

        even = ~self._pressure_on_plane[:, j]

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


def conductivity(mesh: CellMesh, solver: str = "auto") -> Any:
    """K_ij = <w^j_i>_f (3, 3) for unit viscosity."""
    problem = StokesProblem(mesh, solver)
    K = np.stack([problem.flow(j) @ problem.load for j in range(3)], axis=1)
    if mesh.domain == "eighth":
        K = 8 * np.diag(np.diag(K))
    return K


def _with_midpoints(mesh: CellMesh) -> CellMesh:
    """The same straight tetrahedra with a node in the middle of each edge."""
    pairs = mesh.cells[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]].reshape(-1, 2)
    unique, inverse = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    middles = mesh.points[unique].mean(axis=1)
    cells = np.concatenate([mesh.cells, inverse.reshape(-1, 6) + len(mesh.points)], axis=1)
    return CellMesh(mesh.phase, mesh.domain, np.concatenate([mesh.points, middles]), cells)
