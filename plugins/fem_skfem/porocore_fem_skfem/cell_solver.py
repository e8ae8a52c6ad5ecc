"""The cell solver that the plugin offers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.states import CellResponse, MacroState, Status
from porocore_fem_skfem.factor import FactorError
from porocore_fem_skfem.newton import Equilibrium, follow, undeformed
from porocore_fem_skfem.responses import failed, respond
from porocore_fem_skfem.solid import SolidProblem
from porocore_fem_skfem.stokes import conductivity

#: Relative to the forces that would act if nothing cancelled.
TOLERANCE = 1e-11


class PreparedCell:
    """What the states of a cell share; each domain is set up when it is first needed."""

    def __init__(self, cell: Cell, degree: int | None, solver: str) -> None:
        self.cell, self._degree, self._solver = cell, degree, solver

    @cached_property
    def eighth(self) -> SolidProblem:
        return self._problem("eighth")

    @cached_property
    def whole(self) -> SolidProblem:
        return self._problem("whole")

    def _problem(self, domain: Any) -> SolidProblem:
        mesh = self.cell.make_mesh("solid", domain)
        degree = self._degree or (1 if mesh.order == 1 else 2)
        return SolidProblem(mesh, self.cell.material, degree=degree, solver=self._solver)

    def domain_for(self, H: Any) -> SolidProblem:
        """The eighth where load and settings allow it."""
        diagonal = np.abs(H - np.diag(np.diag(H))).max() == 0
        return self.eighth if diagonal and self.cell.symmetry == "auto" else self.whole

    @cached_property
    def conductivity(self) -> Any:
        domain = "eighth" if self.cell.symmetry == "auto" else "whole"
        return conductivity(self.cell.make_mesh("fluid", domain), self._solver) / self.cell.viscosity


class SkfemCellSolver(CellSolver):
    """Cell problems with scikit-fem's elements, batched numpy assembly and a sparse factor that is kept.

    Options
    -------
    quadrature_degree : int
        Of the solid; by default 2 (four points), and 1 for linear elements, whose gradients are constant.
    solver : {"auto", "pardiso", "superlu", "amg"}
        Linear solver; auto takes the best that is installed, multigrid beyond 100,000 unknowns.
    """

    def __init__(self, *, quadrature_degree: int | None = None, solver: str = "auto", **unknown: Any) -> None:
        if unknown:
            raise ConfigurationError(
                f"fem.options: unknown key '{min(unknown)}'; scikit-fem takes quadrature_degree and solver"
            )
        if quadrature_degree is not None and quadrature_degree not in range(1, 9):
            raise ConfigurationError(
                f"fem.options.quadrature_degree: expected an integer from 1 to 8, got {quadrature_degree!r}"
            )
        self.quadrature_degree, self.solver = quadrature_degree, solver

    def prepare(self, cell: Cell) -> PreparedCell:
        return PreparedCell(cell, self.quadrature_degree, self.solver)

    def conductivity(self, prepared: PreparedCell) -> Any:
        return prepared.conductivity

    def solve(
        self,
        prepared: PreparedCell,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        rows, kept = [], []
        for i in range(len(states)):
            row, field = self._solve_one(
                prepared, states.grad_u[i], float(states.p[i]), start[i] if start else None, tangent, fields
            )
            rows.append(row)
            kept.append(field)
        return CellSolution(CellResponse.concatenate(rows), kept if fields else None)

    def _solve_one(
        self, prepared: PreparedCell, H: Any, p: float, start: CellField | None, tangent: bool, fields: bool
    ) -> tuple[CellResponse, CellField | None]:
        if not (np.isfinite(H).all() and np.isfinite(p)) or np.linalg.det(np.eye(3) + H) <= 0:
            return failed(Status.inverted, tangent=tangent), None
        problem = prepared.domain_for(H)
        try:
            problem.begin()
            outcome = follow(problem, _start(problem, start), H, p, TOLERANCE)
            if outcome.equilibrium is None:
                return failed(outcome.status, tangent=tangent), None
            response = respond(problem, outcome.equilibrium, tangent=tangent)
        except FactorError:
            return failed(Status.not_converged, tangent=tangent), None
        if response.fluid_volume is not None and response.fluid_volume[0] <= 0:
            return failed(Status.overlap, tangent=tangent), None
        field = None
        if fields:
            u = outcome.equilibrium.u[:, problem.nodes].T.copy()
            field = CellField(H.copy(), p, problem.mesh.domain, u)
        return response, field


def _start(problem: SolidProblem, field: CellField | None) -> Equilibrium:
    """The equilibrium of a field, if it is of this domain's mesh; else the undeformed cell."""
    if field is None or field.domain != problem.mesh.domain or len(field.u) != len(problem.mesh.points):
        return undeformed(problem)
    u = np.zeros((3, problem.n_nodes))
    u[:, problem.nodes] = field.u.T
    return Equilibrium(field.grad_u, field.p, u, problem.point(field.grad_u, field.p, problem.gradient(u)))
