"""PARDISO, the sparse direct solver of Intel's Math Kernel Library, through its C interface.

The wrappers on the package index know neither the separate phases, nor single precision, nor the inertia,
which are what makes a cell solve fast and shows whether its tangent is indefinite.
"""

from __future__ import annotations

import ctypes
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.equilibrium.discrete import FactorError
from porocore.states import Array
from porocore_fem_skfem.factor import (
    Indices,
    OutOfMemoryError,
    SingularError,
    SparseFactor,
    SymmetricFactor,
    check_symmetric,
)

_ANALYSE, _FACTOR, _SOLVE, _RELEASE = 11, 22, 33, -1
_DEFINITE, _SYMMETRIC_INDEFINITE, _STRUCTURALLY_SYMMETRIC = 2, -2, 1
#: Unknowns up to which minimum degree orders them. At 3,000 it takes a third of the time of nested dissection, and the
#: factors take the same; at 8,000 they take a fifth longer.
MINIMUM_DEGREE = 5_000
#: What the error codes of the library mean, by its reference manual.
_ERRORS: dict[int, tuple[type[FactorError], str]] = {
    -1: (FactorError, "the input is inconsistent"),
    -2: (OutOfMemoryError, "there is not enough memory for the factor"),
    -3: (FactorError, "no ordering of the unknowns was found"),
    -4: (SingularError, "a pivot vanished"),
    -6: (FactorError, "no ordering of the unknowns was found"),
    -7: (SingularError, "the diagonal is singular"),
    -8: (OutOfMemoryError, "the factor has more entries than 32-bit integers can count"),
}


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL | None:
    """Return the loaded library, set to one thread; None where it is not installed."""
    folders = [Path(sys.prefix) / "lib", Path(sys.prefix) / "Library" / "bin", Path(sys.base_prefix) / "lib"]
    for folder in folders:
        for path in sorted([*folder.glob("libmkl_rt.so*"), *folder.glob("mkl_rt*.dll")]):
            try:
                mkl = ctypes.CDLL(str(path))
            except OSError:
                continue
            mkl.MKL_Set_Interface_Layer(0)  # 32-bit integers
            # Sequential: parallel solves share the cores better than threads do.
            mkl.MKL_Set_Threading_Layer(1)
            return mkl
    return None


