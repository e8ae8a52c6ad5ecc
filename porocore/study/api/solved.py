"""Results from Python (Samples, Solved, Solutions); one cell from Python (CellProblem)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from porocore.cell.cell import Cell
from porocore.cell.family.family import member_with
from porocore.core.echo import choices, did_you_mean, echo, suggestion
from porocore.core.files.plain_data import merged
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.inputs import given_states
from porocore.core.units import ResultUnits
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.solution import HISTORY, MacroSolution, Profile, words_of
from porocore.macro.laws.linear import EffectiveProperties
from porocore.macro.reference import CellReference, porosity_at_rest, require_solved
from porocore.plugins.border import conductivity_of, solution_of
from porocore.plugins.registry import registry
from porocore.report.context import reactions
from porocore.report.dimensional import figures_with_units
from porocore.report.vtk import memory_fields
from porocore.sampling.execution.solved_store import StoringSolver
from porocore.states import Array, CellResponse, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import cell_from, examples, validated
from porocore.study.run.composition import prepare_cell
from porocore.study.run.folder import LINEAR
from porocore.study.store import chosen_store, solved_states

if TYPE_CHECKING:
    import pyvista
    import xarray


T = TypeVar("T")
#: VTK's numbers of the elements, by how many nodes they have.
VTK_CELLS = {27: 29, 10: 24, 9: 28, 6: 22}
COMPONENTS = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Samples:
    """Solved states of the cell.

    Attributes
    ----------
    names
        Names of the d inputs, in the order of the columns of ``x``.
    x : (n, d)
        Values of the inputs.
    states, responses
        n states and their responses.
    """

    names: tuple[str, ...]
    x: Array
    states: MacroState
    responses: CellResponse


@dataclass(frozen=True, eq=False)
class Solved:
    """One macro solution.

    All arrays are dimensionless; :attr:`forces`, :meth:`to_xarray` and :meth:`to_pyvista` convert to the units of
    the study.

    Attributes
    ----------
    solution
        Mesh, history and profiles as they are stored.
    units
        Units of the study.
    """

    solution: MacroSolution
    units: ResultUnits = field(default_factory=ResultUnits)

    def __repr__(self) -> str:
        end = self.units.text(self.time[-1], "time", 6)
        return f"<{self.law} under load {self.load:g}: {len(self.time) - 1} steps up to t = {end}>"

    @property
    def law(self) -> str:
        """Name of the law."""
        return self.solution.law

    @property
    def load(self) -> float:
        """Factor of all prescribed values."""
        return self.solution.load

    @property
    def time(self) -> Array:
        """Times (steps,); the first is the state at rest."""
        return self.solution.history.time

    @property
    def settlement(self) -> Array:
        """Largest displacement against the y axis, (steps,)."""
        return self.solution.history.settlement

    @property
    def pressure(self) -> Array:
        """Largest pore pressure, with fixed charges effective fluid pressure, (steps,)."""
        return self.solution.history.pressure_max

    @property
    def drained(self) -> Array:
        """Volume of fluid that has left through the boundary, (steps,)."""
        return self.solution.history.drained

    @property
    def probes(self) -> Mapping[str, Array]:
        """u_1, u_2, u_3 and p, (steps, 4), by probe."""
        return self.solution.probes

    @property
    def reactions(self) -> Mapping[str, Array]:
        """Force on the whole body, (steps, 3), positive along the axes, by surface."""
        return self.solution.reactions

    @property
    def compression(self) -> Mapping[str, Array]:
        """Compressive force on the whole body, (steps,), by plane surface; negative in tension."""
        return self.solution.compression

    @property
    def forces(self) -> dict[str, dict[str, Any]]:
        """Peak, end and relaxation of the force on each surface, as in ``metrics.json``; with scales in units."""
        found: dict[str, dict[str, Any]] = figures_with_units(reactions(self.solution), self.units)
        return found

    @property
    def inflow(self) -> Mapping[str, Array]:
        """Rate of fluid that enters, (steps,), by surface."""
        return self.solution.inflow

    @property
    def profile_times(self) -> tuple[float, ...]:
        """Times at which the fields were kept."""
        return tuple(profile.time for profile in self.solution.profiles)

    def profile(self, time: float | None = None) -> Profile:
        """Return the fields at a kept time, by default the last.

        Raises
        ------
        ConfigurationError
            The fields were not kept at this time.
        """
        profiles = self.solution.profiles
        if time is None and profiles:
            return profiles[-1]
        for profile in profiles:
            if time is not None and abs(profile.time - time) <= 1e-9 * max(1.0, abs(time)):
                return profile
        kept = ", ".join(f"{t:g}" for t in self.profile_times) or "no time"
        raise ConfigurationError(
            f"the fields were kept at {kept}, not at {time if time is not None else 'any'}; "
            "add the time to macro.time.profiles"
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return history, probes, reactions and inflow against time, in the units of the study.

        Every variable has the attributes ``units`` (``1`` where it is dimensionless) and ``long_name``. Probes have the
        dimensions (time, probe) and for displacements a component, reactions (time, surface, component), compression
        (time, surface), NaN where the surface is not plane, inflow (time, drain).

        Raises
        ------
        PluginError
            xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise _missing("xarray") from error
        s, history = self.solution, self.solution.history
        found: dict[str, Any] = {
            name: self._variable(("time",), getattr(history, name), quantity, words_of(s, words))
            for name, (quantity, words) in HISTORY.items()
            if name != "time"
        }
        time = self._variable(("time",), history.time, "time", "time")
        times = np.array([self.units.value(float(t), "time") for t in history.time])
        coordinates: dict[str, Any] = {"time": (time[0], times, time[2])}
        places = {name: values[:, :3] for name, values in s.probes.items()}
        pressures = {name: values[:, 3] for name, values in s.probes.items()}
        no_plane = np.full(len(history.time), np.nan)
        pressed = {name: s.compression.get(name, no_plane) for name in s.reactions}
        for name, kind, members, quantity, words in (
            ("probe_displacement", "probe", places, "displacement", "displacement of the probe"),
            ("probe_pressure", "probe", pressures, "pressure", f"{s.pressure} at the probe"),
            (
                "reaction",
                "surface",
                s.reactions,
                "force",
                "force on the body at the surface, positive along the axis",
            ),
            ("compression", "surface", pressed, "force", "compressive force, positive in compression"),
            ("inflow", "drain", s.inflow, "flow", "fluid through the surface, positive into the body"),
        ):
            if members:
                values = np.stack(list(members.values()), axis=1)
                dims = ("time", kind, "component")[: values.ndim]
                coordinates |= {kind: list(members)}
                coordinates |= {"component": list(COMPONENTS)} if "component" in dims else {}
                found[name] = self._variable(dims, values, quantity, words)
        return xarray.Dataset(
            found, coordinates, {"law": s.law, "load": s.load, "backend": s.backend, "source": "porocore"}
        )

    def to_pyvista(self, time: float | None = None) -> pyvista.UnstructuredGrid:
        """Return the undeformed mesh with the fields at a kept time, by default the last, in the units of the study.

        At the nodes ``u`` and ``p``; in the elements ``H``, ``F`` (F̄), ``P_E``, ``K_t`` (tensors of 9 components, row
        by row), ``flux``, ``flagged`` and ``fluid_volume`` (φ), and what a law with memory remembers, as the files for
        ParaView have it. With fixed charges ``p`` is the effective fluid pressure. ``grid.warp_by_vector("u")`` is the
        deformed body. The field data ``time`` is in its unit of time.

        Raises
        ------
        PluginError
            pyvista is not installed.
        ConfigurationError
            The fields were not kept at this time.
        """
        try:
            import pyvista
        except ImportError as error:
            raise _missing("pyvista") from error
        profile, cells = self.profile(time), self.solution.cells
        at = self.solution.profiles.index(profile)
        length, stress = self.units.factor("displacement"), self.units.factor("stress")
        count, nodes = cells.shape
        rows = np.hstack([np.full((count, 1), nodes), cells]).ravel()
        kinds = np.full(count, VTK_CELLS[nodes], dtype=np.uint8)
        grid = pyvista.UnstructuredGrid(rows, kinds, self.solution.points * length)
        grid.point_data["u"] = profile.u * length
        grid.point_data["p"] = profile.p * stress
        fields = {
            "H": (profile.grad_u, ""),
            "F": (profile.deformation, ""),
            "P_E": (profile.stress, "stress"),
            "K_t": (profile.conductivity, "conductivity"),
            "flux": (profile.flux, "velocity"),
            "flagged": (profile.flagged, ""),
            "fluid_volume": (profile.fluid_volume, ""),
        }
        for name, (values, quantity) in (fields | memory_fields(self.solution, at)).items():
            in_units = values * self.units.factor(quantity)
            grid.cell_data[name] = in_units.reshape(count, -1) if values.ndim > 1 else in_units
        grid.field_data["time"] = np.array([self.units.value(profile.time, "time")])
        return grid

    def _variable(self, dims: tuple[str, ...], values: Array, quantity: str, words: str) -> Any:
        unit = self.units.name(quantity) if quantity and self.units.given else "1"
        return dims, values * self.units.factor(quantity), {"units": unit, "long_name": words}


class _Named(dict[Any, T]):
    """Solutions by name; a missing name is refused with those that exist."""

    def __missing__(self, key: Any) -> T:
        raise ConfigurationError(
            f"nothing was solved for {key!r}; {choices(map(repr, self), 'there is', 'no run has ended')}"
        )


class LawsSolved(_Named[Solved]):
    """Solutions of one load by law."""

    @property
    def linear(self) -> Solved:
        """Solution with linear poroelasticity from the same cell."""
        return self[LINEAR]

    @property
    def nonlinear(self) -> Solved:
        """Solution with the first other law: the surrogate, unless another was asked for first."""
        return next(solved for law, solved in self.items() if law != LINEAR)


class Solutions(_Named[LawsSolved]):
    """Solutions by load, in the order of the configuration."""


def _missing(package: str) -> PluginError:
    return PluginError(f"{package} is not installed; install it with: pip install {package}")


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

        Dimensionless; :meth:`~porocore.macro.laws.linear.EffectiveProperties.in_units` converts them.

        Raises
        ------
        ConfigurationError
            The solid is not connected across the periodic cell, swells too much or is nearly incompressible.
        SolveError
            The undeformed cell has no solution.
        """
        self.cell.require_stiffness()
        response = self.response(np.zeros((3, 3)))
        require_solved(response, self.cell)
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


