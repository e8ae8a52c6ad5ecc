"""Base of cell solvers (EquilibriumCellSolver): eighth or whole, start fields, conductivity, statuses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.fluid import DiscreteFluid
from porocore.cell.conductivity.pore import Pore, require_one_cell
from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorError, Iterate
from porocore.cell.equilibrium.path import follow
from porocore.cell.equilibrium.responses import respond
from porocore.cell.meshing.connectivity import blocked, pieces
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.quadrature import LARGEST_DEGREE
from porocore.core.echo import echo
from porocore.core.fields.declaration import provided_fields
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.records import failed_response
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status

#: Residual relative to the nodal forces without cancellation.
TOLERANCE = 1e-11


class PreparedCell:
    """Set-up that all states of a cell share; each domain is set up when it is first needed."""

    def __init__(self, solver: EquilibriumCellSolver, cell: Cell, *, deformed: bool = False) -> None:
        self._solver, self.cell, self.deformed = solver, cell, deformed
        self._pores: dict[Domain, Pore] = {}
        #: Linear solvers in words, by the phase and the domain.
        self._choices: dict[tuple[str, Domain], str] = {}

    @cached_property
    def eighth(self) -> DiscreteSolid:
        """The eighth of the solid."""
        return self._solid("eighth")

    @cached_property
    def whole(self) -> DiscreteSolid:
        """The whole solid, or the supercell's."""
        return self._solid("whole")

    def _solid(self, domain: Domain) -> DiscreteSolid:
        self.cell.require_stiffness()
        solid = self._solver.solid(self.cell, self.cell.make_mesh("solid", domain))
        self._choices["solid", domain] = solid.choice
        return solid

    def pore(self, domain: Domain) -> Pore:
        """Return the pore of the eighth or of the whole cell; it is kept where every state needs it."""
        if domain in self._pores:
            return self._pores[domain]
        pore = Pore(self._solver.fluid(self.cell.make_mesh("fluid", domain)))
        self._choices["fluid", domain] = pore.fluid.choice
        if self.deformed:
            self._pores[domain] = pore
        return pore

    def solid_for(self, H: Array) -> DiscreteSolid:
        """Return the eighth where load and settings allow it, else the whole solid."""
        diagonal = np.abs(H - np.diag(np.diag(H))).max() == 0
        return self.eighth if diagonal and self.cell.mirrored else self.whole

    @property
    def remark(self) -> str:
        """Linear solvers of the domains that were set up, in words."""
        return "; ".join(
            f"{phase}, {domain}: {choice}"
            for (phase, domain), choice in sorted(self._choices.items(), reverse=True)
            if choice
        )

    @cached_property
    def conductivity(self) -> Array:
        """K (3, 3) of the undeformed cell; 0 without pores."""
        if self.cell.geometry.porosity == 0:
            return np.zeros((3, 3))
        pore = self.pore("eighth" if self.cell.symmetric else "whole")
        return self.open_only(pore.undeformed) / self.cell.viscosity

    def open_only(self, K: Array) -> Array:
        """Return K (3, 3) with zeros along the axes that no pore runs along, where the discretisation leaves errors."""
        K = K.copy()
        for axis in self._closed:
            K[axis] = K[:, axis] = 0.0
        return K

    @cached_property
    def _closed(self) -> tuple[int, ...]:
        return tuple(map("xyz".index, blocked(pieces(self.cell.make_mesh("fluid", "whole")))))


