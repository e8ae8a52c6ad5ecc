"""Residual, tangent and linear solve of the u–p problem from the law's response at all quadrature points.

All elements are congruent, so an integral over an element is a product with a constant matrix and the
assembly is a handful of large matrix products followed by one product with a sparse matrix of zeros and ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from porocore.laws import MacroResponse, MacroTangent
from porocore.macro.boundary import BoundaryData
from porocore.macro.discretisation import Discretisation, StepFailed
from porocore.macro.mesh import BoxMesh
from porocore.states import MacroState
from porocore_fem_skfem.macro_space import make_reference


@dataclass(frozen=True, eq=False)
class System:
    """The tangent, split into equations and prescribed unknowns."""

    free: Any  #: scipy CSC, equations × equations
    coupling: Any  #: scipy CSR, equations × prescribed


class Assembler(Discretisation):
    """Constant matrices and sparsity; local node a of u_i has column 27 i + a, then come the pressures."""

    def __init__(self, mesh: BoxMesh, boundary: BoundaryData) -> None:
        super().__init__(
            mesh,
            boundary,
            unknowns=np.arange(mesh.size),
            owned=mesh.size,
            elements=np.arange(len(mesh.cells)),
            dofs=np.concatenate([*(3 * mesh.cells + i for i in range(3)), mesh.n_u + mesh.p_cells], axis=1),
        )
        self.reference = ref = make_reference(mesh)
        w, g, N, gp = ref.weights, ref.grad_u, ref.p, ref.grad_p
        q = len(w)
        wg, wN, wgp = w[:, None, None] * g, w[:, None] * N, w[:, None, None] * gp
        # Rows run over (q, tensor indices), columns over local nodes (test before trial).
        self._force = wg.transpose(0, 2, 1).reshape(3 * q, 27)
        self._volume, self._flow = wN, wgp.transpose(0, 2, 1).reshape(3 * q, 8)
        self._uu = np.einsum("qaj,qbl->qjlab", wg, g).reshape(9 * q, -1)
        self._up = np.einsum("qaj,qb->qjab", wg, N).reshape(3 * q, -1)
        self._pu = np.concatenate(
            [
                np.einsum("qb,qal->qlba", wN, g).reshape(3 * q, -1),
                np.einsum("qbm,qal->qmlba", wgp, g).reshape(9 * q, -1),
            ]
        )
        self._pp = np.concatenate(
            [
                np.einsum("qb,qc->qbc", wN, N).reshape(q, -1),
                np.einsum("qbm,qc->qmbc", wgp, N).reshape(3 * q, -1),
                np.einsum("qbm,qcn->qmnbc", wgp, gp).reshape(9 * q, -1),
            ]
        )
        self._build_patterns()

    def _build_patterns(self) -> None:
        free_slot, fixed_slot = np.full((2, self.mesh.size), -1, dtype=np.int64)
        n, k = int(self.leading.sum()), len(self.prescribed)
        #: Equation of each free unknown; those of a plate share one.
        self._equation = np.empty(len(self.free), dtype=np.int64)
        self._equation[self.leading] = np.arange(n)
        for places in self.plates:
            self._equation[places] = self._equation[places[0]]
        free_slot[self.free] = self._equation
        fixed_slot[self.prescribed] = np.arange(len(self.prescribed))
        u, p = self.dofs[:, :81].reshape(-1, 3, 27), self.dofs[:, 81:]
        e = len(u)
        # Blocks in the order in which the products leave them:
        # (e, i, k, a, b), (e, i, a, b), (e, k, b, a), (e, b, c).
        shapes = [(e, 3, 3, 27, 27), (e, 3, 27, 8), (e, 3, 8, 27), (e, 8, 8)]
        rows = [u[:, :, None, :, None], u[:, :, :, None], p[:, None, :, None], p[:, :, None]]
        columns = [u[:, None, :, None, :], p[:, None, None, :], u[:, :, None, :], p[:, None, :]]
        self._ends = np.cumsum([0, *(int(np.prod(s)) for s in shapes)])
        self._entries = np.empty(self._ends[-1])
        row = np.concatenate([np.broadcast_to(r, s).ravel() for r, s in zip(rows, shapes, strict=True)])
        column = np.concatenate([np.broadcast_to(c, s).ravel() for c, s in zip(columns, shapes, strict=True)])
        self._free = _Pattern(free_slot[column], free_slot[row], (n, n))
        self._coupling = _Pattern(free_slot[row], fixed_slot[column], (n, k))

    def states(self, x: Any) -> tuple[MacroState, Any]:
        """See :class:`~porocore.macro.discretisation.Discretisation`."""
        ref, elements = self.reference, len(self.elements)
        local = x[self.dofs]
        q = len(ref.weights)
        grad_u = local[:, :81].reshape(elements * 3, 27) @ ref.grad_u.transpose(1, 0, 2).reshape(27, -1)
        grad_u = grad_u.reshape(elements, 3, q, 3).swapaxes(1, 2).reshape(-1, 3, 3)
        p = local[:, 81:] @ ref.p.T
        grad_p = local[:, 81:] @ ref.grad_p.transpose(1, 0, 2).reshape(8, -1)
        return MacroState(grad_u, p.ravel()), grad_p.reshape(-1, 3)

    def contributions(self, response: MacroResponse) -> tuple[Any, Any, Any]:
        """See :class:`~porocore.macro.discretisation.Discretisation`."""
        e = len(self.elements)
        stress = response.stress.reshape(e, -1, 3, 3).swapaxes(1, 2).reshape(3 * e, -1)
        stored = response.storage.reshape(e, -1) @ self._volume
        return (stress @ self._force).reshape(e, 81), stored, response.flux.reshape(e, -1) @ self._flow

    def system(self, tangent: MacroTangent, dt: float) -> System:
        """Assembled."""
        e = len(self.elements)
        out = [self._entries[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]
        stiffness = tangent.stress_grad_u.reshape(e, -1, 3, 3, 3, 3).transpose(0, 2, 4, 1, 3, 5)
        np.matmul(stiffness.reshape(9 * e, -1), self._uu, out=out[0].reshape(9 * e, -1))
        stress_p = tangent.stress_p.reshape(e, -1, 3, 3).swapaxes(1, 2)
        np.matmul(stress_p.reshape(3 * e, -1), self._up, out=out[1].reshape(3 * e, -1))
        storage = tangent.storage_grad_u.reshape(e, -1, 3, 3).swapaxes(1, 2).reshape(3 * e, -1)
        flux = tangent.flux_grad_u.reshape(e, -1, 3, 3, 3).transpose(0, 3, 1, 2, 4).reshape(3 * e, -1)
        np.matmul(np.concatenate([storage, -dt * flux], axis=1), self._pu, out=out[2].reshape(3 * e, -1))
        by_p = [tangent.storage_p, -dt * tangent.flux_p, -dt * tangent.flux_grad_p]
        rows = np.concatenate([part.reshape(e, -1) for part in by_p], axis=1)
        np.matmul(rows, self._pp, out=out[3].reshape(e, -1))
        return System(
            self._free.matrix(self._entries, sparse.csc_matrix),
            self._coupling.matrix(self._entries, sparse.csr_matrix),
        )

    def magnitudes(self, system: System, x: Any) -> Any:
        """|A| |x| in the free rows."""
        terms, leading = np.zeros(len(x)), self.free[self.leading]
        terms[leading] = abs(system.free) @ np.abs(x[leading])
        terms[leading] += abs(system.coupling) @ np.abs(x[self.prescribed])
        return terms

    def solve(self, system: System, right: Any, jump: Any) -> Any:
        """By SuperLU."""
        change = np.zeros(len(right))
        change[self.prescribed] = jump
        right = self.equations(right)
        if jump.any():
            right = right - system.coupling @ jump
        try:
            change[self.free] = splu(system.free).solve(right)[self._equation]
        except RuntimeError as error:
            raise StepFailed(f"{error}: the body may not be held against rigid motions") from error
        if not np.isfinite(change).all():
            raise StepFailed("the tangent is singular: the body may not be held against rigid motions")
        return change


class _Pattern:
    """Sums entries at (major, minor) into compressed storage; a negative index leaves an entry out."""

    def __init__(self, major: Any, minor: Any, shape: tuple[int, int]) -> None:
        kept = np.flatnonzero((major >= 0) & (minor >= 0))
        width = max(int(minor[kept].max(initial=0)) + 1, 1)
        unique, slot = np.unique(major[kept] * width + minor[kept], return_inverse=True)
        majors = int(shape[0])
        self._shape = shape
        self._indices = (unique % width).astype(np.int32)
        self._indptr = np.searchsorted(unique // width, np.arange(majors + 1)).astype(np.int32)
        order = np.argsort(slot.ravel(), kind="stable")
        starts = np.searchsorted(slot.ravel()[order], np.arange(len(unique) + 1))
        self._sum = sparse.csr_matrix(
            (np.ones(len(kept)), kept[order], starts), shape=(len(unique), len(major))
        )

    def matrix(self, entries: Any, kind: Any) -> Any:
        """Compressed by columns (major = column; square) or by rows (major = row)."""
        return kind((self._sum @ entries, self._indices, self._indptr), shape=self._shape)
