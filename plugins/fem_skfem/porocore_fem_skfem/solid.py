"""The solid cell problem on one domain: energy, residual, tangent and averages of Π = ∫ (Ψ(F) + pJ) dV.

Nothing here solves; see :mod:`porocore_fem_skfem.newton` and :mod:`porocore_fem_skfem.responses`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.cell.material import NeoHookean, cofactor, determinant
from porocore.cell.mesh import CellMesh
from porocore_fem_skfem.factor import SymmetricFactor
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor
from porocore_fem_skfem.operators import Operators, Scatter

#: Numbers in a batch of element blocks that stays in the processor's cache.
CACHED = 60_000


@dataclass
class Point:
    """Kinematics at one iterate, shared by energy, residual and tangent; component-first (3, 3, points)."""

    F: Any
    J: Any
    cof: Any
    p: float

    @property
    def F_inverse_T(self) -> Any:
        return self.cof / self.J


class Constraints:
    """A set of free unknowns with its matrix pattern and the factors that serve it.

    ``base`` is the undeformed cell's and never changes, so that a solve does not depend on the one before it;
    ``own`` is renewed within a solve. ``active`` is the one in use.
    """

    def __init__(self, scatter: Scatter, free: Any, solver: str) -> None:
        self.free = free
        indptr, indices, self._kept = scatter.restricted(free)
        self.pattern = SymmetricPattern(indptr, indices)
        translations = np.zeros((len(free), 3))
        translations[np.arange(len(free)), free // (scatter.n // 3)] = 1.0

        def make() -> SymmetricFactor:
            return choose_factor(indptr, indices, solver=solver, near_kernel=translations)

        self._make = make
        self._base: SymmetricFactor | None = None
        self._own: SymmetricFactor | None = None
        self._factored: Any = None
        self.active: SymmetricFactor | None = None

    def restrict(self, data: Any) -> Any:
        """Entries of the constrained matrix from those of the whole one."""
        return data[self._kept]

    def begin(self, undeformed: Callable[[], Any]) -> None:
        """Use the undeformed cell's factor, made of ``undeformed()`` when it is first needed."""
        if self._base is None:
            self._base = self._make()
            self._base.factor(self.restrict(undeformed()))
        self.active, self._factored = self._base, None

    def renew(self, entries: Any) -> int:
        """Make ``entries`` the active factor; returns the number of negative pivots, -1 where unknown."""
        if self._factored is not entries:
            if self._own is None:
                self._own = self._make()
            # Should the factorisation break down, what is left of it must not be used.
            self.active, self._factored = self._base, None
            self._own.factor(entries)
            self.active, self._factored = self._own, entries
        assert self._own is not None
        return self._own.negative

    @property
    def counts(self) -> bool:
        """Whether the active factor is a direct one, which counts negative pivots and serves indefinite matrices."""
        return self.active is not None and self.active.negative >= 0

    def precondition(self, rhs: Any) -> Any:
        """Apply the active factor."""
        assert self.active is not None
        return self.active.solve(rhs)


