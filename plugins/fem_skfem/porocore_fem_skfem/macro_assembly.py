"""Discretisation of the u–p problem: residual and tangent from the law's response; chooses the small path.

An integral over an element is a product of matrices: values at its points times shape functions at its points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy import sparse

from porocore.interfaces.law import MacroResponse, MacroTangent
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.linear_systems.choice import Solver
from porocore.macro.linear_systems.reuse import TIGHTEST
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore_fem_skfem.macro_frames import Frames
from porocore_fem_skfem.macro_iterative import Matrices
from porocore_fem_skfem.macro_linear import MacroLinearSolver
from porocore_fem_skfem.macro_pattern import BlockPattern, EquationPattern
from porocore_fem_skfem.macro_small import SMALL, SmallSystem, SmallTangent
from porocore_fem_skfem.macro_space import make_shapes

#: Numbers in the intermediate products of as many elements as are treated at once.
CACHED = 4_000_000


@dataclass(frozen=True, eq=False)
class System:
    """Tangent of all unknowns in blocks of nodes, whatever is prescribed; forces by displacements come first."""

    uu: Array  #: (blocks, 3, 3)
    up: Array  #: (blocks, 3, 1)
    pu: Array  #: (blocks, 1, 3)
    pp: Array  #: (blocks, 1, 1)
    tangent: MacroTangent  #: from which they come

    @property
    def blocks(self) -> tuple[Array, Array, Array, Array]:
        """The four parts."""
        return self.uu, self.up, self.pu, self.pp


class SkfemDiscretisation(Discretisation[System | SmallSystem]):
    """Shape functions and sparsity; local node a of u_i has column n_u i / 3 + a, then come the pressures."""

    #: Entries of all element matrices up to which a body is small.
    largest_small: ClassVar[int] = SMALL

    def __init__(
        self, problem: MacroProblem, mesh: BodyMesh, boundary: BoundaryData, solver: Solver = "auto"
    ) -> None:
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
        self._build_patterns()
        self._solver = MacroLinearSolver(self, solver)
        self._small = None if solver == "iterative" else self._small_tangent()
        self.keeps_factor = self._small is not None

    def _small_tangent(self) -> SmallTangent | None:
        """Return the integration for a small body; None where it is large, or couples what it must not."""
        if (
            self.dofs.shape[0] * self.dofs.shape[1] ** 2 > self.largest_small
            or self.rotation is not None
            or self.boundary.followers
        ):
            return None
        held, start = np.zeros(self.mesh.size, bool), self.problem.initial
        if start.pressure == 0 and not any(map(any, start.gradient)):
            held[self.prescribed] = ~self.boundary.values.any(axis=1)
        return SmallTangent(self.shapes, self.dofs, self._equation, held)

    def _build_patterns(self) -> None:
        #: Equation of each unknown, -1 where it is prescribed, and of each free one; those of a plate share one.
        self._equation = np.full(self.mesh.size, -1, dtype=np.int64)
        of_free = np.empty(len(self.free), dtype=np.int64)
        of_free[self.leading] = np.arange(int(self.leading.sum()))
        for places in self.plates:
            of_free[places] = of_free[places[0]]
        self._equation[self.free] = self.of_free = of_free
        cells, corners = self.mesh.cells, self.mesh.p_cells
        n, m = len(self.mesh.points), len(self.mesh.p_nodes)
        _, q, a, _ = self.shapes.grad_u.shape
        chunk = max(1, CACHED // (27 * q * a))
        self._parts = [slice(first, min(first + chunk, len(cells))) for first in range(0, len(cells), chunk)]
        self._patterns = (
            BlockPattern(cells, cells, (n, n), self._parts),
            BlockPattern(cells, corners, (n, m), self._parts),
            BlockPattern(corners, cells, (m, n), self._parts),
            BlockPattern(corners, corners, (m, m), self._parts),
        )
        self._frames = None if self.rotation is None else Frames(self.rotation, cells)

    @cached_property
    def _equation_pattern(self) -> EquationPattern:
        return EquationPattern(*self._patterns, self._equation)

    def equation_matrix(self, system: System | SmallSystem) -> sparse.csr_matrix:
        """Return the matrix of the equations alone, sorted CSR with a symmetric pattern."""
        if isinstance(system, SmallSystem):
            return system.free
        return self._equation_pattern.matrix(system.blocks)

    def states_of(self, x: Array) -> tuple[MacroState, Array]:
        s, local = self.shapes, x[self.dofs]
        e = len(local)
        u, p = local[:, : self.n_u].reshape(e, 3, -1), local[:, self.n_u :]
        grad_u = np.matmul(u, self._by_grad).reshape(e, 3, -1, 3).swapaxes(1, 2).reshape(-1, 3, 3)
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

    def system(
        self, tangent: MacroTangent, dt: float, follower: sparse.csr_matrix | None = None
    ) -> System | SmallSystem:
        """Assemble the element blocks, those of oblique nodes in their frames, and add the follower's entries.

        Frames turn the components of one node, and a follower couples nodes of one element: all lies in one pattern.
        """
        if self._small is not None:
            return self._small.system(tangent, dt)
        return self._block_system(tangent, dt, follower)

    def _block_system(
        self, tangent: MacroTangent, dt: float, follower: sparse.csr_matrix | None = None
    ) -> System:
        blocks = tuple(
            pattern.zeros(*shape)
            for pattern, shape in zip(self._patterns, ((3, 3), (3, 1), (1, 3), (1, 1)), strict=True)
        )
        for number, part in enumerate(self._parts):
            values = self._integrate(tangent, dt, part)
            if self._frames is not None:
                self._frames.turn(values, part)
            e, c, a = part.stop - part.start, self.mesh.element.corners, self.mesh.cells.shape[1]
            by_pairs = (
                values[0].reshape(e, a, 3, 3, a).transpose(0, 1, 4, 2, 3),
                values[1].reshape(e, a, 3, c).swapaxes(2, 3),
                values[2].reshape(e, c, 3, a).swapaxes(2, 3),
                values[3],
            )
            for pattern, sums, pairs in zip(self._patterns, blocks, by_pairs, strict=True):
                pattern.add(sums, number, pairs)
        if follower is not None:
            self._add(blocks[0], follower)
        uu, up, pu, pp = blocks
        return System(uu, up, pu, pp, tangent)

    def _add(self, uu: Array, follower: sparse.csr_matrix) -> None:
        """Add a follower's entries, which couple nodes of one element and so lie within the pattern."""
        if self.rotation is not None:
            n_u = self.mesh.n_u
            turn = self.rotation[:n_u, :n_u]
            follower = turn @ follower @ turn.T
        entries = follower.tobsr(blocksize=(3, 3)).tocsr().tocoo()
        found = self._patterns[0].find(entries.row // 3, entries.col // 3)
        np.add.at(uu, (found, entries.row % 3, entries.col % 3), entries.data)

    def _integrate(self, tangent: MacroTangent, dt: float, part: slice) -> list[Array]:
        """Return the entries of some elements, flat: forces by displacements and by pressures, then volumes.

        These are (elements, ...) of (a, i, k, b), (a, i, c), (c, k, b) and (c, d).
        """
        s, total = self.shapes, len(self.elements)
        w, g, gp = s.weights[part], s.grad_u[part], s.grad_p[part]
        e, q, a, _ = g.shape
        c = gp.shape[2]
        by_grad, by_p = self._by_grad[part], self._by_p[part]

        def at_points(values: Array, *shape: int) -> Array:
            values = values.reshape(total, q, *shape)[part]
            return values * w.reshape(e, q, *(1 for _ in shape))

        # (e, q, j, i, k, l) times ∇N_b: rows (q, j), columns (i, k, b).
        stiffness = at_points(tangent.stress_grad_u, 3, 3, 3, 3).swapaxes(2, 3).reshape(e, q, 27, 3)
        slopes = np.matmul(stiffness, g.swapaxes(2, 3)).reshape(e, 3 * q, 9 * a)
        forces = np.matmul(by_grad, slopes)
        stress_p = at_points(tangent.stress_p, 3, 3).swapaxes(2, 3)[..., None] * s.p[:, None, None, :]
        forces_p = np.matmul(by_grad, stress_p.reshape(e, 3 * q, 3 * c))
        # Rows (q, 0) for the storage, (q, 1 … 3) for the flux.
        by_u = np.concatenate(
            [at_points(tangent.storage_grad_u, 1, 3, 3), -dt * at_points(tangent.flux_grad_u, 3, 3, 3)],
            axis=2,
        ).reshape(e, q, 12, 3)
        by_u = np.matmul(by_u, g.swapaxes(2, 3)).reshape(e, 4 * q, 3 * a)
        volumes = np.matmul(by_p, by_u)
        by_value = np.concatenate(
            [at_points(tangent.storage_p, 1), -dt * at_points(tangent.flux_p, 3)], axis=2
        )
        by_pressure = by_value[..., None] * s.p[:, None, :]
        by_pressure[:, :, 1:] -= dt * np.matmul(at_points(tangent.flux_grad_p, 3, 3), gp.swapaxes(2, 3))
        volumes_p = np.matmul(by_p, by_pressure.reshape(e, 4 * q, c))
        return [values.reshape(e, -1) for values in (forces, forces_p, volumes, volumes_p)]

    def _knowing(self, system: System | SmallSystem, x: Array) -> System | SmallSystem:
        """Return the system, or one that knows the held unknowns too where ``x`` has them."""
        if isinstance(system, SmallSystem) and self._small is not None and x[self._small.held].any():
            return self._block_system(system.tangent, system.dt)
        return system

    def magnitudes(self, system: System | SmallSystem, x: Array) -> Array:
        system = self._knowing(system, x)
        if isinstance(system, SmallSystem):
            terms, leading = np.zeros(len(x)), self.free[self.leading]
            terms[leading] = abs(system.free) @ np.abs(x[leading]) + abs(system.moved) @ np.abs(x)
            return terms
        n_u = self.mesh.n_u
        (uu, up), (pu, pp) = ((abs(part) for part in row) for row in self.matrices(system))
        u, p = np.abs(x[:n_u]), np.abs(x[n_u:])
        return np.concatenate([uu @ u + up @ p, pu @ u + pp @ p])

    def solve(
        self,
        system: System | SmallSystem,
        right: Array,
        jump: Array,
        *,
        again: bool = False,
        accuracy: float = TIGHTEST,
    ) -> Array:
        """Solve by :class:`~porocore_fem_skfem.macro_linear.MacroLinearSolver`."""
        change = np.zeros(len(right))
        change[self.prescribed] = jump
        system = self._knowing(system, change)
        if isinstance(system, SmallSystem):
            right = self.equations(right) - system.moved @ change
            change[self.free] = system.solve(right, self.linear)[self.of_free]
            return change
        if jump.any():
            right = right - self._apply(system, change)
        change[self.free] = self._solver.solve(system, right, again=again, accuracy=accuracy)
        return change

    def begin(self) -> None:
        """Forget the preconditioner of the solve before, so that this one does not depend on it."""
        super().begin()
        self._solver.forget()

    def matrices(self, system: System) -> Matrices:
        """Return the matrices of all forces, and of all volumes, by displacements and by pressures."""
        uu, up, pu, pp = (
            pattern.matrix(blocks) for pattern, blocks in zip(self._patterns, system.blocks, strict=True)
        )
        return (uu, up), (pu, pp)

    def mass(self, coefficient: Array) -> sparse.csr_matrix:
        """Return the mass matrix of the pressures with a coefficient (points,)."""
        s, pattern = self.shapes, self._patterns[3]
        products = (s.p[:, :, None] * s.p[:, None, :]).reshape(len(s.p), -1)
        blocks = pattern.zeros(1, 1)
        values = (coefficient.reshape(s.weights.shape) * s.weights) @ products
        for number, part in enumerate(self._parts):
            pattern.add(blocks, number, values[part])
        return pattern.matrix(blocks).tocsr()

    def _apply(self, system: System, x: Array) -> Array:
        (uu, up), (pu, pp) = self.matrices(system)
        u, p = x[: self.mesh.n_u], x[self.mesh.n_u :]
        return np.concatenate([uu @ u + up @ p, pu @ u + pp @ p])
