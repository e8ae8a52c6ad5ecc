"""The u–p problem in UFL: compiled forms, and functions with the law's response at quadrature points."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import ufl
from petsc4py import PETSc

from porocore.interfaces.law import Integrand, MacroTangent
from porocore.states import Array, MacroState
from porocore_fem_dolfinx import compat, elements
from porocore_fem_dolfinx.macro_space import MacroSpace
from porocore_fem_dolfinx.types import CompiledForm, Expr, Function

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
assert tuple(_TANGENT) == tuple(f.name for f in fields(MacroTangent))


class MacroForms:
    """Compiled forms, in which only the functions' values and the constant Δt change."""

    def __init__(self, space: MacroSpace) -> None:
        self._space, domain = space, space.domain
        self._slots = np.empty(0, dtype=np.int64)
        self._functions = {name: self._at_points(shape) for name, shape in {**_RESPONSE, **_TANGENT}.items()}
        degree = space.element.degree
        dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": degree, "quadrature_rule": "default"})
        self._u, self._p = compat.make_function(space.V), compat.make_function(space.Q)
        self._build_states()
        self._build_residual(dx)
        self._build_tangent(dx)
        self.matrix = compat.block_matrix(self._tangent)
        self._dx = dx
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

    def _build_states(self) -> None:
        u, p = self._u, self._p
        grad_u, grad_p = ufl.grad(u), ufl.grad(p)
        components = [*(grad_u[i, j] for i in range(3) for j in range(3)), p, *(grad_p[i] for i in range(3))]
        element = self._space.element
        points = elements.quadrature_points(element.shape, element.degree)[self._space.order]
        self._states = compat.expression(ufl.as_vector(components), points)

    def _build_residual(self, dx: ufl.Measure) -> None:
        """Build with discontinuous test functions, so that each element has its own share."""
        domain, f, cell = self._space.domain, self._functions, self._space.element.shape
        v = ufl.TestFunction(
            compat.function_space(domain, elements.lagrange_element(cell, 2, (3,), discontinuous=True))
        )
        s = ufl.TestFunction(
            compat.function_space(domain, elements.lagrange_element(cell, 1, discontinuous=True))
        )
        self._residual = [
            compat.form(ufl.inner(f["stress"], ufl.grad(v)) * dx),
            compat.form(f["storage"] * s * dx),
            compat.form(ufl.dot(f["flux"], ufl.grad(s)) * dx),
        ]

    def _build_tangent(self, dx: ufl.Measure) -> None:
        f, V, Q = self._functions, self._space.V, self._space.Q
        v, s, du, dp = ufl.TestFunction(V), ufl.TestFunction(Q), ufl.TrialFunction(V), ufl.TrialFunction(Q)
        self._dt = compat.constant(self._space.domain, 1.0)
        H = ufl.grad(du)
        H_row = ufl.as_vector([H[i, j] for i in range(3) for j in range(3)])
        stress = ufl.dot(f["stress_grad_u"], H_row)
        stress = ufl.as_matrix([[stress[3 * i + j] for j in range(3)] for i in range(3)])
        flux_u = ufl.dot(f["flux_grad_u"], H_row)
        dt, grad_s = self._dt, ufl.grad(s)
        self._tangent = compat.form(
            [
                [ufl.inner(stress, ufl.grad(v)) * dx, ufl.inner(f["stress_p"], ufl.grad(v)) * dp * dx],
                [
                    (ufl.inner(f["storage_grad_u"], H) * s - dt * ufl.dot(flux_u, grad_s)) * dx,
                    self._storage(s, dp, f["storage_p"]) * dx,
                ],
            ]
        )

    def _storage(self, s: Expr, dp: Expr, by_pressure: Expr) -> Expr:
        """Return the change of storage and flux with the pressure, tested by ``s``."""
        f = self._functions
        flux = f["flux_p"] * dp + ufl.dot(f["flux_grad_p"], ufl.grad(dp))
        return by_pressure * dp * s - self._dt * ufl.dot(flux, ufl.grad(s))

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

    def assemble(self, tangent: MacroTangent, dt: float) -> None:
        """Assemble the derivative of the residual into ``matrix``."""
        for name in _TANGENT:
            self._fill(name, getattr(tangent, name))
        self._dt.value = dt
        compat.assemble_blocks(self._tangent, self.matrix)

    def schur(self, mass: Array) -> PETSc.Mat:
        """Return the block of the pressures plus ∫ ``mass`` N N, ``mass`` (points,), by the last tangent.

        The next call overwrites it.
        """
        if self._schur is None:
            self._functions["mass"] = mass_at = self._at_points(())
            Q = self._space.Q
            s, dp = ufl.TestFunction(Q), ufl.TrialFunction(Q)
            form = (self._storage(s, dp, self._functions["storage_p"]) + mass_at * dp * s) * self._dx
            self._schur = compat.form(form), None
        self._fill("mass", mass)
        form, matrix = self._schur
        self._schur = form, compat.assemble_matrix(form, matrix)
        return self._schur[1]