class SolidProblem:
    """The discrete solid problem on the eighth or on the whole cell.

    On the eighth, u¹·n = 0 on its six planes for diagonal H and p; ``constraints("xy")`` are those of a
    perturbation H_12 or H_21: odd under the mirrors of x and y.
    """

    def __init__(self, mesh: CellMesh, material: NeoHookean, *, degree: int, solver: str) -> None:
        self.mesh, self.material, self.solver = mesh, material, solver
        self.nodes = mesh.periodic_class
        self.n_nodes = int(self.nodes.max()) + 1
        self.operators = Operators(mesh, degree, self.nodes[mesh.cells])
        self.B = self.operators.gradient(self.n_nodes)
        self.B_T = self.B.T.tocsr()
        self.w = self.operators.weights
        self.grad_N = self.operators.grad_N
        #: The domain's images fill the cell this many times.
        self.copies = 8.0 if mesh.domain == "eighth" else 1.0
        cells = self.operators.cells
        self.scatter = Scatter(
            np.concatenate([cells + i * self.n_nodes for i in range(3)], axis=1), 3 * self.n_nodes
        )
        self._laplacian = self._constant_blocks()
        self._constraints: dict[str, Constraints] = {}

    # ---- constraints ----------------------------------------------------------------------------

    def constraints(self, odd: str = "") -> Constraints:
        """Free unknowns for fields that are odd under the mirrors of the named axes (eighth only)."""
        if odd not in self._constraints:
            fixed = np.zeros((3, self.n_nodes), dtype=bool)
            if self.mesh.domain == "whole":
                fixed[:, 0] = True  # a translation changes nothing
            else:
                on_plane = (self.mesh.points == 0.0) | (self.mesh.points == 0.5)
                for axis in range(3):
                    held = [i for i in range(3) if (i != axis) == ("xyz"[axis] in odd)]
                    for i in held:
                        fixed[i, on_plane[:, axis]] = True
            self._constraints[odd] = Constraints(self.scatter, np.flatnonzero(~fixed.ravel()), self.solver)
        return self._constraints[odd]

    def begin(self) -> None:
        """Forget the factors of the last solve."""
        self.constraints().begin(self._undeformed_tangent)

    def _undeformed_tangent(self) -> Any:
        still = self.point(np.zeros((3, 3)), 0.0, np.zeros((3, 3, self.operators.n_points)))
        return self.tangent(still)

    # ---- physics --------------------------------------------------------------------------------

    def gradient(self, u: Any) -> Any:
        """∂u_i/∂Y_j (3, 3, points) of u (3, nodes)."""
        n = self.operators.n_points
        return np.stack([(self.B @ u_i).reshape(3, n) for u_i in u])

    def point(self, H: Any, p: float, grad: Any) -> Point:
        """Kinematics at F = I + H + ∇u¹."""
        F = grad + (np.eye(3) + H)[:, :, None]
        view = np.moveaxis(F, -1, 0)
        return Point(F, determinant(view), np.moveaxis(cofactor(view), 0, -1), p)

    def energy_density(self, at: Point) -> Any:
        """Ψ (points)."""
        mu = self.material.mu
        return mu / 2 * ((at.F * at.F).sum(axis=(0, 1)) - 3) + self.material.volumetric(np.log(at.J))[0]

    def energy(self, at: Point) -> float:
        """Π over the domain."""
        return float(self.w @ (self.energy_density(at) + at.p * at.J))

    def stress(self, at: Point) -> Any:
        """P + p cof F (3, 3, points)."""
        first = self.material.volumetric(np.log(at.J))[1]
        return self.material.mu * at.F + (first / at.J + at.p) * at.cof

    def assemble(self, stress: Any) -> Any:
        """∫ S:∇v for all nodal v, (3, nodes), of S (3, 3, points)."""
        weighted = (stress * self.w).reshape(3, -1)
        return np.stack([self.B_T @ row for row in weighted])

    def tangent_apply(self, at: Point, dF: Any) -> Any:
        """A:δF + p δcof F (3, 3, points) for δF (3, 3, points) or (3, 3, 1)."""
        G = at.F_inverse_T
        _, first, second = self.material.volumetric(np.log(at.J))
        pJ = at.p * at.J
        trace = (G * dF).sum(axis=(0, 1))
        # G_il δF_kl G_kj = (G δFᵀ G)_ij, written out for the component-first layout.
        inner = np.stack([[(G[i] * dF[k]).sum(axis=0) for k in range(3)] for i in range(3)])
        swapped = np.stack([[(inner[i] * G[:, j]).sum(axis=0) for j in range(3)] for i in range(3)])
        return (second + pJ) * trace * G - (first + pJ) * swapped + self.material.mu * dF

    def tangent(self, at: Point) -> Any:
        """Upper triangle of ∂²Π/∂u² over all unknowns, entries in the order of the scatter's pattern."""
        _, first, second = self.material.volumetric(np.log(at.J))
        pJ = at.p * at.J
        e, q, a, _ = self.grad_N.shape
        F_inverse = np.ascontiguousarray(np.moveaxis(at.F_inverse_T, -1, 0)).transpose(0, 2, 1)
        g = np.matmul(self.grad_N.reshape(e * q, a, 3), F_inverse).transpose(0, 2, 1).reshape(e, q, 3 * a)
        d = (self.w * (second + pJ)).reshape(e, q, 1)
        c = (self.w * (first + pJ)).reshape(e, q, 1)
        blocks = np.empty((e, 3, a, 3, a))
        chunk = max(1, CACHED // (3 * a) ** 2)
        for k in range(0, e, chunk):
            part = slice(k, k + chunk)
            g_T = g[part].transpose(0, 2, 1)
            if q == 1:
                plus, minus = g_T * (d[part] * g[part]), g_T * (c[part] * g[part])
            else:
                g_T = np.ascontiguousarray(g_T)
                plus, minus = np.matmul(g_T, d[part] * g[part]), np.matmul(g_T, c[part] * g[part])
            shape = (-1, 3, a, 3, a)
            np.subtract(plus.reshape(shape), minus.reshape(shape).transpose(0, 3, 2, 1, 4), out=blocks[part])
        return self.scatter(blocks) + self._laplacian

    def _constant_blocks(self) -> Any:
        """The part μ ∇N_a·∇N_b δ_ij of the tangent, which no state changes."""
        e, q, a, _ = self.grad_N.shape
        flat = self.grad_N.transpose(0, 2, 1, 3).reshape(e, a, q * 3)
        weights = np.repeat(self.w.reshape(e, 1, q), 3, axis=2)
        laplacian = self.material.mu * np.matmul(flat * weights, flat.transpose(0, 2, 1))
        blocks = np.zeros((e, 3, a, 3, a))
        for i in range(3):
            blocks[:, i, :, i, :] = laplacian
        return self.scatter(blocks)
