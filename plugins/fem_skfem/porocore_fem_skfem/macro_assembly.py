"""Residual, tangent and linear solve of the u–p problem from the law's response at all quadrature points.

An integral over an element is a product of matrices: values at its points times shape functions at its points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.interfaces.law import MacroResponse, MacroTangent
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import MacroProblem
from porocore.states import Array, IntArray, MacroState
from porocore_fem_skfem.macro_frames import Frames
from porocore_fem_skfem.macro_linear import SparseLinearSolver
from porocore_fem_skfem.macro_space import make_shapes

#: Numbers in the intermediate products of as many elements as are treated at once.
CACHED = 4_000_000


@dataclass(frozen=True, eq=False)
class System:
    """The tangent, split into equations and prescribed unknowns."""

    free: sparse.csr_matrix  #: scipy CSR, equations × equations
    coupling: sparse.csr_matrix  #: scipy CSR, equations × prescribed


class SkfemDiscretisation(Discretisation[System]):
    """Shape functions and sparsity; local node a of u_i has column n_u i / 3 + a, then come the pressures."""

    def __init__(self, problem: MacroProblem, mesh: BodyMesh, boundary: BoundaryData) -> None:
        super().__init__(
            problem,
            mesh,
            boundary,
            unknowns=np.arange(mesh.size),
            owned=mesh.size,
            elements=np.arange(len(mesh.cells)),
            dofs=np.concatenate([*(3 * mesh.cells + i for i in range(3)), mesh.n_u + mesh.p_cells], axis=1),
        )
        self.shapes = s = make_shapes(mesh)
        e, q, a, _ = s.grad_u.shape
        #: (elements, a, q · 3), by which a stress with rows (q, j) is integrated against ∇N_a.
        self._by_grad = np.ascontiguousarray(s.grad_u.transpose(0, 2, 1, 3)).reshape(e, a, 3 * q)
        #: (elements, c, q · 4): N and its gradient at each point, by which storage and flux are integrated.
        N = np.broadcast_to(s.p.T[None, :, :, None], (e, s.p.shape[1], q, 1))
        by_p = np.concatenate([N, s.grad_p.transpose(0, 2, 1, 3)], axis=3)
        self._by_p = np.ascontiguousarray(by_p).reshape(e, -1, 4 * q)
        self._linear = SparseLinearSolver()
        self._build_patterns()

    def _build_patterns(self) -> None:
        #: Equation of each free unknown; those of a plate share one.
        equation = np.full(self.mesh.size, -1, dtype=np.int64)
        n = int(self.leading.sum())
        of_free = np.empty(len(self.free), dtype=np.int64)
        of_free[self.leading] = np.arange(n)
        for places in self.plates:
            of_free[places] = of_free[places[0]]
        equation[self.free] = of_free
        self._of_free = of_free
        fixed = np.full(self.mesh.size, -1, dtype=np.int64)
        fixed[self.prescribed] = np.arange(len(self.prescribed))
        u, p = self.dofs[:, : self.n_u].reshape(len(self.dofs), 3, -1), self.dofs[:, self.n_u :]
        e, _, a = u.shape
        c = p.shape[1]
        # Blocks in the order in which the products leave them: (e, a, i, k, b), (e, a, i, c), (e, c, k, b), (e, c, d).
        u = u.swapaxes(1, 2)
        shapes = [(e, a, 3, 3, a), (e, a, 3, c), (e, c, 3, a), (e, c, c)]
        v = u.swapaxes(1, 2)
        rows = [u[:, :, :, None, None], u[:, :, :, None], p[:, :, None, None], p[:, :, None]]
        columns = [v[:, None, None], p[:, None, None], v[:, None], p[:, None]]
        self._ends = np.cumsum([0, *(int(np.prod(s)) for s in shapes)])
        self._entries = np.empty(self._ends[-1])
        row, column = (
            np.concatenate([np.broadcast_to(x, s).ravel() for x, s in zip(which, shapes, strict=True)])
            for which in (rows, columns)
        )
        self._equation, self._fixed = equation, fixed
        self._frames = None if self.rotation is None else Frames(self.rotation, self.mesh.cells)
        self._free = _Pattern(equation[row], equation[column], (n, n))
        self._coupling = _Pattern(equation[row], fixed[column], (n, len(self.prescribed)))

    def states_of(self, x: Array) -> tuple[MacroState, Array]:
        s, local = self.shapes, x[self.dofs]
        e = len(local)
        u, p = local[:, : self.n_u].reshape(e, 1, 3, -1), local[:, self.n_u :]
        grad_u = np.matmul(u, s.grad_u).reshape(-1, 3, 3)
        grad_p = np.matmul(p[:, None, None, :], s.grad_p).reshape(-1, 3)
        return MacroState(grad_u, (p @ s.p.T).ravel()), grad_p

    def contributions(self, response: MacroResponse) -> tuple[Array, Array, Array]:
        w = self.shapes.weights
        e, q = w.shape
        stress = (
            (response.stress.reshape(e, q, 3, 3) * w[:, :, None, None]).swapaxes(2, 3).reshape(e, 3 * q, 3)
        )
        forces = np.matmul(self._by_grad, stress).swapaxes(1, 2).reshape(e, -1)
        stored = (response.storage.reshape(e, q) * w) @ self.shapes.p
        flux = response.flux.reshape(e, q, 1, 3) * w[:, :, None, None]
        moved = np.matmul(flux, self.shapes.grad_p.swapaxes(2, 3)).sum(axis=1).reshape(e, -1)
        return forces, stored, moved

    def system(self, tangent: MacroTangent, dt: float, follower: sparse.csr_matrix | None = None) -> System:
        """Assemble the element blocks, those of oblique nodes in their frames, and add the follower's entries.

        Frames turn the components of one node, and a follower couples nodes of one element: all lies in one pattern.
        """
        e, q, a, _ = self.shapes.grad_u.shape
        chunk = max(1, CACHED // (27 * q * a))
        for first in range(0, e, chunk):
            part = slice(first, min(first + chunk, e))
            self._integrate(tangent, dt, part)
            if self._frames is not None:
                self._frames.turn(self._blocks(part), part)
        system = System(self._free.matrix(self._entries), self._coupling.matrix(self._entries))
        if follower is not None:
            self._add(system, follower)
        return system

    def _add(self, system: System, follower: sparse.csr_matrix) -> None:
        n_u = self.mesh.n_u
        if self.rotation is not None:
            turn = self.rotation[:n_u, :n_u]
            follower = turn @ follower @ turn.T
        entries = follower.tocoo()
        row, column = self._equation[entries.row], entries.col
        self._free.add(system.free, row, self._equation[column], entries.data)
        self._coupling.add(system.coupling, row, self._fixed[column], entries.data)

    def _blocks(self, part: slice) -> list[Array]:
        """Return the entries (elements, ...) of elements: forces by displacements and by pressures, then volumes."""
        return [
            self._entries[first:last].reshape(len(self.elements), -1)[part]
            for first, last in zip(self._ends[:-1], self._ends[1:], strict=True)
        ]

    def _integrate(self, tangent: MacroTangent, dt: float, part: slice) -> None:
        """Compute the blocks of some elements."""
        s, total = self.shapes, len(self.elements)
        w, g, gp = s.weights[part], s.grad_u[part], s.grad_p[part]
        e, q, a, _ = g.shape
        c = gp.shape[2]
        by_grad, by_p = self._by_grad[part], self._by_p[part]
        out = self._blocks(part)

        def at_points(values: Array, *shape: int) -> Array:
            values = values.reshape(total, q, *shape)[part]
            return values * w.reshape(e, q, *(1 for _ in shape))

        # (e, q, j, i, k, l) times ∇N_b: rows (q, j), columns (i, k, b).
        stiffness = at_points(tangent.stress_grad_u, 3, 3, 3, 3).swapaxes(2, 3).reshape(e, q, 27, 3)
        slopes = np.matmul(stiffness, g.swapaxes(2, 3)).reshape(e, 3 * q, 9 * a)
        np.matmul(by_grad, slopes, out=out[0].reshape(e, a, 9 * a))
        stress_p = at_points(tangent.stress_p, 3, 3).swapaxes(2, 3)[..., None] * s.p[:, None, None, :]
        np.matmul(by_grad, stress_p.reshape(e, 3 * q, 3 * c), out=out[1].reshape(e, a, 3 * c))
        # Rows (q, 0) for the storage, (q, 1 … 3) for the flux.
        by_u = np.concatenate(
            [at_points(tangent.storage_grad_u, 1, 3, 3), -dt * at_points(tangent.flux_grad_u, 3, 3, 3)],
            axis=2,
        ).reshape(e, q, 12, 3)
        by_u = np.matmul(by_u, g.swapaxes(2, 3)).reshape(e, 4 * q, 3 * a)
        np.matmul(by_p, by_u, out=out[2].reshape(e, c, 3 * a))
        by_value = np.concatenate(
            [at_points(tangent.storage_p, 1), -dt * at_points(tangent.flux_p, 3)], axis=2
        )
        by_pressure = by_value[..., None] * s.p[:, None, :]
        by_pressure[:, :, 1:] -= dt * np.matmul(at_points(tangent.flux_grad_p, 3, 3), gp.swapaxes(2, 3))
        np.matmul(by_p, by_pressure.reshape(e, 4 * q, c), out=out[3].reshape(e, c, c))

    def magnitudes(self, system: System, x: Array) -> Array:
        terms, leading = np.zeros(len(x)), self.free[self.leading]
        terms[leading] = abs(system.free) @ np.abs(x[leading])
        terms[leading] += abs(system.coupling) @ np.abs(x[self.prescribed])
        return terms

    def solve(self, system: System, right: Array, jump: Array, *, again: bool = False) -> Array:
        """Solve by :class:`~porocore_fem_skfem.macro_linear.SparseLinearSolver`."""
        change = np.zeros(len(right))
        change[self.prescribed] = jump
        right = self.equations(right)
        if jump.any():
            right = right - system.coupling @ jump
        change[self.free] = self._linear.solve(system.free, right, again=again)[self._of_free]
        return change


class _Pattern:
    """Sum of entries at (row, column) into sorted compressed rows; a negative index leaves an entry out."""

    def __init__(self, row: IntArray, column: IntArray, shape: tuple[int, int]) -> None:
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        width = max(shape[1], 1)
        unique, slot = np.unique(row[kept] * width + column[kept], return_inverse=True)
        slot = slot.ravel()
        self._shape = shape
        self._indices = (unique % width).astype(np.int32)
        self._indptr = np.searchsorted(unique // width, np.arange(shape[0] + 1)).astype(np.int32)
        order = np.argsort(slot, kind="stable")
        starts = np.searchsorted(slot[order], np.arange(len(unique) + 1))
        self._sum = sparse.csr_matrix(
            (np.ones(len(kept)), kept[order], starts), shape=(len(unique), len(row))
        )

    def matrix(self, entries: Array) -> sparse.csr_matrix:
        """Return the matrix in CSR."""
        return sparse.csr_matrix((self._sum @ entries, self._indices, self._indptr), shape=self._shape)

    def add(self, matrix: sparse.csr_matrix, row: IntArray, column: IntArray, values: Array) -> None:
        """Add values at (row, column) to a matrix of this pattern, which has places for all of them."""
        kept = (row >= 0) & (column >= 0)
        # The unknowns of a plate share a row.
        added = sparse.csr_matrix((values[kept], (row[kept], column[kept])), shape=self._shape).tocoo()
        matrix[added.row, added.col] += added.data
