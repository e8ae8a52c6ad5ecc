"""One state of the cell solved and written with its local fields, as a .vtu file for ParaView."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from porocore.cell.cell import Cell
from porocore.commands.fields.points import NodalFields, PointFields
from porocore.core.files.atomic import new_folder
from porocore.core.files.store import ResultStore
from porocore.core.inputs import named_state, require_possible, value_text
from porocore.core.units import units_now, using_units
from porocore.errors import ConfigurationError, PorocoreError
from porocore.plugins.border import solution_of
from porocore.report.text import MEANINGS
from porocore.report.vtk import write_vtu
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.notes.checks import find_backends
from porocore.study.run.composition import prepare_stored
from porocore.study.store import chosen_store, told


def write_fields(path: Path, nodal: NodalFields) -> Path:
    """Write one .vtu file of the solid of the whole cell, atomically; returns its path.

    Linear or quadratic tetrahedra (VTK types 10 and 24) on the undeformed cell. At the nodes: ``u1`` (u¹) and
    ``u1_magnitude`` [–]; ``displacement`` (H X + u¹), by which ParaView's filter Warp By Vector deforms the cell;
    ``grad_u1`` (∇u¹) and ``F``, ``P`` (first Piola–Kirchhoff) and ``cauchy`` [E], tensors of 9 components, row by row;
    ``J``, ``energy`` (Ψ) and ``von_mises`` [E]. In the elements: ``mean_energy``, ``mean_J`` and ``max_energy``, of the
    quadrature points, which no recovery has touched. In a study with scales what is in E has its unit of stress, with
    which its name ends, ``P [kPa]``; lengths stay in edges of the cell.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    points = nodal.points
    share = points.volume / points.volume.sum(axis=1, keepdims=True)
    units = units_now()

    def measured(quantity: str, fields: Mapping[str, Array]) -> dict[str, Array]:
        return {
            units.titled(name, quantity): units.factor(quantity) * values for name, values in fields.items()
        }

    at_nodes = {
        "u1": points.u,
        "u1_magnitude": np.linalg.norm(points.u, axis=1),
        "displacement": nodal.displacement,
        "grad_u1": nodal.grad,
        "F": nodal.F,
        "J": nodal.J,
    }
    at_nodes |= measured("energy-density", {"energy": nodal.energy})
    at_nodes |= measured("stress", {"P": nodal.stress, "cauchy": nodal.cauchy, "von_mises": nodal.von_mises})
    energies = {"mean_energy": (share * points.energy).sum(axis=1), "max_energy": points.energy.max(axis=1)}
    in_elements = {"mean_J": (share * points.J).sum(axis=1), **measured("energy-density", energies)}
    return write_vtu(path, points.mesh.points, points.mesh.cells, at_nodes, in_elements)


#: The loads of the paper's figures disp_pressure to energy_shear. It does not give their magnitudes; these lie within
#: the ranges that it samples, in equilibrium without contact.
PAPER_STATES: dict[str, dict[str, float]] = {
    "pressure": {"p": 0.5},
    "uni": {"H11": 0.4},
    "shear": {"H12": 0.4},
}

#: Characters of a state in the name of its files.
LONGEST_NAME = 120


@dataclass(frozen=True, eq=False)
class LocalFields:
    """A solved state and its files.

    Attributes
    ----------
    response
        One row, with extrema and without tangent.
    points, nodal
        The fields at the quadrature points and at the nodes.
    vtu
        For ParaView.
    pictures
        Paths by ``"disp"`` and ``"energy"``; empty where none were asked for.
    """

    response: CellResponse
    points: PointFields
    nodal: NodalFields
    vtu: Path
    pictures: dict[str, Path]


