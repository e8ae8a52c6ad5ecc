"""Discrete u–p problem of a body (DolfinxDiscretisation): its forms and their assembly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import partial

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from porocore.core.parallel import Communicator
from porocore.interfaces.law import Integrand, MacroTangent
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.linear_systems import TIGHTEST, Solver, choose_solver, pressure_mass
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore_fem_dolfinx import compat, elements
from porocore_fem_dolfinx.macro_linear import KEY, ConfiguredSolver, PetscLinearSolver
from porocore_fem_dolfinx.macro_multigrid import CoarseLevel, MultigridSolver
from porocore_fem_dolfinx.macro_space import MacroSpace
from porocore_fem_dolfinx.petsc_options import OptionValue
from porocore_fem_dolfinx.types import CompiledForm, Expr, Form, Function

_RESPONSE = {"stress": (3, 3), "storage": (), "flux": (3,)}
_TANGENT: dict[str, tuple[int, ...]] = {
    "stress_grad_u": (3, 3, 3, 3),
    "stress_p": (3, 3),
    "storage_grad_u": (3, 3),
    "storage_p": (),
    "flux_grad_u": (3, 3, 3),
    "flux_p": (3,),
    "flux_grad_p": (3, 3),
}
#: Derivatives that few laws have.
_BY_SLOPE = {"stress_grad_p": (9, 3), "storage_grad_p": (3,)}
assert (*_TANGENT, *_BY_SLOPE) == tuple(f.name for f in fields(MacroTangent))


class MacroForms:
    """Compiled forms, in which only the functions' values and the constant Δt change."""

    def __init__(self, space: MacroSpace) -> None:
        self._space, domain = space, space.domain
        self._slots = np.empty(0, dtype=np.int64)
        self._functions = {name: self._at_points(shape) for name, shape in {**_RESPONSE, **_TANGENT}.items()}
        degree = space.element.degree
        self._dx = ufl.Measure(
            "dx", domain, metadata={"quadrature_degree": degree, "quadrature_rule": "default"}
        )
        self._depth = compat.constant(domain, space.depth)
        self._u, self._p = compat.make_function(space.V), compat.make_function(space.Q)
        self._build_states()
        self._build_residual()
        self._build_tangent()
        self.matrix = compat.block_matrix(self._tangent)
        self._tangent_by_slope: list[list[CompiledForm]] | None = None
        self._schur: tuple[CompiledForm, PETSc.Mat | None] | None = None

    def _at_points(self, shape: tuple[int, ...]) -> Function:
        """Return a function of values at the quadrature points; tensors of rank 3 and 4 are matrices in UFL."""
        flat = shape if len(shape) < 3 else (int(np.prod(shape[:-2])), 9)
        space, element = self._space, self._space.element
        at_points = elements.quadrature_element(element.shape, element.degree, flat)
        points = compat.function_space(space.domain, at_points)
        if not len(self._slots):
            # The dofmaps of these spaces count points, alike for all shapes.
            self._slots = compat.cell_dofs(points.dofmap)[: len(space.cells)][:, space.order].ravel()
        return compat.make_function(points)

    def _integral(self, integrand: Expr) -> Form:
        """Return the integral over the body, all of the revolution or depth of one in two dimensions."""
        space = self._space
        if space.revolved:
            integrand = 2 * np.pi * ufl.SpatialCoordinate(space.domain)[0] * integrand
        elif space.flat:
            integrand = self._depth * integrand
        return integrand * self._dx

    def _gradient(self, v: Expr) -> Expr:
        """Return H of a displacement, which on a flat body does not change along z.

        In a meridian z is the direction of the hoop, which a radial displacement v_1 stretches by v_1/r.
        """
        space = self._space
        if not space.flat:
            return ufl.grad(v)
        rows = [[v[i].dx(0), v[i].dx(1), 0] for i in range(3)]
        if space.revolved:
            rows[2] = [0, 0, v[0] / ufl.SpatialCoordinate(space.domain)[0]]
        return ufl.as_matrix(rows)

    def _slope(self, p: Expr) -> Expr:
        """Return ∇p of three components."""
        grad = ufl.grad(p)
        return ufl.as_vector([grad[0], grad[1], 0]) if self._space.flat else grad

    def _build_states(self) -> None:
        u, p = self._u, self._p
        grad_u, grad_p = self._gradient(u), self._slope(p)
        components = [*(grad_u[i, j] for i in range(3) for j in range(3)), p, *(grad_p[i] for i in range(3))]
        element = self._space.element
        points = elements.quadrature_points(element.shape, element.degree)[self._space.order]
        self._states = compat.expression(ufl.as_vector(components), points)

    def _build_residual(self) -> None:
        """Build with discontinuous test functions, so that each element has its own share."""
        domain, f, cell = self._space.domain, self._functions, self._space.element.shape
        v = ufl.TestFunction(
            compat.function_space(domain, elements.lagrange_element(cell, 2, (3,), discontinuous=True))
        )
        s = ufl.TestFunction(
            compat.function_space(domain, elements.lagrange_element(cell, 1, discontinuous=True))
        )
        self._residual = [
            compat.form(self._integral(ufl.inner(f["stress"], self._gradient(v)))),
            compat.form(self._integral(f["storage"] * s)),
            compat.form(self._integral(ufl.dot(f["flux"], self._slope(s)))),
        ]

    def _build_tangent(self) -> None:
        f, V, Q = self._functions, self._space.V, self._space.Q
        v, s, du, dp = ufl.TestFunction(V), ufl.TestFunction(Q), ufl.TrialFunction(V), ufl.TrialFunction(Q)
        self._dt = compat.constant(self._space.domain, 1.0)
        H, H_v, of = self._gradient(du), self._gradient(v), self._integral
        H_row = ufl.as_vector([H[i, j] for i in range(3) for j in range(3)])
        stress = _matrix(ufl.dot(f["stress_grad_u"], H_row))
        flux_u = ufl.dot(f["flux_grad_u"], H_row)
        dt, grad_s = self._dt, self._slope(s)
        self._tangent = compat.form(
            [
                [of(ufl.inner(stress, H_v)), of(ufl.inner(f["stress_p"], H_v) * dp)],
                [
                    of(ufl.inner(f["storage_grad_u"], H) * s - dt * ufl.dot(flux_u, grad_s)),
                    of(self._storage(s, dp, f["storage_p"])),
                ],
            ]
        )

    def _storage(self, s: Expr, dp: Expr, by_pressure: Expr) -> Expr:
        """Return the change of storage and flux with the pressure, tested by ``s``."""
        f = self._functions
        flux = f["flux_p"] * dp + ufl.dot(f["flux_grad_p"], self._slope(dp))
        return by_pressure * dp * s - self._dt * ufl.dot(flux, self._slope(s))

    def _by_slope(self) -> list[list[CompiledForm]]:
        """Return the forms of the tangent where stress and storage depend on ∇p, made at the first call."""
        if self._tangent_by_slope is None:
            f, V, Q = self._functions, self._space.V, self._space.Q
            f |= {name: self._at_points(shape) for name, shape in _BY_SLOPE.items()}
            v, s, dp, of = ufl.TestFunction(V), ufl.TestFunction(Q), ufl.TrialFunction(Q), self._integral
            stress = f["stress_p"] * dp + _matrix(ufl.dot(f["stress_grad_p"], self._slope(dp)))
            stored = ufl.dot(f["storage_grad_p"], self._slope(dp)) * s
            by_p = compat.form(
                [
                    [of(ufl.inner(stress, self._gradient(v)))],
                    [of(self._storage(s, dp, f["storage_p"]) + stored)],
                ]
            )
            self._tangent_by_slope = [
                [row[0], *other] for row, other in zip(self._tangent, by_p, strict=True)
            ]
        return self._tangent_by_slope

    def _fill(self, name: str, values: Array) -> None:
        function = self._functions[name]
        points = len(self._slots)
        function.x.array.reshape(-1, values[0].size)[self._slots] = values.reshape(points, -1)

    def states(self, x: Array) -> tuple[MacroState, Array]:
        """Return H, p and ∇p at the points of this process from its local unknowns."""
        space = self._space
        self._u.x.array[:], self._p.x.array[:] = x[space.of_u], x[space.of_p]
        values = compat.evaluate(self._states, space.domain, space.cells).reshape(-1, 13)
        grad_u = np.ascontiguousarray(values[:, :9]).reshape(-1, 3, 3)
        return MacroState(grad_u, values[:, 9].copy()), values[:, 10:].copy()

    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        """Return ∫ P_E:∇N (elements, 81 or 30), ∫ Δstorage N and ∫ q·∇N (elements, 8 or 4)."""
        for name in _RESPONSE:
            self._fill(name, getattr(response, name))
        forces, stored, moved = (
            compat.assemble_vector(form).reshape(len(self._space.cells), -1) for form in self._residual
        )
        return forces, stored, moved

    def assemble(self, tangent: MacroTangent, dt: float, by_slope: bool) -> None:
        """Assemble the derivative of the residual into ``matrix``.

        All processes are told alike whether stress or storage of any of them depend on ∇p (``by_slope``).
        """
        forms = self._by_slope() if by_slope else self._tangent
        for name in _TANGENT:
            self._fill(name, getattr(tangent, name))
        if by_slope:
            n = len(self._slots)
            for name, shape in _BY_SLOPE.items():
                values = getattr(tangent, name)
                self._fill(name, np.zeros((n, *shape)) if values is None else values)
        self._dt.value = dt
        compat.assemble_blocks(forms, self.matrix)

    def schur(self, mass: Array) -> PETSc.Mat:
        """Return the block of the pressures plus ∫ ``mass`` N N, ``mass`` (points,), by the last tangent.

        The next call overwrites it.
        """
        if self._schur is None:
            self._functions["mass"] = mass_at = self._at_points(())
            Q = self._space.Q
            s, dp = ufl.TestFunction(Q), ufl.TrialFunction(Q)
            form = self._integral(self._storage(s, dp, self._functions["storage_p"]) + mass_at * dp * s)
            self._schur = compat.form(form), None
        self._fill("mass", mass)
        form, matrix = self._schur
        self._schur = form, compat.assemble_matrix(form, matrix)
        return self._schur[1]


