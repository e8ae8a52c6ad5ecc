"""Block preconditioner of a macro step with PETSc's multigrid, and its coarse level."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from porocore.core.parallel import Communicator
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.linear_systems import linear_level
from porocore.states import IntArray
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.macro_space import MacroSpace
from porocore_fem_dolfinx.petsc_options import OptionValue, SolverOptions

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


#: Names as of PETSc's field split. On the quadratic level one symmetric Gauss-Seidel sweep before and after, then two
#: cycles of algebraic multigrid on the linear level. At 91,000 unknowns and Δt = 1e-6, 1e-2: 18, 15 iterations, 0.8 and
#: 0.7 s; Chebyshev of degree 2 with one cycle, 20, 18 and 1.5 s; with two cycles 18, 13 and 1.3 s.
#: Coarse levels of gamg may have rows of zeros, which Jacobi alone survives.
DEFAULTS: dict[str, OptionValue] = {
    "ksp_type": "gmres",
    "ksp_gmres_restart": 80,
    "ksp_gmres_cgs_refinement_type": "refine_always",
    "fieldsplit_u_ksp_type": "preonly",
    "fieldsplit_u_pc_type": "mg",
    "fieldsplit_u_mg_levels_ksp_type": "richardson",
    "fieldsplit_u_mg_levels_ksp_max_it": 1,
    "fieldsplit_u_mg_levels_pc_type": "sor",
    "fieldsplit_u_mg_coarse_ksp_type": "richardson",
    "fieldsplit_u_mg_coarse_ksp_max_it": 2,
    "fieldsplit_u_mg_coarse_pc_type": "gamg",
    "fieldsplit_u_mg_coarse_mg_levels_ksp_type": "chebyshev",
    "fieldsplit_u_mg_coarse_mg_levels_ksp_max_it": 2,
    "fieldsplit_u_mg_coarse_mg_levels_pc_type": "jacobi",
    "fieldsplit_p_ksp_type": "preonly",
    "fieldsplit_p_pc_type": "gamg",
    "fieldsplit_p_mg_levels_ksp_type": "chebyshev",
    "fieldsplit_p_mg_levels_ksp_max_it": 2,
    "fieldsplit_p_mg_levels_pc_type": "sor",
}
#: What goes before these for stretched elements. Hexahedra of 1:10, of 1:50 and a wedge of 15° took more than 80, more
#: than 80 and 39 iterations, and with this 31, 54 and 22, each of which costs twice as much.
STRONG: dict[str, OptionValue] = {
    "fieldsplit_u_mg_levels_ksp_type": "chebyshev",
    "fieldsplit_u_mg_levels_ksp_max_it": 3,
}
#: Iterations at most. Bodies of moderate elements take 10 to 25, stretched ones (1:10, wedges of 15°) up to 40.
ITERATIONS = 80


class BlockTriangular:
    """Preconditioner u = Â⁻¹ r_u, p = Ŝ⁻¹ (r_p − C u) of a matrix ((A, B), (C, D)), whose rows of u come first.

    Attributes
    ----------
    of_u, of_p
        Solvers by Â and Ŝ.
    coupling
        The block C.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.of_u, self.of_p = PETSc.KSP().create(comm), PETSc.KSP().create(comm)
        self.coupling: PETSc.Mat | None = None
        self._work: tuple[PETSc.Vec, ...] = ()

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Apply it; PETSc calls this."""
        assert self.coupling is not None
        if not self._work:
            u, p = self.coupling.createVecs()
            self._work = u, u.duplicate(), p, p.duplicate(), p.duplicate()
        u, r_u, p, r_p, moved = self._work
        given, n_u = b.getArray(readonly=True), u.getLocalSize()
        r_u.array[:], r_p.array[:] = given[:n_u], given[n_u:]
        self.of_u.solve(r_u, u)
        self.coupling.mult(u, moved)
        r_p.axpy(-1.0, moved)
        self.of_p.solve(r_p, p)
        found = x.array
        found[:n_u], found[n_u:] = u.getArray(readonly=True), p.getArray(readonly=True)

    def free(self) -> None:
        """Free the hierarchies."""
        for part in (self.of_u, self.of_p, self.coupling, *self._work):
            if part is not None:
                part.destroy()


class MultigridSolver:
    """GMRES with a block triangular preconditioner, for matrices of one pattern.

    Parameters
    ----------
    comm
        MPI communicator.
    petsc
        Options of the user, which go before :data:`DEFAULTS`.
    key
        Place in the configuration, for messages.
    is_force : (equations,)
        True for the unknowns of this process's equations that are displacements, which come first.
    level
        The linear level of the displacements.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        petsc: Mapping[str, OptionValue],
        key: str,
        is_force: npt.NDArray[np.bool_],
        level: CoarseLevel,
    ) -> None:
        self.options = SolverOptions(DEFAULTS, petsc, key)
        self._comm, self._level, self._key = comm, level, key
        self._may_strengthen = not petsc
        self._n_u, self._n = int(is_force.sum()), len(is_force)
        self._inverse = BlockTriangular(comm)
        self._inverse.of_u.setOptionsPrefix(f"{self.options.prefix}fieldsplit_u_")
        self._inverse.of_p.setOptionsPrefix(f"{self.options.prefix}fieldsplit_p_")
        self._ksp = compat.freed_before_python(PETSc.KSP().create(comm))
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        pc = self._ksp.getPC()
        pc.setType("python")
        pc.setPythonContext(self._inverse)
        self._ksp.setTolerances(max_it=ITERATIONS)
        self.options.apply(self._ksp)
        self._fields: tuple[PETSc.IS, PETSc.IS] | None = None
        self._stiffness: PETSc.Mat | None = None
        self._has_u = self._has_p = False

    def set_up(self, matrix: PETSc.Mat) -> None:
        """Make the hierarchy of the displacements anew."""
        u, _ = self._ranges(matrix)
        of_u = self._inverse.of_u
        self._stiffness = matrix.createSubMatrix(u, u, self._stiffness)
        of_u.setOperators(self._stiffness)
        pc = of_u.getPC()
        if not self._has_u:
            pc.setType("mg")
            pc.setMGLevels(2)
            pc.setMGInterpolation(1, self._level.prolongation)
        coarse = self._level.matrix(self._stiffness)
        pc.getMGCoarseSolve().setOperators(coarse, coarse)
        if not self._has_u:
            self.options.apply_further(of_u)
            self._has_u = True
        of_u.setUp()

    def set_up_pressure(self, schur: PETSc.Mat) -> None:
        """Make the preconditioner of the pressures from the approximate Schur complement (pressures, pressures)."""
        of_p = self._inverse.of_p
        of_p.setOperators(schur)
        if not self._has_p:
            self.options.apply_further(of_p)
            self._has_p = True
        of_p.setUp()

    def strengthen(self) -> bool:
        """Take :data:`STRONG` from the next :meth:`set_up` on; False where it has them, or the user's options."""
        if not self._may_strengthen:
            return False
        self._may_strengthen, self._has_u = False, False
        self._inverse.of_u.destroy()
        self._inverse.of_u = PETSc.KSP().create(self._comm)
        prefix = SolverOptions({**DEFAULTS, **STRONG}, {}, self._key).prefix
        self._inverse.of_u.setOptionsPrefix(f"{prefix}fieldsplit_u_")
        return True

    def solve(self, matrix: PETSc.Mat, b: PETSc.Vec, x: PETSc.Vec, accuracy: float) -> tuple[int, int]:
        """Solve, and return PETSc's reason for stopping, negative without a solution, and the iterations."""
        u, p = self._ranges(matrix)
        self._inverse.coupling = matrix.createSubMatrix(p, u, self._inverse.coupling)
        self._ksp.setOperators(matrix)
        self._ksp.setTolerances(rtol=accuracy)
        self._ksp.solve(b, x)
        return int(self._ksp.getConvergedReason()), int(self._ksp.getIterationNumber())

    @property
    def residual(self) -> float:
        """Norm of the residual where the iteration stopped."""
        return float(self._ksp.getResidualNorm())

    def _ranges(self, matrix: PETSc.Mat) -> tuple[PETSc.IS, PETSc.IS]:
        if self._fields is None:
            first = matrix.getOwnershipRange()[0]
            ranges = ((self._n_u, first), (self._n - self._n_u, first + self._n_u))
            u, p = (PETSc.IS().createStride(size, begin, 1, comm=self._comm) for size, begin in ranges)
            self._fields = u, p
        return self._fields

    def destroy(self) -> None:
        """Free the hierarchies; all processes must do so together."""
        self._ksp.destroy()
        self._inverse.free()
        for part in (self._stiffness, *(self._fields or ())):
            if part is not None:
                part.destroy()
        self._level.destroy()
