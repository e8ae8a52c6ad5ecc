"""The discrete fluid: Stokes flow under unit forces, by factors of Laplacians or by an iteration.

Quadratic velocity and linear pressure (Taylor–Hood, inf–sup stable). The velocity components do not couple,
so the Schur complement of the pressure is solved by conjugate gradients with one Laplacian factor for
each set of constraints, for the three forces at once; every solver that does elasticity does this too. Large
systems are solved by :mod:`porocore_fem_skfem.stokes_iteration`.

The conductivity is the stationary value of 2 fᵀx − xᵀAx at the solution of A x = f, so its error is the square of that
of velocity and pressure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.cell.conductivity.fluid import DiscreteFluid, FlowFields
from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.symmetry.parity import held_pressures, held_velocities
from porocore.states import Array, IntArray
from porocore_fem_skfem.checks import Indices
from porocore_fem_skfem.laplacian import CycleInverse, FactorInverse, LaplacianInverse
from porocore_fem_skfem.linalg import SymmetricPattern, choice_in_words, conjugate_gradients, iterates
from porocore_fem_skfem.node_grid import node_grid
from porocore_fem_skfem.operators import Operators, Scatter, corner_values
from porocore_fem_skfem.stokes_iteration import StokesSystem, solve

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
