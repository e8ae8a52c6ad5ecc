"""Base of cell solvers (EquilibriumCellSolver): eighth or whole, start fields, conductivity, statuses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.pore import DiscreteFluid, Pore, require_one_cell
from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorError, Iterate
from porocore.cell.equilibrium.relaxation import follow_relaxing, require_path
from porocore.cell.equilibrium.responses import follow, respond_with_slopes
from porocore.cell.equilibrium.slopes import ExplicitDependence, hessian_slopes_at_rest
from porocore.cell.family.wall import (
    base_meshes,
    conductivity_with_slopes,
    explicit_dependences,
    fluid_velocities,
    with_viscosity,
)
from porocore.cell.materials.material import SWELLING, StrainEnergy
from porocore.cell.materials.prony import Relaxation
from porocore.cell.meshing.connectivity import blocked, pieces
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.tetrahedra import LARGEST_DEGREE
from porocore.core.echo import echo
from porocore.core.fields import provided_fields
from porocore.core.parallel.memory import freed_memory_kept
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.records import failed_response
from porocore.states import Array, CellResponse, CellSlopes, CellTangent, MacroState, Status

#: Residual relative to the nodal forces without cancellation.
TOLERANCE = 1e-11


class PreparedCell:
    """Set-up that all states of a cell share; each domain is set up when it is first needed."""

    def __init__(self, solver: EquilibriumCellSolver, cell: Cell, *, deformed: bool = False) -> None:
        self._solver, self.cell, self.deformed = solver, cell, deformed
        self._pores: dict[Domain, Pore] = {}
        self._dependences: dict[Domain, list[ExplicitDependence]] = {}
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
        pore = Pore(self._solver.fluid(self.cell.make_mesh("fluid", domain)), base_meshes(self.cell, domain))
        self._choices["fluid", domain] = pore.fluid.choice
        if self.deformed:
            self._pores[domain] = pore
        return pore

    def dependences(self, solid: DiscreteSolid) -> list[ExplicitDependence]:
        """Return the explicit dependence of a solid on each parameter of the cell; they are kept."""
        domain = solid.mesh.domain
        if domain not in self._dependences:
            self._dependences[domain] = explicit_dependences(self.cell, solid)
        return self._dependences[domain]

    def solid_for(self, H: Array) -> DiscreteSolid:
        """Return the eighth where load and settings allow it, else the whole solid."""
        diagonal = np.abs(H - np.diag(np.diag(H))).max() == 0
        return self.eighth if diagonal and self._mirrored else self.whole

    @cached_property
    def _mirrored(self) -> bool:
        """True where the cell and its neighbours in the family are mirrored, or slopes of shears would be lost."""
        cell = self.cell
        return cell.mirrored and (not cell.parameters or cell.with_parameters(cell.parameters).mirrored)

    @property
    def remark(self) -> str:
        """Linear solvers of the domains that were set up, in words."""
        return "; ".join(
            f"{phase}, {domain}: {choice}"
            for (phase, domain), choice in sorted(self._choices.items(), reverse=True)
            if choice
        )

    @property
    def conductivity(self) -> Array:
        """K (3, 3) of the undeformed cell; 0 without pores."""
        return self._undeformed[0]

    @property
    def conductivity_slopes(self) -> Array:
        """Slopes of K (3, 3, m) by the parameters of the cell."""
        return self._undeformed[1]

    @cached_property
    def _undeformed(self) -> tuple[Array, Array]:
        if self.cell.geometry.porosity == 0:
            return np.zeros((3, 3)), np.zeros((3, 3, len(self.cell.parameters)))
        pore = self.pore("eighth" if self.cell.symmetric else "whole")
        with freed_memory_kept(pore.fluid.mesh.points.size):
            K, slopes = conductivity_with_slopes(self.cell, pore)
        return self.open_only(K), self.open_only(slopes)

    def open_only(self, K: Array) -> Array:
        """Return K (3, 3, ...) with zeros along the axes that no pore runs along, where errors are left."""
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
    slopes = True
    relaxes = True
    meshes = "core"

    def __init__(self, *, quadrature_degree: int | None = None) -> None:
        if quadrature_degree is not None and quadrature_degree not in range(1, LARGEST_DEGREE + 1):
            raise ConfigurationError(
                f"fem.options.quadrature_degree: expected an integer from 1 to {LARGEST_DEGREE}, "
                f"got {echo(quadrature_degree)}"
            )
        self.quadrature_degree = quadrature_degree

    @abstractmethod
    def solid(self, cell: Cell, mesh: CellMesh, material: StrainEnergy | None = None) -> DiscreteSolid:
        """Return the solid problem on the mesh, of another ``material`` than the cell's where one is given."""

    @abstractmethod
    def fluid(self, mesh: CellMesh) -> DiscreteFluid:
        """Return the fluid problem on the mesh, for unit viscosity."""

    def prepare(self, cell: Cell, *, deformed: bool = False) -> PreparedCell:
        if deformed:
            require_one_cell(cell)
        return PreparedCell(self, cell, deformed=deformed)

    def conductivity(self, prepared: PreparedCell) -> Array:
        return prepared.conductivity

    def hessian_slopes_at_rest(self, prepared: PreparedCell) -> Array:
        """Return the slopes (10, 10, m) of ∂²W by H, row by row, and p at rest; NaN for a solid that swells."""
        cell, solid = prepared.cell, prepared.solid_for(np.zeros((3, 3)))
        if cell.solid.swells or any(parameter.path[-1] == SWELLING for parameter in cell.parameters):
            return np.full((10, 10, len(cell.parameters)), np.nan)
        return hessian_slopes_at_rest(solid, prepared.dependences(solid))

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

    def relax(
        self,
        prepared: PreparedCell,
        path: MacroState,
        times: Array,
        relaxation: Relaxation,
        *,
        fields: bool = False,
    ) -> CellSolution:
        require_path(path, times)
        # One domain for the whole path, since a history is known at the points of one mesh.
        solid = prepared.solid_for(np.abs(path.grad_u).max(axis=0))

        def solve(
            step: DiscreteSolid, start: Iterate, H: Array, p: float
        ) -> tuple[CellResponse, Iterate | None]:
            solved = _reach(prepared, step, start, H, p, tangent=False)
            return solved.response, solved.iterate

        make = partial(self.solid, prepared.cell, solid.mesh)
        rows = list(follow_relaxing(solid, make, solve, path, times, relaxation))
        response = CellResponse.concatenate([row for row, _ in rows])
        return CellSolution(response, [_field(solid, one) for _, one in rows] if fields else None)


