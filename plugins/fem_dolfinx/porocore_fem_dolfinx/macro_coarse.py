"""Linear displacements as PETSc matrices: the coarse level of multigrid, and its rigid motions."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from porocore.core.parallel import Communicator
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.linear_systems.coarse import linear_level
from porocore.states import IntArray
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.macro_space import MacroSpace

#: Rigid modes that depend on the others by this share are left out: those that the supports leave nothing of.
DEPENDENT = 1e-10


class CoarseLevel:
    """Linear displacements, three at each corner; those that supports hold are there too, and take no part.

    Parameters
    ----------
    space, mesh, boundary
        Of the problem.
    rows : (displacements,)
        Numbers in the mesh of the displacements of this process's equations.

    Attributes
    ----------
    prolongation
        PETSc matrix from them to the displacements of the equations.
    """

    def __init__(
        self,
        space: MacroSpace,
        mesh: BodyMesh,
        boundary: BoundaryData,
        rows: IntArray,
        comm: MPI.Intracomm,
        communicator: Communicator,
    ) -> None:
        self._comm = comm
        level = linear_level(mesh, boundary)
        corners = space.unknowns[space.of_p[: space.owned_p]] - mesh.n_u
        own = (3 * corners[:, None] + np.arange(3)).ravel()
        self._size = len(own)
        self._first = comm.scan(self._size) - self._size
        number = np.zeros(3 * len(mesh.p_nodes))
        number[own] = self._first + np.arange(self._size)
        number = np.rint(communicator.sum(number)).astype(np.int64)
        local = level.prolongation[rows]
        sizes = ((len(rows), None), (self._size, None))
        self.prolongation = compat.make_matrix(comm, sizes, local.indptr, number[local.indices], local.data)
        self._idle = np.flatnonzero(~level.active[own])
        self._active = comm.allreduce(self._size - len(self._idle))
        self._modes = self._near_null_space(level.modes[own])
        self._product: PETSc.Mat | None = None
        self._matrix: PETSc.Mat | None = None

    def _near_null_space(self, modes: Any) -> PETSc.NullSpace:
        values, turn = np.linalg.eigh(self._comm.allreduce(modes.T @ modes))
        kept = values > DEPENDENT * max(values[-1], np.finfo(float).tiny)
        modes = modes @ (turn[:, kept] / np.sqrt(values[kept]))
        vectors = []
        for mode in modes.T:
            vector = PETSc.Vec().createMPI((self._size, None), bsize=3, comm=self._comm)
            vector.array[:] = mode
            vectors.append(vector)
        return PETSc.NullSpace().create(vectors=vectors, comm=self._comm)

    def matrix(self, fine: PETSc.Mat) -> PETSc.Mat:
        """Return PᵀAP; the rows of what takes no part have a diagonal alone. The last one is no longer valid."""
        self._product = fine.ptap(self.prolongation, result=self._product)
        diagonal = self._product.getDiagonal()
        mean = diagonal.sum() / max(self._active, 1)
        starts = np.searchsorted(self._idle, np.arange(self._size + 1))
        sizes = ((self._size, None), (self._size, None))
        padding = compat.make_matrix(
            self._comm, sizes, starts, self._first + self._idle, np.full(len(self._idle), mean)
        )
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix = self._product.copy()
        self._matrix.axpy(1.0, padding, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._matrix.setBlockSize(3)
        self._matrix.setNearNullSpace(self._modes)
        for part in (padding, diagonal):
            part.destroy()
        return self._matrix

    def destroy(self) -> None:
        """Free the matrices; all processes must do so together."""
        for part in (self._matrix, self._product, self.prolongation, self._modes):
            if part is not None:
                part.destroy()