class EquilibriumCellSolver(CellSolver[PreparedCell]):
    """The part of a cell solver that no finite element library changes; subclasses discretise."""

    conductivities = ("piola", "deformed")
    contact = True
    returns_fields = True
    meshes = "core"

    def __init__(self, *, quadrature_degree: int | None = None) -> None:
        if quadrature_degree is not None and quadrature_degree not in range(1, LARGEST_DEGREE + 1):
            raise ConfigurationError(
                f"fem.options.quadrature_degree: expected an integer from 1 to {LARGEST_DEGREE}, "
                f"got {echo(quadrature_degree)}"
            )
        self.quadrature_degree = quadrature_degree

    @abstractmethod
    def solid(self, cell: Cell, mesh: CellMesh) -> DiscreteSolid:
        """Return the solid problem on the mesh."""

    @abstractmethod
    def fluid(self, mesh: CellMesh) -> DiscreteFluid:
        """Return the fluid problem on the mesh, for unit viscosity."""

    def prepare(self, cell: Cell, *, deformed: bool = False) -> PreparedCell:
        if deformed:
            require_one_cell(cell)
        return PreparedCell(self, cell, deformed=deformed)

    def conductivity(self, prepared: PreparedCell) -> Array:
        return prepared.conductivity

    def remark(self, prepared: PreparedCell) -> str:
        return prepared.remark

    def solve(
        self,
        prepared: PreparedCell,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        starts = start or [None] * len(states)
        solved = [
            _solve_one(prepared, H, float(p), known, tangent, fields)
            for H, p, known in zip(states.grad_u, states.p, starts, strict=True)
        ]
        response = CellResponse.concatenate([row for row, _ in solved])
        return CellSolution(response, [field for _, field in solved] if fields else None)


def _solve_one(
    prepared: PreparedCell, H: Array, p: float, start: CellField | None, tangent: bool, fields: bool
) -> tuple[CellResponse, CellField | None]:
    response, solid, iterate = _equilibrium(prepared, H, p, start, tangent)
    if prepared.deformed:
        response = _with_conductivity(prepared, response, solid, iterate)
    if solid is None or iterate is None or not fields:
        return response, None
    return response, CellField(H.copy(), p, solid.mesh.domain, iterate.displacement.copy())


def _equilibrium(
    prepared: PreparedCell, H: Array, p: float, start: CellField | None, tangent: bool
) -> tuple[CellResponse, DiscreteSolid | None, Iterate | None]:
    """Return the response and, where it has values, the solid and its equilibrium."""
    if not (np.isfinite(H).all() and np.isfinite(p)) or np.linalg.det(np.eye(3) + H) <= 0:
        return failed_response(Status.inverted, tangent=tangent), None, None
    solid = prepared.solid_for(H)
    try:
        outcome = follow(solid, _start(solid, start), H, p, TOLERANCE)
        if outcome.equilibrium is None:
            return failed_response(outcome.status, tangent=tangent), None, None
        response = respond(solid, outcome.equilibrium, tangent=tangent)
    except FactorError:
        return failed_response(Status.not_converged, tangent=tangent), None, None
    if response.tangent is not None and not _finite(response.tangent):
        # The sensitivities did not reach their tolerance. Only an unstable state may be without derivatives.
        missing = failed_response(Status.not_converged, tangent=True)
        if response.status[0] != Status.unstable:
            return missing, None, None
        response = replace(response, tangent=missing.tangent)
    has_pores = prepared.cell.geometry.porosity > 0
    if has_pores and response.fluid_volume is not None and response.fluid_volume[0] <= 0:
        return failed_response(Status.overlap, tangent=tangent), None, None
    return response, solid, outcome.equilibrium


def _finite(tangent: CellTangent) -> bool:
    return all(np.isfinite(derivative).all() for derivative in provided_fields(tangent).values())


def _with_conductivity(
    prepared: PreparedCell, response: CellResponse, solid: DiscreteSolid | None, iterate: Iterate | None
) -> CellResponse:
    """Add K_ref of the deformed pore and the smallest J of the fluid's mesh; NaN where the solid has no values."""
    K, smallest = np.full((3, 3), np.nan), np.nan
    if solid is not None and iterate is not None:
        pore = prepared.pore(solid.mesh.domain)
        K, smallest = pore.deformed(iterate.H, iterate.displacement, solid.mesh)
        K = prepared.open_only(K)
    return replace(
        response, conductivity=K[None] / prepared.cell.viscosity, min_fluid_jacobian=np.array([smallest])
    )


def _start(solid: DiscreteSolid, field: CellField | None) -> Iterate:
    """Return the iterate of a field on this domain's mesh; else the cell without stress."""
    if field is None or field.domain != solid.mesh.domain or len(field.u) != len(solid.mesh.points):
        return solid.iterate_at(solid.unstressed, 0.0)
    return solid.iterate_at(field.grad_u, field.p, field.u)
