"""Stokes flow through a pore (SkfemStokes): a factor, or an iteration with a Laplacian inside.

Quadratic velocity and linear pressure (Taylor–Hood, inf–sup stable). The velocity components do not couple,
so the Schur complement of the pressure is solved by conjugate gradients with one Laplacian factor for
each set of constraints, for the three forces at once; every solver that does elasticity does this too. Large
systems are solved by :mod:`porocore_fem_skfem.stokes`.

The conductivity is the stationary value of 2 fᵀx − xᵀAx at the solution of A x = f, so its error is the square of that
of velocity and pressure.

An iteration costs one cycle of multigrid; conjugate gradients for the pressure alone would solve for the velocity.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.cell.conductivity.pore import DiscreteFluid, FlowFields
from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import tetrahedron_rule
from porocore.cell.symmetry import held_pressures, held_velocities
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import Indices
from porocore_fem_skfem.linalg import (
    SymmetricPattern,
    choice_in_words,
    choose_factor,
    conjugate_gradients,
    iterates,
)
from porocore_fem_skfem.multigrid import Multigrid
from porocore_fem_skfem.node_grid import NodeGrid, PaddedPattern, node_grid
from porocore_fem_skfem.operators import Operators, Scatter, corner_values
from porocore_fem_skfem.products import Product


class LaplacianInverse(ABC):
    """The inverse of a symmetric matrix of fixed pattern, or a preconditioner for it."""

    @abstractmethod
    def set_up(self, data: Array) -> None:
        """Set up for the entries of an upper triangle; a FactorError says why it cannot be."""

    @abstractmethod
    def apply(self, rhs: Array) -> Array:
        """Return the inverse applied to the columns of (n, k)."""


class FactorInverse(LaplacianInverse):
    """The inverse itself, by a factor and conjugate gradients."""

    matrix: sparse.csr_matrix

    def __init__(self, indptr: Indices, indices: Indices, solver: str) -> None:
        self._pattern = SymmetricPattern(indptr, indices)
        self._factor = choose_factor(indptr, indices, solver=solver, single=False)

    def set_up(self, data: Array) -> None:
        self.matrix = self._pattern.full(data)
        self._factor.factor(data)

    def apply(self, rhs: Array) -> Array:
        return conjugate_gradients(self.matrix.dot, rhs, self._factor.solve, tolerance=1e-12, limit=100).x


class CycleInverse(LaplacianInverse):
    """One cycle of multigrid, in double precision for iterations that want a symmetric preconditioner."""

    def __init__(self, indptr: Indices, indices: Indices, grid: NodeGrid) -> None:
        self._pattern = PaddedPattern(indptr, indices, grid)
        self._multigrid = Multigrid(self._pattern, grid, np.float64)

    def set_up(self, data: Array) -> None:
        self._multigrid.set_up(self._pattern.matrix(data))

    def apply(self, rhs: Array) -> Array:
        return self._pattern.unpadded(self._multigrid.cycle(self._pattern.padded(rhs)))


LIMIT = 1_000
#: Least entry of :func:`schur_scale`, a share of the largest: 0 where all velocities of a pressure's elements are held.
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class StokesSystem:
    """Symmetric system of f flows, each with three velocities at n nodes and m pressures.

    Attributes
    ----------
    laplacian : (n, n)
        ∫ ∇N·∇N.
    gradient
        ∫ ψ ∂v/∂x_i, (n, m) for each i.
    mass : (m,)
        ∫ ψ.
    moving : (n, 3 f), even : (m, f)
        1 for unknowns, 0 for what vanishes; the columns of the first go through the flows of each component.
    precondition
        Approximate inverse of the Laplacian, for the columns of ``moving``; 0 where these are.
    """

    laplacian: sparse.csr_matrix
    gradient: list[sparse.csr_matrix]
    mass: Array
    moving: Array
    even: Array
    precondition: Callable[[Array], Array]


def solve(system: StokesSystem, force: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
    """Return velocities (n, 3 f), pressures (m, f) and the residuals of both under a force (n, 3 f).

    ``tolerance`` is that of the relative residual in the norm of the preconditioner.

    Raises
    ------
    FactorError
        The iteration does not converge.
    """
    n, m = len(system.moving), len(system.even)
    flows = system.even.shape[1]
    laplacian, gradient = Product(system.laplacian), [Product(one) for one in system.gradient]
    divergence = [Product(one.T.tocsr()) for one in system.gradient]

    def split(x: Array) -> tuple[Array, Array]:
        """Return velocities and pressures of columns (3 n + m, f)."""
        return x[: 3 * n].reshape(n, 3 * flows), x[3 * n :]

    scale = system.even / schur_scale(system)

    def apply(x: Array) -> Array:
        w, p = split(x)
        y = np.empty_like(x)
        stressed, spread = split(y)
        stressed[:] = laplacian @ w
        spread[:] = 0.0
        for i, (grad, div) in enumerate(zip(gradient, divergence, strict=True)):
            some = slice(i * flows, (i + 1) * flows)
            stressed[:, some] -= grad @ p
            spread -= div @ w[:, some]
        stressed *= system.moving
        spread *= system.even
        return y

    def precondition(x: Array) -> Array:
        w, p = split(x)
        return np.concatenate([system.precondition(w).reshape(3 * n, flows), p * scale])

    right = np.concatenate([(force * system.moving).reshape(3 * n, flows), np.zeros((m, flows))])
    x, converged = minres(apply, right, precondition, tolerance=tolerance, limit=LIMIT)
    if not converged:
        raise FactorError(f"MINRES did not converge in {LIMIT} iterations")
    return *split(x), *split(right - apply(x))


def schur_scale(system: StokesSystem) -> Array:
    """Return the diagonal of the pressure's Schur complement with the Laplacian's in its place, as large as the mass.

    Like the mass where velocities are free, (m, f); much less where the wall holds most of an element's velocities, for
    which the mass costs up to a quarter more iterations.
    """
    flows = system.even.shape[1]
    free = system.moving / system.laplacian.diagonal()[:, None]
    squares = [one.multiply(one).T.tocsr() for one in system.gradient]
    found = sum(square @ free[:, i * flows : (i + 1) * flows] for i, square in enumerate(squares))
    found = np.maximum(found, LEAST * found.max(axis=0))
    return np.asarray(found * (system.mass.sum() / found.sum(axis=0)))


def minres(
    apply: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    *,
    tolerance: float,
    limit: int,
) -> tuple[Array, bool]:
    """Solve a symmetric system for the columns (n, k), and return whether all converged.

    The preconditioner is positive definite; residuals are measured in its norm [Elman, Silvester & Wathen, Finite
    Elements and Fast Iterative Solvers, algorithm 4.1].
    """
    x, before, direction_before, direction = (np.zeros_like(right) for _ in range(4))
    v, z = right.copy(), precondition(right)
    gamma = np.sqrt(np.maximum(_products(v, z), 0.0))
    eta, goal, gamma_before = gamma, tolerance * gamma, np.ones_like(gamma)
    sine_before, sine, cosine_before, cosine = (np.full_like(gamma, value) for value in (0.0, 0.0, 1.0, 1.0))
    for _ in range(limit):
        active = np.abs(eta) > goal
        if not active.any():
            return x, True
        known = np.where(gamma > 0, gamma, 1.0)
        z /= known
        product = apply(z)
        delta = _products(product, z)
        before *= -gamma / gamma_before
        before += product
        before -= v * (delta / known)
        before, v, q = v, before, z
        z = precondition(v)
        gamma_before, gamma = known, np.sqrt(np.maximum(_products(v, z), 0.0))
        first = cosine * delta - cosine_before * sine * known
        second = sine * delta + cosine_before * cosine * known
        third = sine_before * known
        length = np.hypot(first, gamma)
        length = np.where(length > 0, length, 1.0)
        direction_before *= -third
        direction_before += q
        direction_before -= direction * second
        direction_before /= length
        direction_before, direction = direction, direction_before
        cosine_before, cosine, sine_before, sine = cosine, first / length, sine, gamma / length
        x += direction * np.where(active, cosine * eta, 0.0)
        eta = np.where(active, -sine * eta, eta)
    return x, bool((np.abs(eta) <= goal).all())


def _products(x: Array, y: Array) -> Array:
    """Return the product of each column of x with that of y; sums along the first axis take four times as long."""
    return np.asarray(np.einsum("nk,nk->k", x, y))


#: Relative residual of the pressure's Schur complement; the error of the conductivity, its square, is then 1e-11.
TOLERANCE = 1e-6
#: The same where velocity and pressure themselves are wanted.
FIELD_TOLERANCE = 1e-11
#: A divergence below this share of the sum of its terms' magnitudes is round-off.
ROUND_OFF = 1e-11
#: Free nodes beyond which the iteration is taken: with 17,600 nodes it takes 1.3 s where factors take 1.0 s, with
#: 44,300 nodes 3.2 s where they take 3.7 s.
STOKES_LIMIT = 30_000
#: The rule integrates p ∇·v of curved elements exactly, so that a constant pressure does no work.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class _Class:
    """Velocity components (component, flow) that vanish at the same nodes, and their Laplacian's upper triangle."""

    members: list[tuple[int, int]]
    free: IntArray
    indptr: Indices
    indices: Indices
    kept: IntArray  #: entries of the whole Laplacian

    @property
    def _places(self) -> tuple[IntArray, ...]:
        """Places of the members in (nodes, 3 · component + flow); whole rows are taken three times as fast."""
        if len(self.members) == 9:
            return (self.free,)
        return np.ix_(self.free, np.array([3 * i + j for i, j in self.members]))

    def columns(self, values: Array) -> Array:
        """Return the members of (nodes, 3 · component + flow) at the free nodes, one in each column."""
        return np.asarray(values[self._places])

    def spread(self, columns: Array | float, out: Array) -> None:
        """Put columns back where :meth:`columns` takes them from."""
        out[self._places] = columns


