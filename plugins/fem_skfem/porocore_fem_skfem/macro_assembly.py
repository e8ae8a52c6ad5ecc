"""Discretisation of the u–p problem: residual and tangent from the law's response; chooses the small path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy import sparse

from porocore.interfaces.law import Integrand, MacroTangent
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.linear_systems.choice import Solver
from porocore.macro.linear_systems.reuse import TIGHTEST
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore_fem_skfem.macro_elements import ElementIntegrals
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
        self.shapes = make_shapes(mesh)
        self._integrals = ElementIntegrals(self.shapes)
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
        return self._integrals.states(x[self.dofs])

    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        return self._integrals.contributions(response)

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
            values = self._integrals.tangent(tangent, dt, part)
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

    def transposed(self, system: System | SmallSystem) -> System | SmallSystem:
        """Return the transpose, of blocks in the same patterns."""
        if isinstance(system, SmallSystem):
            return system.transposed()
        uu, up, pu, pp = self._patterns
        return System(
            uu.transposed(system.uu, uu),
            up.transposed(system.pu, pu),
            pu.transposed(system.up, up),
            pp.transposed(system.pp, pp),
            system.tangent,
        )

    def _knowing(self, system: System | SmallSystem, x: Array) -> System | SmallSystem:
        """Return the system, or one that knows the held unknowns too where ``x`` has them."""
        if isinstance(system, SmallSystem) and self._small is not None and x[self._small.held].any():
            return self._block_system(system.tangent, system.dt)
        return system

    def magnitudes(self, system: System | SmallSystem, x: Array) -> Array:
        system = self._knowing(system, x)
        if isinstance(system, SmallSystem):
            terms, leading = np.zeros(len(x)), self.free[self.leading]
            free, moved = system.sizes
            terms[leading] = free @ np.abs(x[leading]) + moved @ np.abs(x)
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
