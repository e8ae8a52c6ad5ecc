"""Factor of a matrix with a narrow band by LAPACK, as of the equations of a column; the order for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee

from porocore.states import Array
from porocore_fem_skfem.factor import SingularError


class Band:
    """Order of equations in which a matrix has a narrow band, and its factors by LAPACK.

    Attributes
    ----------
    width
        Number of diagonals on either side.
    """

    def __init__(self, indices: npt.NDArray[np.int32], indptr: npt.NDArray[np.int32]) -> None:
        n = len(indptr) - 1
        pattern = sparse.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(n, n))
        self.order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        place = np.empty(n, dtype=np.int64)
        place[self.order] = np.arange(n)
        row, column = np.repeat(place, np.diff(indptr)), place[indices]
        self.width = int(np.abs(row - column).max(initial=0))
        #: LAPACK's storage, column after column, with room for the fill of row exchanges.
        self._shape = (3 * self.width + 1, n)
        self._places = column * self._shape[0] + 2 * self.width + row - column

    def factor(self, data: Array) -> _BandFactor:
        """Return the factor of the matrix with these entries, in the order of the pattern.

        Raises
        ------
        SingularError
            A pivot vanishes.
        """
        band = np.zeros(self._shape[0] * self._shape[1])
        band[self._places] = data
        band = band.reshape(self._shape, order="F")
        (factorise,) = get_lapack_funcs(("gbtrf",), (band,))
        factors, pivots, info = factorise(band, self.width, self.width, overwrite_ab=True)
        if info:
            raise SingularError("LAPACK: a pivot of the band vanished")
        return _BandFactor(self, factors, pivots)


class _BandFactor:
    def __init__(self, band: Band, factors: Array, pivots: npt.NDArray[np.int32]) -> None:
        self._band, self._factors, self._pivots = band, factors, pivots

    def solve(self, right: Array) -> Array:
        """Return x with A x = ``right``."""
        (substitute,) = get_lapack_funcs(("gbtrs",), (self._factors,))
        width, order = self._band.width, self._band.order
        x = np.empty_like(right)
        x[order], _ = substitute(self._factors, width, width, right[order], self._pivots)
        return x
