"""Discrete u–p problem of a body (SkfemDiscretisation): integrals of elements, patterns, assembly.

An integral over an element is a product of matrices: values at its points times shape functions at its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.interfaces.law import Integrand, MacroTangent
from porocore.macro.body.mesh import MERIDIAN, BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.linear_systems import TIGHTEST, Solver
from porocore.macro.problem import MacroProblem
from porocore.states import Array, IntArray, MacroState
from porocore_fem_skfem.macro_linear import MacroLinearSolver, Matrices
from porocore_fem_skfem.macro_small import SMALL, SmallSystem, SmallTangent
from porocore_fem_skfem.macro_space import Frames, Shapes, make_shapes


class ElementIntegrals:
    """Integrals over the elements of a body with these shape functions.

    Local node a of u_i has column n_u i / 3 + a of an element's unknowns, then come the pressures.

    In a meridian the radial displacement is the third one too, whose gradient along the hoop alone counts; integrals
    for the third unknown are added to those for the first.
    """

    def __init__(self, shapes: Shapes) -> None:
        self.shapes = s = shapes
        e, q, a, _ = s.grad_u.shape
        self._n_u = 3 * a
        #: (elements, a, q · 3), by which a stress with rows (q, j) is integrated against ∇N_a.
        self._by_grad = np.ascontiguousarray(s.grad_u.transpose(0, 2, 1, 3)).reshape(e, a, 3 * q)
        #: (elements, c, q · 4): N and its gradient at each point, by which storage and flux are integrated.
        N = np.broadcast_to(s.p.T[None, :, :, None], (e, s.p.shape[1], q, 1))
        by_p = np.concatenate([N, s.grad_p.transpose(0, 2, 1, 3)], axis=3)
        self._by_p = np.ascontiguousarray(by_p).reshape(e, -1, 4 * q)
        #: The same as far as elements differ: (1, ...) where all are alike but for their place.
        self._grad, self._p_and_grad = (
            values[:1] if s.alike else values for values in (self._by_grad, self._by_p)
        )

    def states(self, unknowns: Array) -> tuple[MacroState, Array]:
        """Return H, p and ∇p (points, 3) at the points from the unknowns (elements, ...) of the elements."""
        e, q = self.shapes.weights.shape
        u, p = unknowns[:, : self._n_u].reshape(e, 3, -1), unknowns[:, None, self._n_u :]
        if self.shapes.revolved:
            u = u[:, [0, 1, 0]]
        grad_u = _product(u, self._grad).reshape(e, 3, q, 3).swapaxes(1, 2).reshape(-1, 3, 3)
        if self.shapes.revolved:
            grad_u = grad_u * MERIDIAN
        p_and_grad = _product(p, self._p_and_grad).reshape(-1, 4)
        return MacroState(grad_u, p_and_grad[:, 0].copy()), p_and_grad[:, 1:].copy()

    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        """Return ∫ P_E:∇N, ∫ Δstorage N and ∫ q·∇N of each element."""
        w = self.shapes.weights
        e, q = w.shape
        stress = np.empty((e, 3, q, 3))
        P = response.stress * MERIDIAN if self.shapes.revolved else response.stress
        np.multiply(P.reshape(e, q, 3, 3).swapaxes(1, 2), w[:, None, :, None], out=stress)
        forces = _product(stress.reshape(e, 3, -1), self._grad.swapaxes(1, 2))
        if self.shapes.revolved:
            _fold(forces)
        forces = forces.reshape(e, -1)
        fluid = np.zeros((e, 2, q, 4))
        np.multiply(response.storage.reshape(e, q), w, out=fluid[:, 0, :, 0])
        np.multiply(response.flux.reshape(e, q, 3), w[:, :, None], out=fluid[:, 1, :, 1:])
        volumes = _product(fluid.reshape(e, 2, -1), self._p_and_grad.swapaxes(1, 2))
        return forces, volumes[:, 0], volumes[:, 1]

    def tangent(self, tangent: MacroTangent, dt: float, part: slice) -> list[Array]:
        """Return the entries of some elements, flat: forces by displacements and by pressures, then volumes.

        These are (elements, ...) of (a, i, k, b), (a, i, c), (c, k, b) and (c, d).
        """
        s, total = self.shapes, len(self.shapes.weights)
        w, g, gp = s.weights[part], s.grad_u[part], s.grad_p[part]
        e, q, a, _ = g.shape
        c = gp.shape[2]
        by_grad, by_p = self._by_grad[part], self._by_p[part]
        if s.revolved:
            tangent = _in_meridian(tangent)

        def at_points(values: Array, *shape: int) -> Array:
            values = values.reshape(total, q, *shape)[part]
            return values * w.reshape(e, q, *(1 for _ in shape))

        # (e, q, j, i, k, l) times ∇N_b: rows (q, j), columns (i, k, b).
        stiffness = at_points(tangent.stress_grad_u, 3, 3, 3, 3).swapaxes(2, 3).reshape(e, q, 27, 3)
        slopes = np.matmul(stiffness, g.swapaxes(2, 3)).reshape(e, 3 * q, 9 * a)
        forces = np.matmul(by_grad, slopes)
        stress_p = at_points(tangent.stress_p, 3, 3).swapaxes(2, 3)[..., None] * s.p[:, None, None, :]
        if tangent.stress_grad_p is not None:
            by_slope = at_points(tangent.stress_grad_p, 3, 3, 3).swapaxes(2, 3).reshape(e, q, 9, 3)
            stress_p += np.matmul(by_slope, gp.swapaxes(2, 3)).reshape(stress_p.shape)
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
        if tangent.storage_grad_p is not None:
            by_slope = at_points(tangent.storage_grad_p, 1, 3)
            by_pressure[:, :, :1] += np.matmul(by_slope, gp.swapaxes(2, 3))
        volumes_p = np.matmul(by_p, by_pressure.reshape(e, 4 * q, c))
        if s.revolved:
            stiffness = forces.reshape(e, a, 3, 3, a)
            _fold(stiffness.swapaxes(1, 2))
            _fold(stiffness.transpose(0, 3, 1, 2, 4))
            _fold(forces_p.reshape(e, a, 3, c).swapaxes(1, 2))
            _fold(volumes.reshape(e, c, 3, a).swapaxes(1, 2))
        return [values.reshape(e, -1) for values in (forces, forces_p, volumes, volumes_p)]


def _in_meridian(tangent: MacroTangent) -> MacroTangent:
    """Return the derivatives with those components alone that there are in a meridian."""
    by_slope = tangent.stress_grad_p
    return replace(
        tangent,
        stress_grad_u=tangent.stress_grad_u * (MERIDIAN[:, :, None, None] * MERIDIAN),
        stress_p=tangent.stress_p * MERIDIAN,
        storage_grad_u=tangent.storage_grad_u * MERIDIAN,
        flux_grad_u=tangent.flux_grad_u * MERIDIAN,
        stress_grad_p=None if by_slope is None else by_slope * MERIDIAN[:, :, None],
    )


def _fold(values: Array) -> None:
    """Add, in place, what belongs to the third component of (elements, 3, ...) to the first."""
    values[:, 0] += values[:, 2]
    values[:, 2] = 0.0


def _product(values: Array, by: Array) -> Array:
    """Return (elements, r, m) times (elements or 1, m, n); one product where all elements share the second."""
    if len(by) > 1:
        return np.asarray(np.matmul(values, by))
    return np.asarray(values.reshape(-1, values.shape[2]) @ by[0]).reshape(*values.shape[:2], -1)


class _Sum(NamedTuple):
    """Sum of the pairs of some elements."""

    slots: npt.NDArray[np.int32] | slice  #: blocks that they belong to
    matrix: sparse.csr_matrix  #: (slots, pairs), ones


class BlockPattern:
    """Blocks of a sparse matrix that couple the nodes of an element with one another.

    By pairs of nodes, and not by pairs of unknowns, it takes 1 kB an unknown of quadratic tetrahedra to make, not 24.

    Parameters
    ----------
    rows, columns : (elements, a), (elements, b)
        Nodes of each element.
    shape
        Numbers of nodes (n, m).
    parts
        Slices of elements that are summed together.
    """

    def __init__(
        self, rows: IntArray, columns: IntArray, shape: tuple[int, int], parts: Sequence[slice]
    ) -> None:
        width = max(shape[1], 1)
        pairs = (rows.astype(np.int64)[:, :, None] * width + columns[:, None, :]).reshape(len(rows), -1)
        unique, slot = np.unique(pairs, return_inverse=True)
        slot = slot.astype(np.int32).reshape(pairs.shape)
        self.shape = shape
        self.indices = (unique % width).astype(np.int32)
        self.indptr = np.searchsorted(unique // width, np.arange(shape[0] + 1)).astype(np.int32)
        ones = np.ones(pairs.shape[1] * max((part.stop - part.start for part in parts), default=0))
        self._sums = [_sum(slot[part].ravel(), ones, len(unique), len(parts) == 1) for part in parts]

    def zeros(self, *block: int) -> Array:
        """Return blocks of zeros (blocks, ...)."""
        return np.zeros((len(self.indices), *block))

    def add(self, blocks: Array, part: int, values: Array) -> None:
        """Add the values (elements, a, b, ...) of a part of the elements, by its number, to ``blocks``."""
        slots, matrix = self._sums[part]
        flat = blocks.reshape(len(blocks), -1)
        flat[slots] += matrix @ values.reshape(matrix.shape[1], flat.shape[1])

    def matrix(self, blocks: Array) -> sparse.bsr_matrix:
        """Return the matrix of blocks (blocks, r, c), which it does not copy."""
        r, c = blocks.shape[1:]
        shape = (r * self.shape[0], c * self.shape[1])
        return sparse.bsr_matrix((blocks, self.indices, self.indptr), shape=shape)

    def transposed(self, blocks: Array, of: BlockPattern) -> Array:
        """Return the blocks of this pattern that are the transpose of the ``blocks`` of another one, ``of``."""
        rows = np.repeat(np.arange(self.shape[0]), np.diff(self.indptr))
        return np.ascontiguousarray(blocks[of.find(self.indices, rows)].swapaxes(1, 2))

    def find(self, rows: IntArray, columns: IntArray) -> IntArray:
        """Return the numbers of the blocks at pairs of nodes, all of which must be there."""
        width = max(self.shape[1], 1)
        keys = (
            np.repeat(np.arange(self.shape[0], dtype=np.int64), np.diff(self.indptr)) * width + self.indices
        )
        return np.asarray(np.searchsorted(keys, rows.astype(np.int64) * width + columns))


def _sum(slot: npt.NDArray[np.int32], ones: Array, size: int, all_of_them: bool) -> _Sum:
    """Return the sum of pairs into their slots; ``ones`` serves all sums as data."""
    if all_of_them:
        slots: npt.NDArray[np.int32] | slice = slice(None)
        count, place = size, slot
    else:
        slots, place = np.unique(slot, return_inverse=True)
        count = len(slots)
    order = np.argsort(place, kind="stable").astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(np.bincount(place.ravel(), minlength=count))]).astype(np.int32)
    return _Sum(slots, sparse.csr_matrix((ones[: len(slot)], order, starts), shape=(count, len(slot))))


class EquationPattern:
    """Rows and columns of the equations, taken out of the blocks as one sorted compressed matrix for a factor.

    Parameters
    ----------
    uu, up, pu, pp
        Patterns of the four parts.
    equation : (unknowns,)
        Equation of each unknown; -1: prescribed. Those of a plate share one, and their entries are summed.
    """

    def __init__(
        self, uu: BlockPattern, up: BlockPattern, pu: BlockPattern, pp: BlockPattern, equation: IntArray
    ) -> None:
        parts, first = [], 1
        for pattern, r, c in ((uu, 3, 3), (up, 3, 1), (pu, 1, 3), (pp, 1, 1)):
            count = len(pattern.indices) * r * c
            parts.append(pattern.matrix(np.arange(first, first + count, dtype=float).reshape(-1, r, c)))
            first += count
        numbers = sparse.bmat([parts[:2], parts[2:]], format="coo")
        row, column = equation[numbers.row], equation[numbers.col]
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        n = int(equation.max(initial=-1)) + 1
        keys = row[kept].astype(np.int64) * n + column[kept]
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        #: Place of each entry among those of all blocks, and where the entries of one place begin.
        self._source = numbers.data[kept[order]].astype(np.int64) - 1
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        self._starts = None if len(starts) == len(keys) else starts
        self._indices = (keys[starts] % max(n, 1)).astype(np.int32)
        self._indptr = np.searchsorted(keys[starts] // max(n, 1), np.arange(n + 1)).astype(np.int32)
        self._shape = (n, n)

    def matrix(self, blocks: Sequence[Array]) -> sparse.csr_matrix:
        """Return the matrix in CSR from the blocks of the four parts."""
        data = np.concatenate([block.ravel() for block in blocks])[self._source]
        if self._starts is not None:
            data = np.add.reduceat(data, self._starts)
        return sparse.csr_matrix((data, self._indices, self._indptr), shape=self._shape)


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
            or self.mesh.revolved  # its law has derivatives along the hoop
            or self.boundary.contacts
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
        self, tangent: MacroTangent, dt: float, surface: sparse.csr_matrix | None = None
    ) -> System | SmallSystem:
        """Assemble the element blocks, those of oblique nodes in their frames, and add the surface's entries.

        Frames turn the components of one node, and a surface couples nodes of one element: all lies in one pattern.
        """
        if self._small is not None:
            return self._small.system(tangent, dt)
        return self._block_system(tangent, dt, surface)

    def _block_system(
        self, tangent: MacroTangent, dt: float, surface: sparse.csr_matrix | None = None
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
        if surface is not None:
            self._add(blocks, surface)
        uu, up, pu, pp = blocks
        return System(uu, up, pu, pp, tangent)

    def _add(self, blocks: Sequence[Array], surface: sparse.csr_matrix) -> None:
        """Add a surface's entries, which couple nodes of one element and so lie within the pattern."""
        if self.rotation is not None:
            surface = (self.rotation @ surface @ self.rotation.T).tocsr()
        n_u = self.mesh.n_u
        u, p = (slice(0, n_u), 3), (slice(n_u, None), 1)
        for pattern, values, (rows, r), (columns, c) in zip(
            self._patterns, blocks, (u, u, p, p), (u, p, u, p), strict=True
        ):
            entries = surface[rows, columns].tocoo()
            found = pattern.find(entries.row // r, entries.col // c)
            np.add.at(values, (found, entries.row % r, entries.col % c), entries.data)

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