def _matrix(row: Expr) -> Expr:
    """Return the matrix of nine components, row by row."""
    return ufl.as_matrix([[row[3 * i + j] for j in range(3)] for i in range(3)])


#: Unknowns above which multigrid is the faster solver. A step of two systems took 0.29 s with a factor and 0.26 s with
#: multigrid at 9,000, 3.1 and 1.4 s at 40,000.
THRESHOLD = 10_000


class DolfinxDiscretisation(Discretisation[PETSc.Mat]):
    """Forms, matrix and linear solver of one problem."""

    def __init__(
        self,
        problem: MacroProblem,
        mesh: BodyMesh,
        boundary: BoundaryData,
        comm: MPI.Intracomm,
        communicator: Communicator,
        petsc: Mapping[str, OptionValue],
        solver: Solver = "auto",
    ) -> None:
        self.space = space = MacroSpace(mesh, comm)
        super().__init__(
            problem,
            mesh,
            boundary,
            unknowns=space.unknowns,
            owned=space.owned_u + space.owned_p,
            elements=space.elements,
            dofs=space.dofs,
            communicator=communicator,
        )
        #: Function of each field, the local unknown of each of its values, and how many of them are owned.
        self._fields = (
            (compat.make_function(space.V), space.of_u, space.owned_u),
            (compat.make_function(space.Q), space.of_p, space.owned_p),
        )
        self._forms = MacroForms(space)
        self._matrix = self._forms.matrix
        self._comm, self._in_frames = comm, None
        self._transpose: PETSc.Mat | None = None
        self._to_frames = self._rotation(comm)
        #: Last tangent until it is solved with, and the last mass matrix of the Schur complement at the points.
        self._tangent: MacroTangent | None = None
        self._mass = np.zeros(self.n_points)
        self._pressures: tuple[PETSc.IS, PETSc.Mat | None] | None = None
        self._solver = self._make_solver(petsc, solver)
        if comm.size == 1:  # else it would have to happen on all processes together, which garbage is not
            for part in (self._matrix, self._solver):
                compat.freed_with(self, part)
        self.keeps_factor = self._solver.keeps_factor
        if petsc:
            self._try_solver()

    def _make_solver(self, petsc: Mapping[str, OptionValue], solver: Solver) -> PetscLinearSolver:
        """Return the linear solver by size, or as the user says; PETSc options alone choose no iteration of ours."""
        comm, is_force = self._comm, self.is_force[self.free[self.leading]]
        iterates, line = choose_solver(solver, self.mesh.size, THRESHOLD)
        if petsc and solver == "auto":
            iterates, line = False, f"{self.mesh.size:,} unknowns are solved for by the options {KEY}"
        self.linear.choice = line
        multigrid = None
        if iterates:
            rows = self.unknowns[self.free[self.leading]][is_force]
            level = CoarseLevel(self.space, self.mesh, self.boundary, rows, comm, self.communicator)
            multigrid = MultigridSolver(comm, petsc, KEY, is_force, level)
        others = {} if iterates else petsc
        configured = partial(ConfiguredSolver, comm, others, KEY, is_force, self.linear)
        return PetscLinearSolver(comm, self.free, self.linear, configured, multigrid, self._expansion(comm))

    def _schur(self) -> PETSc.Mat:
        """Return the approximate Schur complement of the last tangent, in its free rows and columns."""
        if self._tangent is not None:
            self._mass = pressure_mass(self._tangent, len(self.mesh.element.weights))
        whole = self._forms.schur(self._mass)
        if self._pressures is None:
            first = whole.getOwnershipRange()[0] - self.space.owned_u
            rows = first + self.free[~self.is_force[self.free]]
            self._pressures = PETSc.IS().createGeneral(rows.astype(PETSc.IntType), comm=self._comm), None
        rows, part = self._pressures
        self._pressures = rows, whole.createSubMatrix(rows, rows, part)
        return self._pressures[1]

    def _expansion(self, comm: MPI.Intracomm) -> PETSc.Mat | None:
        """Return the matrix from the unknowns of the equations to the free ones; None without plates."""
        if not self.plates:
            return None
        rows, columns = len(self.free), int(self.leading.sum())
        first = comm.scan(columns) - columns
        column = np.full(rows, -1, dtype=np.int64)
        column[self.leading] = first + np.arange(columns)
        for places in self.plates:
            own = column[places[self.leading[places]]]
            column[places] = self.communicator.sum(int(own.sum()))  # one process has it, the others nothing
        sizes = ((rows, None), (columns, None))
        return compat.make_matrix(comm, sizes, np.arange(rows + 1), column, np.ones(rows))

    def _try_solver(self) -> None:
        """Solve for a material whose stress resists rotations too, so that a failure is due to the options."""
        n, one = self.n_points, np.eye(3)
        tangent = MacroTangent(
            stress_grad_u=np.broadcast_to(np.einsum("ik,jl->ijkl", one, one), (n, 3, 3, 3, 3)),
            stress_p=np.broadcast_to(-one, (n, 3, 3)),
            storage_grad_u=np.broadcast_to(one, (n, 3, 3)),
            storage_p=np.ones(n),
            flux_grad_u=np.zeros((n, 3, 3, 3)),
            flux_p=np.zeros((n, 3)),
            flux_grad_p=np.broadcast_to(-one, (n, 3, 3)),
        )
        with self._solver.trial():
            self.solve(self.system(tangent, 1.0), np.ones(len(self.unknowns)), np.zeros(len(self.prescribed)))

    def _rotation(self, comm: MPI.Intracomm) -> PETSc.Mat | None:
        """Return Qᵀ as a PETSc matrix; None where all unknowns are Cartesian."""
        if self.rotation is None:
            return None
        owned = self.rotation[: self.owned, : self.owned].T.tocsr()
        first = comm.scan(self.owned) - self.owned
        sizes = ((self.owned, None), (self.owned, None))
        return compat.make_matrix(comm, sizes, owned.indptr, owned.indices + first, owned.data)

    def begin(self) -> None:
        """Begin a solve, with no hierarchy of another one."""
        super().begin()
        self._solver.begin()

    def states_of(self, x: Array) -> tuple[MacroState, Array]:
        return self._forms.states(x)

    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        return self._forms.contributions(response)

    def add_copies(self, values: Array) -> Array:
        """Add by PETSc's scatters; see :class:`Discretisation`."""
        total = np.zeros_like(values)
        for function, of, owned in self._fields:
            function.x.array[:] = values[of]
            compat.vector_of(function).ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
            total[of[:owned]] = function.x.array[:owned]
        return total

    def _with_copies(self, values: Array) -> Array:
        """Return all local unknowns from the owned ones."""
        whole = np.empty(len(self.unknowns))
        for function, of, owned in self._fields:
            function.x.array[:owned] = values[of[:owned]]
            function.x.scatter_forward()
            whole[of] = function.x.array
        return whole

    def system(self, tangent: MacroTangent, dt: float, surface: sparse.csr_matrix | None = None) -> PETSc.Mat:
        """Return a PETSc matrix, which the next call overwrites."""
        by_slope = any(getattr(tangent, name) is not None for name in _BY_SLOPE)
        self._forms.assemble(tangent, dt, bool(self.communicator.max(float(by_slope))))
        self._solver.renew()
        self._tangent = tangent
        if surface is not None:
            self._add(surface)
        if self._to_frames is None:
            return self._matrix
        self._in_frames = self._matrix.ptap(self._to_frames, result=self._in_frames)
        return self._in_frames

    def transposed(self, system: PETSc.Mat) -> PETSc.Mat:
        """Return the transpose, in a matrix of its own that the next call overwrites; the solver takes it next."""
        if self._transpose is None:
            self._transpose = system.transpose(PETSc.Mat())
        else:
            self._transpose = system.transpose(self._transpose)
        self._solver.renew()
        return self._transpose

    def _add(self, surface: sparse.csr_matrix) -> None:
        """Add a surface's entries, which couple nodes of one element and so lie within the pattern."""
        first = self._comm.scan(self.owned) - self.owned
        number = np.zeros(self.mesh.size)
        number[self.unknowns[: self.owned]] = first + np.arange(self.owned)
        number = np.rint(self.communicator.sum(number)).astype(PETSc.IntType)
        for row in self.unknowns[: self.owned]:
            if surface.indptr[row] < surface.indptr[row + 1]:
                part = slice(surface.indptr[row], surface.indptr[row + 1])
                columns = number[surface.indices[part]]
                self._matrix.setValues(
                    [number[row]], columns, surface.data[part], PETSc.InsertMode.ADD_VALUES
                )
        self._matrix.assemble()

    def magnitudes(self, system: PETSc.Mat, x: Array) -> Array:
        """Return |A| |x| in the owned rows."""
        starts, columns, values = system.getValuesCSR()
        # Columns are numbered process by process.
        sizes = np.abs(np.concatenate(system.getComm().tompi4py().allgather(x[: self.owned])))
        terms = np.zeros(len(x))
        terms[: self.owned] = np.add.reduceat(np.abs(values) * sizes[columns], starts[:-1])
        return terms

    def solve(
        self,
        system: PETSc.Mat,
        right: Array,
        jump: Array,
        *,
        again: bool = False,
        accuracy: float = TIGHTEST,
    ) -> Array:
        """Solve for the free unknowns; ``system`` is the last one."""
        change = np.zeros(len(self.unknowns))
        change[self.prescribed] = jump
        if self.communicator.max(float(jump.any())):
            moved, forces = system.createVecs()
            moved.array = change[: self.owned]
            system.mult(moved, forces)
            right = right[: self.owned] - forces.array
        change[self.free] = self._solver.solve(
            system, self.equations(right), self._schur, again=again, accuracy=accuracy
        )
        self._tangent = None
        return self._with_copies(change)
