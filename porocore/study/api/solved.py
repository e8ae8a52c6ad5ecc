"""Results from Python (Samples, Solved, Solutions): arrays, xarray datasets, pyvista grids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from porocore.core.echo import choices
from porocore.core.units.results import ResultUnits
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.solution import MacroSolution, Profile, file_name
from porocore.macro.series import HISTORY
from porocore.report.dimensional import figures_with_units
from porocore.report.loading_mode import reactions
from porocore.states import Array, CellResponse, MacroState
from porocore.study.run_folder.files import LINEAR

if TYPE_CHECKING:
    import pyvista
    import xarray

T = TypeVar("T")
#: VTK's numbers of the elements, by how many nodes they have.
VTK_CELLS = {27: 29, 10: 24}
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
        """Largest pore pressure, (steps,)."""
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
            file_name(name): self._variable(("time",), getattr(history, name), quantity, words)
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
            ("probe_pressure", "probe", pressures, "pressure", "pore pressure at the probe"),
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
        by row), ``flux`` and ``outside``. ``grid.warp_by_vector("u")`` is the deformed body. The field data ``time`` is
        in its unit of time.

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
        length, stress = self.units.factor("displacement"), self.units.factor("stress")
        count, nodes = cells.shape
        rows = np.hstack([np.full((count, 1), nodes), cells]).ravel()
        kinds = np.full(count, VTK_CELLS[nodes], dtype=np.uint8)
        grid = pyvista.UnstructuredGrid(rows, kinds, self.solution.points * length)
        grid.point_data["u"] = profile.u * length
        grid.point_data["p"] = profile.p * stress
        for name, values, factor in (
            ("H", profile.grad_u, 1.0),
            ("F", profile.deformation, 1.0),
            ("P_E", profile.stress, stress),
            ("K_t", profile.conductivity, self.units.factor("conductivity")),
            ("flux", profile.flux, self.units.factor("velocity")),
            ("outside", profile.outside_training_range, 1.0),
        ):
            grid.cell_data[name] = values.reshape(count, -1) * factor if values.ndim > 1 else values * factor
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
