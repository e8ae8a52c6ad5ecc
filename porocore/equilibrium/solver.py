"""A cell solver around a discrete solid and a Stokes problem: domains, starts, statuses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.mesh import CellMesh, Domain
from porocore.equilibrium.discrete import DiscreteSolid, FactorError, Iterate
from porocore.equilibrium.path import follow
from porocore.equilibrium.responses import failed, respond
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.states import Array, CellResponse, MacroState, Status

#: Relative to the forces that would act if nothing cancelled.
TOLERANCE = 1e-11


class PreparedCell:
    """What the states of a cell share; each domain is set up when it is first needed."""

    def __init__(self, solver: EquilibriumCellSolver, cell: Cell) -> None:
        self._solver, self.cell = solver, cell

    @cached_property
    def eighth(self) -> DiscreteSolid:
        """The eighth of the solid."""
        return self._solid("eighth")

    @cached_property
    def whole(self) -> DiscreteSolid:
        """The whole solid, or the supercell's."""
        return self._solid("whole")

    def _solid(self, domain: Domain) -> DiscreteSolid:
        loose = self.cell.loose
        if loose:
            raise ConfigurationError(
                f"cell.geometry: the solid of {self.cell.geometry.description} does not hang together, so it has no "
                f"stiffness and only its conductivity can be computed: {loose}"
            )
        return self._solver.solid(self.cell, self.cell.make_mesh("solid", domain))

    def solid_for(self, H: Array) -> DiscreteSolid:
        """The eighth where load and settings allow it."""
        diagonal = np.abs(H - np.diag(np.diag(H))).max() == 0
        return self.eighth if diagonal and self.cell.mirrored else self.whole

    @cached_property
    def conductivity(self) -> Array:
        """K (3, 3) of the undeformed cell; 0 without pores."""
        if self.cell.geometry.porosity == 0:
            return np.zeros((3, 3))
        domain: Domain = "eighth" if self.cell.symmetric else "whole"
        K = self._solver.flow(self.cell.make_mesh("fluid", domain))
        if domain == "eighth":
            K = 8 * np.diag(np.diag(K))
        return K / self.cell.viscosity


class EquilibriumCellSolver(CellSolver):
    """The part of a cell solver that no finite element library changes; subclasses discretise."""

    @abstractmethod
    def solid(self, cell: Cell, mesh: CellMesh) -> DiscreteSolid:
        """The solid problem on the mesh."""

    @abstractmethod
    def flow(self, mesh: CellMesh) -> Array:
        """∫ w^j_i dV (3, 3) over the mesh for unit viscosity and the three unit forces.

        Raises
        ------
        PorocoreError
            The Stokes problem cannot be solved.
        """

    def prepare(self, cell: Cell) -> PreparedCell:
        """See :class:`~porocore.CellSolver`."""
        return PreparedCell(self, cell)

    def conductivity(self, prepared: PreparedCell) -> Array:
        """See :class:`~porocore.CellSolver`."""
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
        """See :class:`~porocore.CellSolver`."""
        rows, kept = [], []
        for i in range(len(states)):
            row, field = _solve_one(
                prepared, states.grad_u[i], float(states.p[i]), start[i] if start else None, tangent, fields
            )
            rows.append(row)
            kept.append(field)
        return CellSolution(CellResponse.concatenate(rows), kept if fields else None)


def _solve_one(
    prepared: PreparedCell, H: Array, p: float, start: CellField | None, tangent: bool, fields: bool
) -> tuple[CellResponse, CellField | None]:
    if not (np.isfinite(H).all() and np.isfinite(p)) or np.linalg.det(np.eye(3) + H) <= 0:
        return failed(Status.inverted, tangent=tangent), None
    solid = prepared.solid_for(H)
    try:
        solid.begin()
        outcome = follow(solid, _start(solid, start), H, p, TOLERANCE)
        if outcome.equilibrium is None:
            return failed(outcome.status, tangent=tangent), None
        response = respond(solid, outcome.equilibrium, tangent=tangent)
    except FactorError:
        return failed(Status.not_converged, tangent=tangent), None
    has_pores = prepared.cell.geometry.porosity > 0
    if has_pores and response.fluid_volume is not None and response.fluid_volume[0] <= 0:
        return failed(Status.overlap, tangent=tangent), None
    field = None
    if fields:
        field = CellField(H.copy(), p, solid.mesh.domain, outcome.equilibrium.displacement.copy())
    return response, field


def _start(solid: DiscreteSolid, field: CellField | None) -> Iterate:
    """The equilibrium of a field, if it is of this domain's mesh; else the undeformed cell."""
    if field is None or field.domain != solid.mesh.domain or len(field.u) != len(solid.mesh.points):
        return solid.iterate(np.zeros((3, 3)), 0.0)
    return solid.iterate(field.grad_u, field.p, field.u)
