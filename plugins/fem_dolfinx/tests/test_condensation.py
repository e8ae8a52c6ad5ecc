"""Tᵀ A T with periodic images and held unknowns, and with entries that elements do not share."""

import numpy as np
import pytest
from scipy import sparse

from porocore_fem_dolfinx.cell_mesh import Condensation, to_petsc, to_scipy

N = 9
#: Dofs 0 and 8 are one, 3 is held.
IMAGES = np.array([0, 1, 2, 3, 4, 5, 6, 7, 0])
HELD = np.arange(N) == 3


def chain(seed=0):
    """A symmetric tridiagonal matrix."""
    rng = np.random.default_rng(seed)
    off = rng.normal(size=N - 1)
    return sparse.csr_matrix(sparse.diags([off, rng.normal(size=N) + 9.0, off], [-1, 0, 1]))


def dense(A):
    T = np.zeros((N, 7))
    for column, image in enumerate((0, 1, 2, 4, 5, 6, 7)):
        T[image == IMAGES, column] = 1.0
    return T.T @ A.toarray() @ T


def more(pairs):
    """Symmetric entries at pairs of dofs, in two halves that are to be added."""
    rows, columns = np.array([*pairs, *(pair[::-1] for pair in pairs)]).T
    return np.tile(rows, 2), np.tile(columns, 2), np.full(2 * len(rows), 0.25)


@pytest.mark.parametrize(
    ("pairs", "fits"),
    [
        ([(1, 2), (5, 6)], True),
        ([(7, 0)], True),  # as dof 8, an image of 0, is next to 7
        ([(2, 3)], True),  # held, so that it does not count
        ([(1, 5)], False),
        ([(1, 2), (8, 4)], False),
    ],
)
def test_further_entries(pairs, fits):
    """They are in the answer whether the pattern has room for them or not, and not in the next one."""
    condensation, A = Condensation(IMAGES, HELD), chain()
    full = to_petsc(A)
    alone = condensation.matrix(full)
    np.testing.assert_allclose(to_scipy(alone).toarray(), dense(A), atol=1e-14)
    rows, columns, values = more(pairs)
    extra = sparse.csr_matrix((values, (rows, columns)), shape=(N, N))
    together = condensation.matrix(full, (rows, columns, values))
    assert (together == alone) is fits
    np.testing.assert_allclose(to_scipy(together).toarray(), dense(A + extra), atol=1e-14)
    B = chain(1)
    np.testing.assert_allclose(to_scipy(condensation.matrix(to_petsc(B))).toarray(), dense(B), atol=1e-14)
    if not fits:
        np.testing.assert_allclose(to_scipy(together).toarray(), dense(A + extra), atol=1e-14)


def test_vectors():
    condensation = Condensation(IMAGES, HELD)
    assert condensation.size == 7
    x = np.arange(1.0, 8.0)
    full = condensation.expand(x)
    assert full[0] == full[8] == 1.0
    assert full[3] == 0.0
    np.testing.assert_allclose(condensation.restrict(full), x)
    np.testing.assert_allclose(condensation.reduce(full), x * [2, 1, 1, 1, 1, 1, 1])
