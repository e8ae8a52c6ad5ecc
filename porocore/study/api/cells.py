"""One cell from Python (CellProblem): porosity, conductivity, response to states."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.cell import Cell
from porocore.cell.family.ranges import member_with
from porocore.core.echo import echo
from porocore.core.inputs.given_states import given_states
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.effective import EffectiveProperties
from porocore.macro.reference import CellReference, porosity_at_rest
from porocore.plugins.border import conductivity_of, solution_of
from porocore.plugins.registry import registry
from porocore.sampling.execution.solved_store import StoringSolver
from porocore.states import Array, CellResponse, Status
from porocore.study.config.loading import cell_from
from porocore.study.stages.stage_files import prepare_cell
from porocore.study.store import chosen_store, solved_states


class CellProblem:
    """A cell that is ready to be solved.

    Parameters
    ----------
    cell
        The section ``cell`` of a configuration, as :class:`porocore.Cell` or nested settings.
    fem
        Name of the backend.
    parameters
        Values of the cell's parameters by name: of each that is a range, and of further numbers to replace.
    store
        Folder of results that studies share; True: that of the user, False: none. A state that it holds is not solved.
    **options
        Options of the backend's cell solver.

    Raises
    ------
    ConfigurationError
        The settings are faulty, or the cell cannot be meshed.
    PluginError
        The backend is missing.

    Examples
    --------
    >>> from porocore import CellProblem
    >>> cell = CellProblem({"mesh": {"size": 0.5, "fluid_size": 0.5}}, fem="skfem")
    >>> round(cell.porosity, 4), round(cell.geometric_porosity, 4)
    (0.4122, 0.4123)
    >>> response = cell.response([[0, 0, 0], [0, -0.1, 0], [0, 0, 0]], p=0.05)
    >>> response.stress[0].diagonal().round(3)
    array([-0.048, -0.088, -0.048])
    >>> cell.properties.young_moduli.round(3)  # multiples of E
    array([0.392, 0.392, 0.392])
    """

    def __init__(
        self,
        cell: Cell | Mapping[str, Any] | None = None,
        *,
        fem: str = "skfem",
        parameters: Mapping[str, float] | None = None,
        store: str | Path | bool = True,
        **options: Any,
    ) -> None:
        if cell is not None and not isinstance(cell, Cell | Mapping):
            raise ConfigurationError(
                f"cell: expected a porocore.Cell, or settings as in the section 'cell' of a file, got {echo(cell)}"
            )
        if not isinstance(fem, str):
            raise ConfigurationError(f"fem: expected the name of a backend, such as 'skfem', got {echo(fem)}")
        if parameters is not None and not isinstance(parameters, Mapping):
            raise ConfigurationError(
                f"parameters: expected values by name, such as {{'radius': 0.22}}, got {echo(parameters)}"
            )
        described = cell if isinstance(cell, Cell) else cell_from(cell or {})
        if not parameters:
            names = ", ".join(f"'{p.name}': {p.base:g}" for p in described.parameters)
            described.require_member(f"give its value with parameters={{{names}}}")
        self.cell = member_with(described, parameters) if parameters else described
        registry().find("cell solver", fem)
        self._solver: CellSolver
        self._unstored, self._prepared = prepare_cell(fem, options, self.cell)
        self._solver = self._unstored
        if known := solved_states(chosen_store(store), fem, options, self.cell):
            self._solver = StoringSolver(self._unstored, known)

    @cached_property
    def porosity(self) -> float:
        """Volume share φ_f of the pores of the mesh, to which conductivity and responses belong."""
        return porosity_at_rest(self._unstored, self._prepared, self.cell)

    @property
    def geometric_porosity(self) -> float:
        """Volume share of the pores as the geometry is described; the mesh approaches it as its size falls."""
        return self.cell.geometry.porosity

    @cached_property
    def conductivity(self) -> Array:
        """K (3, 3) of the undeformed cell, with the cell's viscosity."""
        return conductivity_of(self._solver, self._prepared)

    @cached_property
    def properties(self) -> EffectiveProperties:
        """Permeability, stiffness, engineering moduli, Biot's coefficients and c_v of the undeformed cell.

        Dimensionless; :meth:`~porocore.macro.laws.effective.EffectiveProperties.in_units` converts them.

        Raises
        ------
        ConfigurationError
            The solid is not connected across the periodic cell.
        SolveError
            The undeformed cell has no solution.
        """
        self.cell.require_stiffness()
        response = self.response(np.zeros((3, 3)))
        if not response.valid.all():
            raise SolveError(
                f"the undeformed cell ended with status '{Status(int(response.status[0])).name}'"
            )
        before = self.porosity if self.cell.solid.swells else None
        return CellReference("", response, self.conductivity, {}, before).properties(self.cell, "piola")

    def response(
        self, grad_u: npt.ArrayLike, p: npt.ArrayLike = 0.0, *, tangent: bool = True
    ) -> CellResponse:
        """Solve the solid for one state or for n of them.

        Parameters
        ----------
        grad_u : (3, 3) or (n, 3, 3)
            H_ij = ∂u_i/∂X_j.
        p : number or (n,)
            Pore pressure, positive in compression [E].
        tangent
            Compute the derivatives, too.

        Returns
        -------
        CellResponse
            n rows, 1 for one state; a state that cannot be solved has a status and NaN.

        Raises
        ------
        ConfigurationError
            The shapes do not belong together, or a number is not finite.
        """
        states = given_states(grad_u, p)
        if not len(states):
            raise ConfigurationError("grad_u: expected at least one state, got none")
        return solution_of(self._solver, self._prepared, states, tangent=tangent).response