def solve_and_write(
    cell: Cell,
    fem: FemSettings,
    folder: Path,
    state: Mapping[str, float],
    *,
    name: str = "fields",
    pictures: bool = True,
    store: ResultStore | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> LocalFields:
    """Solve one state and write ``<name>.vtu``, ``disp_<name>.png`` and ``energy_<name>.png``.

    Parameters
    ----------
    cell, fem
        The cell and the backend that solves it.
    folder
        Created if it does not exist; files of the same name are replaced.
    state
        Inputs H11 … H33 and p that are not zero.
    pictures
        Draw the pictures, which needs pyvista.
    store, tell
        Store of solved states, and what is called with what came from it.

    Raises
    ------
    ConfigurationError
        An input is unknown or not finite, or the backend returns no fields.
    PorocoreError
        The state has no values, or the pictures cannot be drawn; the .vtu file is written by then.
    RunFolderError
        A file cannot be written.
    """
    response, points = solve_fields(cell, fem, state, store, tell)
    nodal = NodalFields(points)
    vtu = write_fields(folder / f"{name}.vtu", nodal)
    drawn: dict[str, Path] = {}
    if pictures:
        from porocore.commands.fields.pictures import render

        status = Status(int(response.status[0]))
        title = state_text(state, mathtext=True) + ("" if status is Status.converged else f" ({status.name})")
        drawn = render(vtu, nodal, folder, name, title)
    return LocalFields(response, points, nodal, vtu, drawn)


def write_local_fields(
    config: RunConfig,
    folder: Path | str,
    state: Mapping[str, float],
    *,
    name: str | None = None,
    pictures: bool = True,
    store: ResultStore | str | Path | bool = True,
    tell: Callable[[str], None] = lambda text: None,
) -> LocalFields:
    """Solve one state of the cell of a configuration and write its local fields.

    Parameters
    ----------
    config
        The study; only its cell and finite elements count.
    folder
        Place of the files; files of the same name are replaced.
    state
        Inputs H11 … H33 and p that are not zero.
    name
        Name of the files; by default it contains the state.
    pictures
        Draw two pictures, which needs pyvista.
    store
        Folder of results that studies share; True: that of the user, False: none. A state that it holds is not solved.
    tell
        Called with what came from the store.

    Raises
    ------
    ConfigurationError, PorocoreError, RunFolderError
        See ``solve_and_write``.
    PluginError
        The backend is missing.
    """
    with using_units(config.result_units):
        state_row(config.cell, state)
        find_backends(config, ["cell solver"])
        if name is None:
            name = ",".join(f"{key}={value_text(key, value)}" for key, value in state.items()) or "rest"
        name = re.sub(r"[^A-Za-z0-9.+-]+", "_", name.strip())[:LONGEST_NAME]
        folder, kept = new_folder(Path(folder)), chosen_store(store)
        return solve_and_write(
            config.cell, config.fem, folder, state, name=name, pictures=pictures, store=kept, tell=tell
        )


def state_row(cell: Cell, state: Mapping[str, float]) -> Array:
    """Return the ten components of a state of ``cell``.

    Raises
    ------
    ConfigurationError
        An input is unknown or not finite, or no cell can be in the state.
    """
    row = named_state(state)
    require_possible(row[:9], row[9], cell.modulus, state_text(state))
    return row


def solve_fields(
    cell: Cell,
    fem: FemSettings,
    state: Mapping[str, float],
    store: ResultStore | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> tuple[CellResponse, PointFields]:
    """Response and fields of one state; errors as of ``solve_and_write``."""
    row = state_row(cell, state)
    solver, prepared, known = prepare_stored(store, fem.backend, fem.options, cell)
    asked = MacroState.single(row[:9], row[9])
    with told(known, "cell", tell):
        solution = solution_of(solver, prepared, asked, tangent=False, fields=True)
    if solution.fields is None:
        raise ConfigurationError(
            f"--fem: backend '{fem.backend}' gives no fields of its cell; choose one that does, such as skfem"
        )
    field = solution.fields[0]
    if field is None:
        status = Status(int(solution.response.status[0]))
        raise PorocoreError(
            f"{state_text(state)} has no local fields to write, its status is {status.name}: {MEANINGS[status]}"
        )
    return solution.response, PointFields.from_cell_field(cell, field)


def state_text(state: Mapping[str, float], *, mathtext: bool = False) -> str:
    """``H22 = −0.2, p = 0.1``, for a figure with indices."""
    labels = {name: "$p$" if name == "p" else f"$H_{{{name[1:]}}}$" for name in state} if mathtext else {}
    moved = [(name, labels.get(name, name), value) for name, value in state.items() if value]
    parts = [f"{label} = {value_text(name, value)}" for name, label, value in moved]
    return ", ".join(parts).replace("-", "−") if parts else "the undeformed state"