@dataclass(frozen=True, eq=False)
class _System:
    """Matrices of one shape of the pore."""

    laplacian: Array  #: entries of its upper triangle
    divergence: list[sparse.csr_matrix]  #: ∫ ψ ∂v/∂x_i, (pressures, nodes) for each i
    mass: Array  #: (pressures,)  ∫ ψ
    load: Array  #: (nodes,)  ∫ N


class SkfemStokes(DiscreteFluid):
    """Discrete Stokes problem with unit viscosity on the eighth or the whole of the fluid."""

    def __init__(self, mesh: CellMesh, solver: str) -> None:
        self.mesh = mesh = mesh.quadratic
        nodes = mesh.periodic_class
        self.n = int(nodes.max()) + 1
        self._cells = nodes[mesh.cells]
        corners, first, inverse = np.unique(self._cells[:, :4], return_index=True, return_inverse=True)
        self._pressures = len(corners)
        self._corners = inverse.reshape(-1, 4)
        self._scatter = Scatter(self._cells, self.n)
        # Row · n + column of each entry of the elements' divergences, and where it is summed up.
        keys = (self._corners[:, :, None] * self.n + self._cells[:, None, :]).ravel()
        self._places, self._slots = np.unique(keys, return_inverse=True)
        pressure_nodes = mesh.cells[:, :4].ravel()[first]
        #: Pressures that do not vanish, (pressures, flows).
        self._even = np.stack([~held_pressures(mesh, j)[pressure_nodes] for j in range(3)], axis=1)
        self._classes = self._sorted()
        self._solver = solver
        self._iterates = iterates(max(len(one.free) for one in self._classes), solver, STOKES_LIMIT)
        self._inverses = [self._inverse(one) for one in self._classes]

    @property
    def choice(self) -> str:
        n = max(len(one.free) for one in self._classes) * 3 + self._pressures
        return choice_in_words(n, self._solver, "MINRES" if self._iterates else "")

    def _sorted(self) -> list[_Class]:
        alike: dict[bytes, list[tuple[int, int]]] = {}
        for j in range(3):
            for i, held in enumerate(held_velocities(self.mesh, j).T):
                alike.setdefault(held.tobytes(), []).append((i, j))
        found = []
        for pattern, members in alike.items():
            held = np.frombuffer(pattern, dtype=bool)
            free = np.setdiff1d(np.arange(self.n), self.mesh.periodic_class[held])
            found.append(_Class(members, free, *self._scatter.pattern.restricted(free)))
        return found

    def _inverse(self, one: _Class) -> LaplacianInverse:
        if self._iterates:
            return CycleInverse(one.indptr, one.indices, node_grid(self.mesh, one.free, 1))
        return FactorInverse(one.indptr, one.indices, self._solver)

    def _system(self, points: Array) -> _System:
        velocity = Operators(self.mesh, DEGREE, self._cells, points)
        e, q, a = velocity.grad_N.shape[:3]
        w = velocity.weights.reshape(e, q)
        laplacian = self._scatter(velocity.laplacian())
        psi = corner_values(tetrahedron_rule(DEGREE)[0])  # (4, q)
        weighted = psi * w[:, None, :]  # (e, 4, q)
        blocks = weighted @ velocity.grad_N.reshape(e, q, a * 3)
        divergence = []
        for i in range(3):
            entries = np.bincount(self._slots, blocks.reshape(e, 4, a, 3)[..., i].ravel(), len(self._places))
            at = (self._places // self.n, self._places % self.n)
            divergence.append(sparse.csr_matrix((entries, at), shape=(self._pressures, self.n)))
        load = np.bincount(self._cells.ravel(), (w @ velocity.values.T).ravel(), self.n).astype(float)
        mass = np.bincount(self._corners.ravel(), weighted.sum(axis=2).ravel(), self._pressures).astype(float)
        return _System(laplacian, divergence, mass, load)

    def integrals(self, points: Array) -> Array:
        return self._solution(points, TOLERANCE)[2]

    def fields(self, points: Array) -> FlowFields:
        w, p, integrals = self._solution(points, FIELD_TOLERANCE)
        pressure = np.zeros((len(self.mesh.points), 3))
        pressure[self.mesh.cells[:, :4]] = p[self._corners]
        velocity = w[:, self.mesh.periodic_class].swapaxes(0, 1)
        return FlowFields(velocity, pressure, integrals)

    def _solution(self, points: Array, tolerance: float) -> tuple[Array, Array, Array]:
        """Return velocities (components, nodes, flows), pressures (pressures, flows) and their integrals (3, 3)."""
        system = self._system(points)
        for one, inverse in zip(self._classes, self._inverses, strict=True):
            inverse.set_up(system.laplacian[one.kept])
        return (self._by_iteration if self._iterates else self._by_factor)(system, tolerance)

    def _by_factor(self, system: _System, tolerance: float) -> tuple[Array, Array, Array]:
        forces = np.zeros((3, self.n, 3))
        for i in range(3):
            forces[i, :, i] = system.load
        forced = self._solve(forces)

        def schur(pressures: Array) -> Array:
            return self._divergence(system, self._solve(self._gradient(system, pressures)))

        right = -self._divergence(system, forced)
        # Flow along a slit needs no pressure; what is left of its divergence is round-off, which has no solution.
        whole = sum(abs(system.divergence[i]) @ np.abs(forced[i]) for i in range(3))
        right[:, np.linalg.norm(right, axis=0) < ROUND_OFF * np.linalg.norm(whole, axis=0)] = 0.0
        solved = conjugate_gradients(
            schur, right, lambda r: r / system.mass[:, None], tolerance=tolerance, limit=400
        )
        if not solved.converged:
            raise FactorError("conjugate gradients did not converge")
        w = forced + self._solve(self._gradient(system, solved.x))
        error = solved.x.T @ self._divergence(system, w)
        return w, solved.x, np.asarray(np.einsum("inj,n->ij", w, system.load) + error)

    def _by_iteration(self, system: _System, tolerance: float) -> tuple[Array, Array, Array]:
        whole = SymmetricPattern(*self._scatter.pattern.restricted(np.arange(self.n))[:2])
        moving, force = np.zeros((self.n, 9)), np.zeros((self.n, 9))
        for one in self._classes:
            one.spread(1.0, moving)
        force[:, ::4] = system.load[:, None]  # component i of flow i
        w, p, left_w, left_p = solve(
            StokesSystem(
                whole.full(system.laplacian),
                [one.T.tocsr() for one in system.divergence],
                system.mass,
                moving,
                self._even.astype(float),
                self._solve_columns,
            ),
            force,
            tolerance,
        )
        found, left = w.reshape(self.n, 3, 3), left_w.reshape(self.n, 3, 3)
        error = np.einsum("nki,nkj->ij", found, left) + p.T @ left_p
        integrals = np.asarray(np.einsum("nij,n->ij", found, system.load) + error)
        return found.swapaxes(0, 1), p, integrals

    def _solve(self, rhs: Array) -> Array:
        """Return the inverse of the Laplacian applied to (components, nodes, flows)."""
        columns = self._solve_columns(rhs.swapaxes(0, 1).reshape(self.n, 9))
        return columns.reshape(self.n, 3, 3).swapaxes(0, 1)

    def _solve_columns(self, rhs: Array) -> Array:
        """Return the inverse of the Laplacian applied to (nodes, 3 · component + flow); 0 where velocities are held."""
        out = np.zeros_like(rhs)
        for one, inverse in zip(self._classes, self._inverses, strict=True):
            one.spread(inverse.apply(one.columns(rhs)), out)
        return out

    def _divergence(self, system: _System, w: Array) -> Array:
        return np.asarray(sum(system.divergence[i] @ w[i] for i in range(3)) * self._even)

    def _gradient(self, system: _System, pressures: Array) -> Array:
        return np.stack([divergence.T @ (pressures * self._even) for divergence in system.divergence])
