"""The discrete solid of a cell (DolfinxSolid), with forms in UFL or from pointwise responses."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial

import numpy as np
import ufl
from petsc4py import PETSc
from scipy import sparse

from porocore.cell.contact.wall_contact import ContactModel
from porocore.cell.equilibrium.discrete import (
    DiscreteSolid,
    DomainIntegrals,
    FactorError,
    FactorisedTangent,
    Iterate,
    LoadStepFailed,
    Sensitivities,
    second_derivatives,
)
from porocore.cell.equilibrium.responses import PATIENCE, least_shifted
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry import UNIT_LOADS
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.states import Array, IntArray, Status
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain, SolidSpace, to_scipy
from porocore_fem_dolfinx.linalg import SymmetricSolver
from porocore_fem_dolfinx.petsc_options import OptionValue
from porocore_fem_dolfinx.types import Expr, FunctionSpace, Mesh


class SolidForms(ABC):
    """Forms compiled once for a mesh and the space of u¹; all refer to the iterate that :meth:`load` has put in."""

    def __init__(self, domain: CellDomain, space: FunctionSpace) -> None:
        self.domain, self.space = domain, space
        self.function = compat.make_function(space)
        self.dH = compat.constant(domain.domain, np.zeros((3, 3)))
        self.grad_v = ufl.grad(ufl.TestFunction(space))
        self._loaded: Callable[[], Iterate | None] = lambda: None
        self._mean = compat.form(ufl.inner(self.dH, self.grad_v) * domain.dx)

    def load(self, iterate: Iterate, u: Array) -> None:
        """Put an iterate, with u¹ at the dofs, into what the forms refer to."""
        if self._loaded() is not iterate:
            self.function.x.array[:] = u
            self._loaded = weakref.ref(iterate)  # an iterate knows these forms
            self.set_load(iterate.H, iterate.p)

    @abstractmethod
    def set_load(self, H: Array, p: float) -> None:
        """Put in the load of another iterate, whose u¹ has been put in."""

    @abstractmethod
    def values(self) -> Array:
        """Return ∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""

    @abstractmethod
    def residual(self) -> Array:
        """Return ∂Π/∂u (dofs,)."""

    @abstractmethod
    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        """Return ∂²Π/∂u², in ``matrix`` if that was made by this method before."""

    @abstractmethod
    def load_change(self, dH: Array, dp: float) -> Array:
        """Return the change of the residual (dofs,) by the load alone."""

    @abstractmethod
    def stress_change(self, dH: Array, dp: float) -> Array:
        """Return the change of P + p cof F (cells, q, 9) by the load alone."""

    @cached_property
    def means(self) -> list[Array]:
        """Vectors g with g·u = ∫ ∂u_i/∂Y_j dV, one for each (i, j)."""
        vectors = []
        for unit in np.eye(9).reshape(9, 3, 3):
            self.dH.value[...] = unit
            vectors.append(compat.assemble_vector(self._mean))
        return vectors


def components(tensor: Expr) -> list[Expr]:
    """Return the nine components of a UFL tensor, row by row."""
    return [tensor[i, j] for i in range(3) for j in range(3)]


class PointwiseResponse:
    """Response of the material to ∇u¹ (cells, q, 3, 3) and a load; components last, cells in dolfinx's order.

    ``order`` (cells,) is the core's element that each cell is.
    """

    def __init__(self, material: StrainEnergy, grad: Array, H: Array, p: float, order: IntArray) -> None:
        self.material, self.grad, self.p, self.order = material, grad, p, order
        self.F = np.eye(3) + H + grad
        self.by_element = np.empty_like(self.F)
        self.by_element[order] = self.F

    @cached_property
    def values(self) -> Array:
        """Values of ∇u¹ (9), P + p cof F (9), Ψ and J, (cells, q, 20)."""
        stress = self.material.stress(self.by_element)[self.order] + self.p * cofactor(self.F)
        energy = self.material.energy_density(self.by_element)[self.order]
        shape = self.F.shape[:2]
        parts = (self.grad.reshape(*shape, 9), stress.reshape(*shape, 9), energy, determinant(self.F))
        return np.concatenate([part if part.ndim == 3 else part[..., None] for part in parts], axis=2)

    @cached_property
    def moduli(self) -> Array:
        """Moduli A + p ∂cof F/∂F, (cells, q, 9, 9)."""
        moduli = self.material.tangent(self.by_element)[self.order]
        if self.p:
            moduli = moduli + self.p * cofactor_tangent(self.F)
        return moduli.reshape(*self.F.shape[:2], 9, 9)

    def change(self, dH: Array, dp: float) -> Array:
        """Return the change of P + p cof F (cells, q, 9) by the load alone."""
        change = self.moduli @ np.asarray(dH).reshape(9)
        return change + dp * cofactor(self.F).reshape(change.shape) if dp else change


