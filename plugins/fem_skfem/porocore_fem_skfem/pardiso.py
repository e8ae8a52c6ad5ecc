"""PARDISO, the sparse direct solver of Intel's Math Kernel Library, by its C interface.

The wrappers on the package index know neither the separate phases, nor single precision, nor the inertia,
which are what makes a cell solve fast and tells whether its tangent is indefinite.
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
from porocore_fem_skfem.checks import Indices, check_symmetric
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError, SparseFactor, SymmetricFactor

_ANALYSE, _FACTOR, _SOLVE, _RELEASE = 11, 22, 33, -1
_SYMMETRIC_INDEFINITE, _STRUCTURALLY_SYMMETRIC = -2, 1
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


class _Pardiso(SparseFactor):
    """Solver for one pattern in CSR, which is analysed once."""

    def __init__(
        self, indptr: Indices, indices: Indices, kind: int, options: dict[int, int], single: bool
    ) -> None:
        super().__init__(indptr, indices, np.float32 if single else np.float64)
        self._kind = kind
        self._indptr = np.ascontiguousarray(indptr, dtype=np.int32) + np.int32(1)
        self._indices = np.ascontiguousarray(indices, dtype=np.int32) + np.int32(1)
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        self._iparm[0] = 1
        for place, value in {**options, 27: int(single)}.items():
            self._iparm[place] = value
        self._data = np.zeros(len(indices), dtype=self.dtype)
        self._analysed = self._factored = False

    def _factor(self, data: Array) -> None:
        self._data[:] = data
        self._factored = False
        if not self._analysed:
            self._call(_ANALYSE)
            self._analysed = True
        self._call(_FACTOR)
        self._factored = True

    def _solve(self, rhs: Array) -> Array:
        if not self._factored:
            raise FactorError("there is no factor to solve with")
        # Pardiso wants the right-hand sides column after column.
        b = np.array(rhs.T, order="C")
        x = np.empty_like(b)
        self._call(_SOLVE, b, x)
        return x.T.astype(np.float64)

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
            *map(integer, (1, 1, self._kind, phase, self.n)),
            *map(pointer, (self._data, self._indptr, self._indices)),
            None,
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
                f"PARDISO ended phase {phase} of {self.n} unknowns with error {error.value}: {meaning}"
            )

    def __del__(self) -> None:
        if getattr(self, "_analysed", False) and not sys.is_finalizing():
            self._call(_RELEASE)
            self._analysed = False


class PardisoFactor(_Pardiso, SymmetricFactor):
    """LDLᵀ with Bunch–Kaufman pivoting of an upper triangle; in single precision by default."""

    def __init__(self, indptr: Indices, indices: Indices, *, single: bool = True) -> None:
        super().__init__(indptr, indices, _SYMMETRIC_INDEFINITE, {1: 2, 9: 8, 20: 1}, single)
        self.negative = 0

    def _factor(self, data: Array) -> None:
        super()._factor(data)
        self.negative = int(self._iparm[22])


class GeneralFactor(_Pardiso):
    """LU of a matrix in CSR whose pattern is symmetric, its values not."""

    check = staticmethod(check_symmetric)

    def __init__(self, indptr: Indices, indices: Indices, *, single: bool) -> None:
        super().__init__(indptr, indices, _STRUCTURALLY_SYMMETRIC, {1: 2, 9: 13}, single)