@dataclass(frozen=True, eq=False)
class _Solved:
    """Response of one state and, where it has values, the solid, its equilibrium and the slopes (m, nodes, 3) of u¹."""

    response: CellResponse
    solid: DiscreteSolid | None = None
    iterate: Iterate | None = None
    slopes: Array | None = None


def _solve_one(
    prepared: PreparedCell, H: Array, p: float, start: CellField | None, tangent: bool, fields: bool
) -> tuple[CellResponse, CellField | None]:
    solved = _equilibrium(prepared, H, p, start, tangent)
    response, solid, iterate = solved.response, solved.solid, solved.iterate
    if prepared.deformed:
        response = _with_conductivity(prepared, solved)
    elif solved.slopes is not None:
        response = _with_slopes(response, prepared.conductivity_slopes)
    if solid is None or not fields:
        return response, None
    return response, _field(solid, iterate)


def _field(solid: DiscreteSolid, iterate: Iterate | None) -> CellField | None:
    """Return the field of an equilibrium, if there is one."""
    if iterate is None:
        return None
    return CellField(iterate.H.copy(), iterate.p, solid.mesh.domain, iterate.displacement.copy())


def _equilibrium(
    prepared: PreparedCell, H: Array, p: float, start: CellField | None, tangent: bool
) -> _Solved:
    """Return the response without conductivity."""
    if not (np.isfinite(H).all() and np.isfinite(p)) or np.linalg.det(np.eye(3) + H) <= 0:
        return _failed(Status.inverted, tangent, prepared.cell)
    solid = prepared.solid_for(H)
    return _reach(prepared, solid, _start(solid, start), H, p, tangent)