class PointwiseForms(SolidForms):
    """Forms without a material, compiled once for all of them."""

    def __init__(self, domain: CellDomain, space: FunctionSpace, material: StrainEnergy) -> None:
        super().__init__(domain, space)
        self._material, dx, grad_v = material, domain.dx, self.grad_v
        grad_u = ufl.grad(self.function)
        self._grad = domain.expression(ufl.as_vector(components(grad_u)))
        self._stress, self._stress_places = domain.at_points((3, 3))
        self._moduli, self._moduli_places = domain.at_points((9, 9))
        grad_du = ufl.as_vector(components(ufl.grad(ufl.TrialFunction(space))))
        change = ufl.dot(self._moduli, grad_du)
        self._residual = compat.form(ufl.inner(self._stress, grad_v) * dx)
        self._tangent = compat.form(ufl.dot(change, ufl.as_vector(components(grad_v))) * dx)
        self.response: PointwiseResponse

    def set_load(self, H: Array, p: float) -> None:
        grad = self.domain.evaluate(self._grad)
        grad = grad.reshape(*grad.shape[:2], 3, 3)
        self.response = PointwiseResponse(self._material, grad, H, p, self.domain.elements)

    def values(self) -> Array:
        return self.response.values

    def residual(self) -> Array:
        return self._forces(self.response.values[:, :, 9:18])

    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        self._moduli.x.array.reshape(-1, 81)[self._moduli_places] = self.response.moduli.reshape(
            *self._moduli_places.shape, 81
        )
        return compat.assemble_matrix(self._tangent, matrix)

    def load_change(self, dH: Array, dp: float) -> Array:
        return self._forces(self.response.change(dH, dp))

    def stress_change(self, dH: Array, dp: float) -> Array:
        return self.response.change(dH, dp)

    def _forces(self, stress: Array) -> Array:
        """Return ∫ S:∇v dV (dofs,) of S (cells, q, 9)."""
        self._stress.x.array.reshape(-1, 9)[self._stress_places] = stress
        return compat.assemble_vector(self._residual)


class UflForms(SolidForms):
    """Energy Π in UFL, which UFL differentiates."""

    def __init__(self, domain: CellDomain, space: FunctionSpace, material: NeoHookean) -> None:
        super().__init__(domain, space)
        dx, grad_v = domain.dx, self.grad_v
        self._H = compat.constant(domain.domain, np.zeros((3, 3)))
        self._p = compat.constant(domain.domain, 0.0)
        self._dp = compat.constant(domain.domain, 0.0)
        grad_u = ufl.grad(self.function)
        F = ufl.variable(ufl.Identity(3) + self._H + grad_u)
        J = ufl.det(F)
        energy = _energy_density(material, F, domain.domain)
        stress = ufl.diff(energy + self._p * J, F)
        cofactor = ufl.diff(J, F)
        i, j, k, m = ufl.indices(4)
        change = ufl.as_tensor(ufl.diff(stress, F)[i, j, k, m] * self.dH[k, m], (i, j)) + self._dp * cofactor
        self._residual = compat.form(ufl.inner(stress, grad_v) * dx)
        self._tangent = compat.form(
            ufl.derivative(ufl.inner(stress, grad_v) * dx, self.function, ufl.TrialFunction(space))
        )
        self._change = compat.form(ufl.inner(change, grad_v) * dx)
        self._state = domain.expression(ufl.as_vector([*components(grad_u), *components(stress), energy, J]))
        self._stress_change = domain.expression(ufl.as_vector(components(change)))

    def set_load(self, H: Array, p: float) -> None:
        self._H.value[...] = H
        self._p.value = p

    def values(self) -> Array:
        return self.domain.evaluate(self._state)

    def residual(self) -> Array:
        return compat.assemble_vector(self._residual)

    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        return compat.assemble_matrix(self._tangent, matrix)

    def load_change(self, dH: Array, dp: float) -> Array:
        self.dH.value[...], self._dp.value = dH, dp
        return compat.assemble_vector(self._change)

    def stress_change(self, dH: Array, dp: float) -> Array:
        self.dH.value[...], self._dp.value = dH, dp
        return self.domain.evaluate(self._stress_change)


