"""Preconditioner of the u–p tangent: a cycle for the displacements, multigrid for the pressures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.linear_systems.coarse import LinearLevel
from porocore.states import Array
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.macro_smoother import Apply, ChebyshevSmoother

#: Unknowns of the linear level up to which a factor solves on it: at more, multigrid is faster.
FACTORED = 50_000
#: Nodes of the coarsest level of multigrid, and its cycles for the displacements.
COARSEST, CYCLES = 600, 2

Solve = Callable[[Array], Array]


class DisplacementCycle:
    """Approximate inverse of the forces by displacements in single precision: smoother, linear level, smoother.

    Parameters
    ----------
    matrix
        Forces by displacements in blocks of all nodes, whatever is prescribed.
    apply
        Product with it under the supports.
    level
        Linear displacements.
    smoother
        On the quadratic displacements.
    """

    def __init__(self, matrix: sparse.bsr_matrix, level: LinearLevel, smoother: ChebyshevSmoother) -> None:
        self._smoother = smoother
        blocks = level.prolongation.tobsr(blocksize=(3, 3))
        coarse = (blocks.T.tobsr(blocksize=(3, 3)) @ (matrix @ blocks)).tobsr(blocksize=(3, 3))
        idle = ~level.active
        mean = float(np.abs(coarse.diagonal()[level.active]).mean()) if level.active.any() else 1.0
        coarse = (coarse + sparse.diags(mean * idle)).tobsr(blocksize=(3, 3))
        coarse.sort_indices()
        self._prolongation = level.prolongation.astype(np.float32)
        self._restriction = self._prolongation.T.tocsr()
        self._solve = _inverse(coarse, level.modes, "block_gauss_seidel", CYCLES)

    def solve(self, apply: Apply, r: Array) -> Array:
        """Return the inverse applied to forces that are zero where prescribed, all in single precision."""
        x, r = self._smoother.smooth(apply, r)
        change = self._prolongation @ self._solve(self._restriction @ r).astype(np.float32)
        after, _ = self._smoother.smooth(apply, r - apply(change))
        return np.asarray(x + change + after)


def _inverse(matrix: Any, modes: Array, relaxation: str, cycles: int) -> Solve:
    """Return an approximate inverse: a factor, or cycles of multigrid that knows fields of little energy."""
    if matrix.shape[0] <= FACTORED and pardiso.library() is not None:
        rows = _with_symmetric_pattern(matrix)
        factor = pardiso.GeneralFactor(rows.indptr, rows.indices, single=True)
        try:
            factor.factor(rows.data)
        except FactorError:
            pass
        else:
            return factor.solve
    return _multigrid(matrix, modes, relaxation, cycles)


def _with_symmetric_pattern(matrix: Any) -> sparse.csr_matrix:
    """Return the matrix in sorted CSR with zeros where sums and products of matrices have left them out."""
    m = matrix.tocoo()
    diagonal = np.arange(m.shape[0])
    rows, columns = (np.concatenate([*pair, diagonal]) for pair in ((m.row, m.col), (m.col, m.row)))
    data = np.concatenate([m.data, np.zeros(len(rows) - len(m.data))])
    found = sparse.csr_matrix((data, (rows, columns)), shape=m.shape)
    found.sort_indices()
    return found


def pressure_cycle(matrix: sparse.csr_matrix, held: npt.NDArray[np.bool_]) -> Solve:
    """Return an approximate inverse of the Schur complement, with unit rows where the pressure is prescribed."""
    free = sparse.diags((~held).astype(float))
    matrix = (free @ matrix @ free + sparse.diags(held * float(np.abs(matrix.diagonal()).mean()))).tocsr()
    matrix.sort_indices()
    return _inverse(matrix, (~held).astype(float)[:, None], "gauss_seidel", 1)


def _multigrid(matrix: Any, modes: Array, relaxation: str, cycles: int) -> Solve:
    from pyamg import smoothed_aggregation_solver

    smoother = (relaxation, {"sweep": "symmetric"})
    with _same_random_numbers():
        hierarchy = smoothed_aggregation_solver(
            matrix,
            B=modes,
            symmetry="symmetric",
            strength=("symmetric", {"theta": 0.0}),
            presmoother=smoother,
            postsmoother=smoother,
            max_coarse=COARSEST,
            improve_candidates=None,
            coarse_solver="splu",
        )

    def solve(r: Array) -> Array:
        return np.asarray(hierarchy.solve(r, x0=np.zeros_like(r), tol=1e-300, maxiter=cycles, cycle="V"))

    return solve


@contextmanager
def _same_random_numbers() -> Iterator[None]:
    """Have pyamg, which estimates eigenvalues from numpy's global random numbers, do so alike every time."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