def _failed(status: Status, tangent: bool, cell: Cell) -> _Solved:
    return _Solved(
        failed_response(status, tangent=tangent, parameters=len(cell.parameters) * tangent or None)
    )


def _reach(
    prepared: PreparedCell, solid: DiscreteSolid, start: Iterate, H: Array, p: float, tangent: bool
) -> _Solved:
    """Return the response of a solid that is reached from an iterate of it, without conductivity."""
    failed = partial(_failed, tangent=tangent, cell=prepared.cell)
    try:
        with freed_memory_kept(solid.mesh.points.size):
            outcome = follow(solid, start, H, p, TOLERANCE)
            if outcome.equilibrium is None:
                return failed(outcome.status)
            dependences = prepared.dependences(solid) if tangent and prepared.cell.parameters else []
            response, slopes = respond_with_slopes(solid, outcome.equilibrium, dependences, tangent=tangent)
    except FactorError:
        return failed(Status.not_converged)
    if not (_finite(response.tangent) and _finite(response.slopes)):
        # The sensitivities did not reach their tolerance. Only an unstable state may be without derivatives.
        missing = failed(Status.not_converged)
        if response.status[0] != Status.unstable:
            return missing
        response = replace(response, tangent=missing.response.tangent, slopes=missing.response.slopes)
        slopes = None
    has_pores = prepared.cell.geometry.porosity > 0
    if has_pores and response.fluid_volume is not None and response.fluid_volume[0] <= 0:
        return failed(Status.overlap)
    return _Solved(response, solid, outcome.equilibrium, slopes)


def _finite(derivatives: CellTangent | CellSlopes | None) -> bool:
    return derivatives is None or all(
        np.isfinite(derivative).all() for derivative in provided_fields(derivatives).values()
    )


def _with_slopes(response: CellResponse, conductivity: Array) -> CellResponse:
    """Return a response with the slopes (3, 3, m) of the conductivity among its slopes."""
    assert response.slopes is not None
    return replace(response, slopes=replace(response.slopes, conductivity=conductivity[None]))


def _with_conductivity(prepared: PreparedCell, solved: _Solved) -> CellResponse:
    """Add K_ref of the deformed pore and the smallest J of the fluid's mesh; NaN where the solid has no values."""
    K, smallest, response = np.full((3, 3), np.nan), np.nan, solved.response
    solid, iterate, cell = solved.solid, solved.iterate, prepared.cell
    if solid is not None and iterate is not None:
        pore, place = prepared.pore(solid.mesh.domain), (iterate.H, iterate.displacement, solid.mesh)
        if solved.slopes is None:
            with freed_memory_kept(pore.fluid.mesh.points.size):
                K, smallest = pore.deformed(*place)
        else:
            still = np.zeros_like(solid.mesh.points)
            velocities = [
                still if one.velocity is None else one.velocity for one in prepared.dependences(solid)
            ]
            motion = np.stack(velocities), fluid_velocities(cell, solid.mesh.domain), solved.slopes
            with freed_memory_kept(pore.fluid.mesh.points.size):
                K, smallest, K_slopes = pore.deformed_slopes(*place, *motion)
            response = _with_slopes(response, prepared.open_only(with_viscosity(cell, K, K_slopes)))
        K = prepared.open_only(K)
    return replace(response, conductivity=K[None] / cell.viscosity, min_fluid_jacobian=np.array([smallest]))


def _start(solid: DiscreteSolid, field: CellField | None) -> Iterate:
    """Return the iterate of a field on this domain's mesh; else the cell without stress."""
    if field is None or field.domain != solid.mesh.domain or len(field.u) != len(solid.mesh.points):
        return solid.iterate_at(solid.unstressed, 0.0)
    return solid.iterate_at(field.grad_u, field.p, field.u)