def _energy_density(material: NeoHookean, F: Expr, domain: Mesh) -> Expr:
    """Return Ψ(F); the material's constants can change without a new compilation."""
    mu, lam = (compat.constant(domain, value) for value in (material.mu, material.lam))
    log_J = ufl.ln(ufl.det(F))
    return mu / 2 * (ufl.tr(F.T * F) - 3) - mu * log_J + lam / 2 * log_J**2


class DolfinxIterate(Iterate):
    """Displacement u¹ by the flat values ``u`` of the dofs; everything else is computed when it is first needed."""

    def __init__(self, problem: DolfinxSolid, H: Array, p: float, u: Array) -> None:
        self.problem, self.H, self.p, self.u = problem, H, p, u
        self.contact = problem.contact

    @cached_property
    def values(self) -> Array:
        """Values of ∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""
        return self.problem.loaded(self).values()

    @cached_property
    def energy(self) -> float:
        energy = self.problem.space.integral(self.values[:, :, 18] + self.p * self.values[:, :, 19])
        return float(energy if self.touching is None else energy + self.touching.forces.energy)

    @cached_property
    def residual(self) -> Array:
        forces = self.problem.loaded(self).residual()
        if self.touching is not None:
            forces += self.problem.space.to_dofs(
                self.touching.forces.by_displacement(len(self.problem.mesh.points))
            )
        return self.problem.space.free("").reduce(forces)

    @property
    def min_jacobian(self) -> float:
        return float(self.values[:, :, 19].min())

    @property
    def displacement(self) -> Array:
        return self.problem.space.to_nodes(self.u)


class DolfinxTangentFactor(FactorisedTangent):
    """Factorised tangent of one parity class; factorised again if the solver of the class has served another since."""

    iterate: DolfinxIterate

    def __init__(self, problem: DolfinxSolid, iterate: DolfinxIterate, parity: str, shift: float) -> None:
        self.problem, self.iterate, self.parity, self.shift = problem, iterate, parity, shift
        self.token = object()
        self.negative = problem.factorise(self)

    def solve(self, rhs: Array) -> Array:
        if rhs.ndim == 1:
            return self.problem.apply_factor(self, rhs)
        return np.stack([self.problem.apply_factor(self, column) for column in rhs.T], axis=1)


class DolfinxSolid(DiscreteSolid[DolfinxIterate, DolfinxTangentFactor]):
    """Discrete energy Π and its derivatives on one mesh."""

    def __init__(
        self,
        mesh: CellMesh,
        material: StrainEnergy,
        *,
        degree: int,
        solver: str,
        petsc: Mapping[str, OptionValue],
        contact: ContactModel | None = None,
    ) -> None:
        self.mesh, self.material, self.degree, self.contact = mesh, material, degree, contact
        self._solver, self._petsc = solver, petsc
        self.space = space = SolidSpace(mesh, degree)
        self._forms: SolidForms = (
            UflForms(space.domain, space.functions, self.material)
            if isinstance(self.material, NeoHookean)
            else PointwiseForms(space.domain, space.functions, self.material)
        )
        self._least_stress = 1e-3 * self.material.mean_moduli()[1]
        self._solvers: dict[str, SymmetricSolver] = {}
        #: Token of the factor that the solver of a class holds.
        self._in_use: dict[str, object] = {}
        self._base: SymmetricSolver | None = None
        self._kept: SymmetricSolver | None = None
        self._full: PETSc.Mat | None = None
        self._full_of: Callable[[], DolfinxIterate | None] = lambda: None
        self._shift = 0.0

    # ---- forms ------------------------------------------------------------------------

    def loaded(self, iterate: DolfinxIterate) -> SolidForms:
        """Return the forms at an iterate."""
        self._forms.load(iterate, iterate.u)
        return self._forms

    # ---- the discrete solid ---------------------------------------------------------------------

    def iterate_at(self, H: Array, p: float, displacement: Array | None = None) -> DolfinxIterate:
        u = np.zeros((len(self.mesh.points), 3)) if displacement is None else displacement
        return DolfinxIterate(self, H, p, self.space.to_dofs(u))

    def moved(self, iterate: DolfinxIterate, change: Array, H: Array, p: float) -> DolfinxIterate:
        return DolfinxIterate(self, H, p, iterate.u + self.space.free("").expand(change))

    def force_scale(self, iterate: DolfinxIterate) -> float:
        size = np.maximum(np.linalg.norm(iterate.values[:, :, 9:18], axis=2), self._least_stress)
        return float(np.linalg.norm(self.space.free("").restrict(self.space.nodal_sums(size))))

    def load_change(self, iterate: DolfinxIterate, dH: Array, dp: float) -> Array:
        return self.space.free("").reduce(self._load_vector(iterate, "", dH, dp))

    def _load_vector(self, iterate: DolfinxIterate, parity: str, dH: Array, dp: float) -> Array:
        forces = self.loaded(iterate).load_change(dH, dp)
        if iterate.touching is not None:
            forces += self.space.to_dofs(
                iterate.touching.blocks(parity).load_change(len(self.mesh.points), dH)
            )
        return forces

    def reset(self) -> None:
        for comm in (PETSc.COMM_SELF, self.space.domain.domain.comm):
            compat.collect_garbage(comm)
        self._kept, self._shift = None, 0.0

    def _kept_factor(self) -> SymmetricSolver:
        """Return the latest factor of this load path, at first that of the undeformed cell, which is made only once."""
        if self._kept is None:
            if self._base is None:
                self._base = SymmetricSolver(self._solver, self._petsc, self.space.free("").size)
                self._base.use(self._matrix(self.iterate_at(self.unstressed, 0.0), ""))
            self._kept = self._base
        return self._kept

    def solve(self, iterate: DolfinxIterate, rhs: Array, accuracy: float) -> Array:
        try:
            kept = self._kept_factor()
            if kept.is_factor:
                x = kept.iterate(self._matrix(iterate, ""), rhs, accuracy, PATIENCE)
                if x is not None:
                    return x
            if self._factor(iterate, "", accuracy) <= 0:
                try:
                    return self._solvers[""].solve(rhs)
                except FactorError:
                    if self._solvers[""].negative <= 0:
                        raise
            x, self._shift = least_shifted(partial(self._shifted, iterate, rhs), rhs, self._shift)
        except FactorError as error:
            raise LoadStepFailed(Status.not_converged) from error
        return x

    def _matrix(self, iterate: DolfinxIterate, parity: str) -> PETSc.Mat:
        """Return the tangent of the free unknowns of a class; the next call for this class overwrites it."""
        self._in_use.pop(parity, None)
        if self._full_of() is not iterate:
            full = self.loaded(iterate).tangent(self._full)
            if self._full is None:
                self._full = compat.freed_with(self, full)
            # An iterate knows its solid: a circle of references would keep both until the garbage collection.
            self._full_of = weakref.ref(iterate)
        if iterate.touching is None:
            return self.space.free(parity).matrix(self._full)
        rows, columns, values = iterate.touching.blocks(parity).entries
        rows, columns = (3 * self.space.dof[i // 3] + i % 3 for i in (rows, columns))
        return self.space.free(parity).matrix(self._full, (rows, columns, values))

    def _factor(
        self,
        iterate: DolfinxIterate,
        parity: str,
        accuracy: float = 1e-12,
        shift: float = 0.0,
        below: float = 0.0,
    ) -> int:
        """Factorise K + ``shift``·(mean of its diagonal)·I − ``below``·M of a class, and return its negative pivots."""
        matrix = self._matrix(iterate, parity)
        if below:
            masses = PETSc.Vec().createWithArray(-below * self.masses(parity), comm=PETSc.COMM_SELF)
            matrix.setDiagonal(masses, addv=True)
        if shift:
            matrix.shift(shift * float(np.abs(matrix.getDiagonal().array).mean()))
        if parity not in self._solvers:
            self._solvers[parity] = SymmetricSolver(self._solver, self._petsc, self.space.free(parity).size)
        solver = self._solvers[parity]
        if not parity:
            self._kept = None  # should the factorisation break down, what is left of it must not be used
        solver.use(matrix, accuracy)
        if not parity:
            self._kept = solver
        return solver.negative

    def _shifted(self, iterate: DolfinxIterate, rhs: Array, shift: float) -> Array | None:
        if self._factor(iterate, "", shift=shift) > 0:
            return None
        try:
            return self._solvers[""].solve(rhs)
        except FactorError:
            return None

    def factor(self, iterate: DolfinxIterate, parity: str, shift: float = 0.0) -> DolfinxTangentFactor:
        return DolfinxTangentFactor(self, iterate, parity, shift)

    def apply_factor(self, factor: DolfinxTangentFactor, rhs: Array) -> Array:
        """Return x (n,) with (K − shift·M) x = rhs; factorise again if the solver serves another matrix."""
        if self._in_use.get(factor.parity) is not factor.token:
            self.factorise(factor)
        return self._solvers[factor.parity].solve(rhs)

    def factorise(self, factor: DolfinxTangentFactor) -> int:
        """Factorise for the solver of the class, and return the number of negative pivots."""
        negative = self._factor(factor.iterate, factor.parity, below=factor.shift)
        self._in_use[factor.parity] = factor.token
        return negative

    def release(self, parity: str) -> None:
        self.space.release(parity)
        self._solvers.pop(parity, None)
        self._in_use.pop(parity, None)

    def tangent(self, iterate: DolfinxIterate, parity: str) -> sparse.csr_matrix:
        return to_scipy(self._matrix(iterate, parity))

    def reduced(self, values: Array, parity: str) -> Array:
        return self.space.free(parity).reduce(self.space.to_dofs(values))

    def expanded(self, x: Array, parity: str) -> Array:
        return self.space.to_nodes(self.space.free(parity).expand(x))

    def integrals(self, iterate: DolfinxIterate) -> DomainIntegrals:
        total = self.space.integral(iterate.values)
        return DomainIntegrals(
            grad=total[:9].reshape(3, 3),
            stress=total[9:18].reshape(3, 3),
            volume=float(total[19]),
            energy=float(total[18]),
            largest_grad=np.abs(iterate.values[:, :, :9]).max(axis=(0, 1)).reshape(3, 3),
            largest_energy=float(iterate.values[:, :, 18].max()),
        )

    def sensitivities(self, factor: DolfinxTangentFactor, columns: Sequence[int]) -> Sensitivities:
        iterate, parity = factor.iterate, factor.parity
        condensation = self.space.free(parity)
        R, explicit = [], []
        for column in columns:
            load = UNIT_LOADS[column], float(column == 9)
            R.append(condensation.reduce(self._load_vector(iterate, parity, *load)))
            explicit.append(self.space.integral(self.loaded(iterate).stress_change(*load)))
        U, indefinite = [], False
        for r in R:
            try:
                U.append(-factor.solve(r))
            except FactorError:
                U.append(np.full(condensation.size, np.nan))
                indefinite = indefinite or self._solvers[parity].negative > 0
        fields = [condensation.expand(u) for u in U]
        grad = np.array([[g @ field for g in self._forms.means] for field in fields])
        displacement = np.stack([self.space.to_nodes(field) for field in fields])
        direct = second_derivatives(columns, np.array(explicit))
        second = direct + np.array(R) @ np.array(U).T
        return Sensitivities(displacement, grad.reshape(-1, 3, 3), second, 1 if indefinite else -1)