class _Session:
    """One kind of factorisation of one checked pattern in CSR, which is analysed once.

    Parameters
    ----------
    indptr, indices
        Pattern.
    kind
        Type of the matrix by the library's reference manual.
    options
        Entries of ``iparm``.
    dtype
        Precision.
    order
        Order of the unknowns of another session of this pattern; None: it is found.
    """

    def __init__(
        self,
        indptr: Indices,
        indices: Indices,
        kind: int,
        options: dict[int, int],
        dtype: npt.DTypeLike,
        order: Indices | None = None,
    ) -> None:
        self._kind, self._n = kind, len(indptr) - 1
        self._indptr = np.ascontiguousarray(indptr, dtype=np.int32) + np.int32(1)
        self._indices = np.ascontiguousarray(indices, dtype=np.int32) + np.int32(1)
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        given = {0: 1, 1: _ordering(self._n), 4: 2 if order is None else 1}
        for place, value in {**given, **options, 27: int(dtype == np.float32)}.items():
            self._iparm[place] = value
        self.order = np.zeros(self._n, dtype=np.int32) if order is None else order
        self._data = np.zeros(len(indices), dtype=dtype)
        self._analysed = self.factored = False

    @property
    def negative(self) -> int:
        """Number of negative pivots of a factor that counts them."""
        return int(self._iparm[22])

    def factor(self, data: Array) -> None:
        """Factorise a matrix with these entries (nnz,)."""
        self._data[:] = data
        self.factored = False
        if not self._analysed:
            self._call(_ANALYSE)
            self._analysed = True
            self._iparm[4] = 1  # the order is known from now on
        self._call(_FACTOR)
        self.factored = True

    def solve(self, rhs: Array) -> Array:
        """Return the inverse applied to (n,) or (n, k)."""
        if not self.factored:
            raise FactorError("there is no factor to solve with")
        # Pardiso wants the right-hand sides column after column.
        b = np.array(rhs.T, order="C")
        x = np.empty_like(b)
        self._call(_SOLVE, b, x)
        return x.T.astype(np.float64)

    def release(self) -> None:
        """Give back the memory of the factor."""
        if self._analysed:
            self._call(_RELEASE)
            self._analysed = self.factored = False

    def _call(self, phase: int, b: Array | None = None, x: Array | None = None) -> None:
        def integer(value: int) -> object:
            return ctypes.byref(ctypes.c_int32(value))

        def pointer(array: npt.NDArray[Any] | None) -> ctypes.c_void_p | None:
            return None if array is None else array.ctypes.data_as(ctypes.c_void_p)

        error = ctypes.c_int32(0)
        count = 1 if b is None or b.ndim == 1 else b.shape[0]
        mkl = library()
        assert mkl is not None
        mkl.pardiso(
            pointer(self._handle),
            *map(integer, (1, 1, self._kind, phase, self._n)),
            *map(pointer, (self._data, self._indptr, self._indices, self.order)),
            integer(count),
            pointer(self._iparm),
            integer(0),
            pointer(b),
            pointer(x),
            ctypes.byref(error),
        )
        if error.value:
            kind, meaning = _ERRORS.get(error.value, (FactorError, "an internal error"))
            raise kind(
                f"PARDISO ended phase {phase} of {self._n} unknowns with error {error.value}: {meaning}"
            )

    def __del__(self) -> None:
        if getattr(self, "_analysed", False) and not sys.is_finalizing():
            self.release()


def _ordering(n: int) -> int:
    """Return the option for the order of n unknowns: by minimum degree or by nested dissection."""
    return 0 if n <= MINIMUM_DEGREE else 2


class PardisoFactor(SymmetricFactor):
    """Cholesky factor of a definite matrix, LDLᵀ with Bunch–Kaufman pivoting of any other; in single precision.

    A Cholesky factor takes three quarters of the time and counts nothing; it breaks down at the first negative pivot.
    """

    def __init__(self, indptr: Indices, indices: Indices, *, single: bool = True) -> None:
        super().__init__(indptr, indices, np.float32 if single else np.float64)
        self._pattern = indptr, indices
        self._definite = _Session(indptr, indices, _DEFINITE, {}, self.dtype)
        self._other: _Session | None = None
        self.negative = 0

    def factor_definite(self, data: Array) -> bool:
        entries = self._checked(data, ((self.nnz,),), "matrix")
        self._release_other()
        try:
            self._definite.factor(entries)
        except SingularError:
            return False
        self.negative = 0
        return True

    def _factor(self, data: Array) -> None:
        if self.factor_definite(data):
            return
        order = self._definite.order
        self._definite.release()
        options = {9: 8, 20: 1}
        self._other = _Session(*self._pattern, _SYMMETRIC_INDEFINITE, options, self.dtype, order)
        self._other.factor(data)
        self.negative = self._other.negative

    def _release_other(self) -> None:
        if self._other is not None:
            self._other.release()
            self._other = None

    def _solve(self, rhs: Array) -> Array:
        return (self._other or self._definite).solve(rhs)


class GeneralFactor(SparseFactor):
    """LU of a matrix in CSR whose pattern is symmetric, its values not."""

    check = staticmethod(check_symmetric)

    def __init__(self, indptr: Indices, indices: Indices, *, single: bool) -> None:
        super().__init__(indptr, indices, np.float32 if single else np.float64)
        self._session = _Session(indptr, indices, _STRUCTURALLY_SYMMETRIC, {1: 2, 9: 13}, self.dtype)

    def _factor(self, data: Array) -> None:
        self._session.factor(data)

    def _solve(self, rhs: Array) -> Array:
        return self._session.solve(rhs)