def configured(
    source: str | Path | Mapping[str, Any] | RunConfig | None, settings: dict[str, Any]
) -> tuple[str, RunConfig, YamlDocument]:
    """Return a name for the folder, the configuration, and the document that it was read from."""
    if not isinstance(source, str | Path | Mapping | RunConfig | None):
        raise ConfigurationError(
            "source: expected the path of a configuration, the name of an example or nested settings, got "
            + echo(source)
        )
    if not isinstance(source, str | Path):
        base = {**source.model_dump(), **source.sections} if isinstance(source, RunConfig) else source or {}
        document = YamlDocument.of(merged(base, settings), Path.cwd())
        return (
            "study",
            source if isinstance(source, RunConfig) and not settings else validated(document),
            document,
        )
    path = Path(source)
    known = examples()
    if not path.exists() and path.name.removesuffix(".yaml") in known and path.parent == Path("."):
        path = known[path.name.removesuffix(".yaml")].path
    elif not path.suffix and not path.exists() and (question := did_you_mean(path.name, known)):
        raise ConfigurationError(f"{path}: no such file, and no example of this name; {question}")
    document = YamlDocument.read(path)
    if settings:
        document = YamlDocument.of(merged(document.data, settings), document.folder)
    return path.stem, validated(document), document


def of_named_cell(config: RunConfig, name: str | None) -> RunConfig:
    """Return the study of one cell alone; see :meth:`RunConfig.of_cell`.

    Raises
    ------
    ConfigurationError
        The study has no cell of this name.
    """
    if name is not None and name not in config.cells:
        known = suggestion(str(name), config.cells, "the cells are", "it has one cell, without a name")
        raise ConfigurationError(f"cell: the study has no cell {echo(name)}; {known}")
    return config.of_cell(name)


def values_over(
    parameter: str | Mapping[str, Sequence[float]], values: Sequence[float] | None
) -> Mapping[str, Sequence[float]]:
    """Return the values of a sweep by the name of the parameter.

    Raises
    ------
    ConfigurationError
        A name has no values, or what is given are no names.
    """
    over = {parameter: values} if isinstance(parameter, str) else parameter
    if not isinstance(over, Mapping) or any(given is None for given in over.values()):
        raise ConfigurationError(
            "expected the name of a parameter and its values, such as sweep('radius', [0.16, 0.22, 0.28])"
        )
    return {name: given for name, given in over.items() if given is not None}
