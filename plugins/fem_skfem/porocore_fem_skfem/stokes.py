"""The fluid cell problem: Stokes flow through the pore under unit forces.

Quadratic velocity and linear pressure (Taylor–Hood, inf–sup stable). The velocity components do not couple,
so the Schur complement of the pressure is solved by conjugate gradients with one Laplacian factor for
each set of constraints, for the three forces at once; every solver that does elasticity does this too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.cell.conductivity.fluid import DiscreteFluid
from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.symmetry.parity import held_pressures, held_velocities
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import SymmetricFactor
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients
from porocore_fem_skfem.operators import Operators, Scatter, corner_values

TOLERANCE = 1e-9
#: A divergence below this share of the sum of its terms' magnitudes is round-off.
ROUND_OFF = 1e-11
#: The rule integrates p ∇·v of curved elements exactly, so that a constant pressure does no work.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class _Class:
    """Velocity components (component, flow) that vanish at the same nodes, and their factor."""

    members: list[tuple[int, int]]
    free: IntArray
    kept: IntArray
    pattern: SymmetricPattern
    factor: SymmetricFactor


@dataclass(frozen=True, eq=False)
class _System:
    """Matrices of one shape of the pore."""

    divergence: list[sparse.csr_matrix]  #: ∫ ψ ∂v/∂x_i, (pressures, nodes) for each i
    mass: Array  #: (pressures,)  ∫ ψ
    load: Array  #: (nodes,)  ∫ N
    inverses: list[Callable[[Array], Array]]  #: x ↦ A⁻¹ x of the free nodes of each class, for columns


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
        self._classes = self._sorted(solver)

    def _sorted(self, solver: str) -> list[_Class]:
        alike: dict[bytes, list[tuple[int, int]]] = {}
        for j in range(3):
            for i, held in enumerate(held_velocities(self.mesh, j).T):
                alike.setdefault(held.tobytes(), []).append((i, j))
        found = []
        for pattern, members in alike.items():
            held = np.frombuffer(pattern, dtype=bool)
            free = np.setdiff1d(np.arange(self.n), self.mesh.periodic_class[held])
            indptr, indices, kept = self._scatter.pattern.restricted(free)
            factor = choose_factor(
                indptr, indices, solver=solver, near_kernel=np.ones((len(free), 1)), single=False
            )
            found.append(_Class(members, free, kept, SymmetricPattern(indptr, indices), factor))
        return found

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
        return _System(divergence, mass, load, [self._inverse(one, laplacian) for one in self._classes])

    def _inverse(self, one: _Class, laplacian: Array) -> Callable[[Array], Array]:
        data = laplacian[one.kept]
        matrix = one.pattern.full(data)
        one.factor.factor(data)

        return lambda rhs: (
            conjugate_gradients(matrix.dot, rhs, one.factor.solve, tolerance=1e-12, limit=100).x
        )

    def integrals(self, points: Array) -> Array:
        system = self._system(points)
        forces = np.zeros((3, self.n, 3))
        for i in range(3):
            forces[i, :, i] = system.load
        forced = self._solve(system, forces)

        def schur(pressures: Array) -> Array:
            return self._divergence(system, self._solve(system, self._gradient(system, pressures)))

        right = -self._divergence(system, forced)
        # Flow along a slit needs no pressure; what is left of its divergence is round-off, which has no solution.
        whole = sum(abs(system.divergence[i]) @ np.abs(forced[i]) for i in range(3))
        right[:, np.linalg.norm(right, axis=0) < ROUND_OFF * np.linalg.norm(whole, axis=0)] = 0.0
        solved = conjugate_gradients(
            schur, right, lambda r: r / system.mass[:, None], tolerance=TOLERANCE, limit=400
        )
        if not solved.converged:
            raise FactorError("conjugate gradients did not converge")
        w = forced + self._solve(system, self._gradient(system, solved.x))
        return np.asarray(np.einsum("inj,n->ij", w, system.load))

    def _solve(self, system: _System, rhs: Array) -> Array:
        """Return A⁻¹ applied to (components, nodes, flows)."""
        out = np.zeros_like(rhs)
        for one, inverse in zip(self._classes, system.inverses, strict=True):
            columns = inverse(np.stack([rhs[i, one.free, j] for i, j in one.members], axis=1))
            for (i, j), column in zip(one.members, columns.T, strict=True):
                out[i, one.free, j] = column
        return out

    def _divergence(self, system: _System, w: Array) -> Array:
        return np.asarray(sum(system.divergence[i] @ w[i] for i in range(3)) * self._even)

    def _gradient(self, system: _System, pressures: Array) -> Array:
        return np.stack([divergence.T @ (pressures * self._even) for divergence in system.divergence])
