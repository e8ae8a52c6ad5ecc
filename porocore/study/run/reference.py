"""The cell stage: the undeformed cell, from the store or solved; one state of a cell on its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.family import base_values
from porocore.cell.family.mesh import UnstressedFamily
from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.macro.boundary.drainage import undrained
from porocore.macro.laws.closure import ConductivityLaw
from porocore.macro.laws.linear import EffectiveProperties
from porocore.macro.reference import CellReference, porosity_at_rest
from porocore.plugins.border import conductivity_of, solution_of
from porocore.sampling.execution.solved_store import StoringSolver
from porocore.states import Array, CellResponse, CellSlopes, MacroState, Status
from porocore.study.config.config import FemSettings, RunConfig, cell_identity
from porocore.study.notes.abilities import broken_by_the_mesh
from porocore.study.notes.magnitudes import unloaded
from porocore.study.run.composition import prepare_cell
from porocore.study.run.folder import RunFolder, StageClock, timed
from porocore.study.run.results import load_reference
from porocore.study.store import cell_key, fetch_files, keep_files, solved_states, told

#: Responses whose slopes by the parameters are shown.
SLOPES = ("potential", "stress", "fluid_volume", "porosity", "conductivity")


def solve_reference(
    folder: RunFolder,
    *,
    console: Console,
    store: ResultStore | None = None,
    begin: Callable[[], None] = lambda: None,
) -> None:
    """Solve the undeformed cell unless folder or store hold it; tell its properties and what is wrong with them.

    ``begin`` is called before it is solved.
    """
    config = folder.config
    if not folder.reference.exists():
        with timed(folder.timings, "cell") as clock:
            remark = _solve_rest(
                folder.reference, config.cell, config.fem, config.conductivity, store, clock, begin
            )
        if remark:
            console.note(f"{folder.stage_of_cell('cell')}: {remark}")
    reference = load_reference(folder)
    diagonal = config.result_units.texts(np.diag(reference.conductivity), "conductivity")
    which = " in the middle of the ranges" if config.cell.is_family else ""
    title = folder.stage_of_cell("cell") + which
    console.note(f"{title}: porosity {reference.porosity:.4f}, conductivity K_11, K_22, K_33 = {diagonal}")
    suspect = (
        *config.cell.geometry.warnings,
        *broken_by_the_mesh(reference.response, config.cell.point_group),
    )
    for warning in suspect:
        console.warn(folder.said_of_cell(warning))


def warn_of_loading(folder: RunFolder, *, console: Console) -> None:
    """Warn of numbers without a unit beside others with one, of a body that nothing loads, and of one undrained.

    The cells are solved.
    """
    for warning in (*folder.config.unit_notes, *unloaded(folder.config.macro, folder.config.all_cells)):
        console.warn(warning)
    found = [load_reference(files).conductivity for files in folder.of_each_cell]
    for warning in undrained(folder.config.macro, np.max(found, axis=0)):
        console.warn(warning)


def undeformed(cell: Cell, fem: FemSettings, conductivity: str, store: ResultStore | None) -> CellReference:
    """Return the undeformed cell, from the store if it is there.

    Raises
    ------
    PorocoreError
        It cannot be solved.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "cell.json"
        _solve_rest(path, cell, fem, conductivity, store, StageClock())
        return CellReference.load(path, cell_identity(cell, fem))


def _solve_rest(
    path: Path,
    cell: Cell,
    fem: FemSettings,
    conductivity: str,
    store: ResultStore | None,
    clock: StageClock,
    begin: Callable[[], None] = lambda: None,
) -> str:
    """Solve the undeformed cell and save it, or take it from the store; return the solver's remark.

    That of a family is the one in the middle of the ranges, before its whole solid swells.
    """
    files = {"cells": path}
    key = "" if store is None else cell_key(fem.backend, fem.options, cell, conductivity)
    if (saved := fetch_files(store, key, files)) is not None:
        clock.add(saved)
        return ""
    begin()
    cell = cell.in_equilibrium
    one = UnstressedFamily(cell).at(base_values(cell.parameters)) if cell.is_family else cell
    solver, prepared = prepare_cell(fem.backend, fem.options, one, conductivity)
    CellReference.compute(solver, prepared, one, cell_identity(cell, fem)).save(path)
    keep_files(store, key, files, clock.seconds)
    return solver.remark(prepared)


def solve_cell(
    config: RunConfig,
    grad_u: Any,
    p: float,
    *,
    store: ResultStore | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Solve one state of the cell; return the responses and their derivatives as nested dictionaries of arrays.

    At rest there are the effective properties (``properties``, as :class:`EffectiveProperties`) and ``warnings``, too.
    A solid that is not connected has no responses; at rest, what is known of its flow is returned. ``tell`` is called
    with what came from the store and, of a state that is not at rest, with what is suspect about the pores.
    """
    cell, rest = config.cell, p == 0 and not np.any(grad_u)
    began = time.perf_counter()
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    (solver, prepared), known = prepare_cell(*arguments), solved_states(store, *arguments)
    conductivity = conductivity_of(solver, prepared)
    for warning in () if rest else cell.geometry.warnings:
        tell(f"note: {warning}")
    unstored, solver = solver, solver if known is None else StoringSolver(solver, known)
    if (disconnected := cell.disconnected) and rest:
        porosity = cell.mesh_porosity
        return {
            "porosity": porosity,
            "conductivity": conductivity,
            "solid": f"disconnected: {disconnected}",
            "properties": EffectiveProperties.of_flow(porosity, conductivity, cell.viscosity),
            "warnings": [f"the solid is not connected, so it has no stiffness: {disconnected}"],
            "seconds": {"set_up": time.perf_counter() - began},
        }
    # A cell before it swells is another one than that whose states are stored.
    porosity = porosity_at_rest(unstored if config.cell.solid.swells else solver, prepared, config.cell)
    ready = time.perf_counter()
    saved_at_rest, saved = (0.0 if known is None else known.saved), list[float]()
    with told(known, "cell", tell, saved.append):
        response = solution_of(solver, prepared, MacroState.single(grad_u, p)).response
    found: dict[str, Any] = {
        "porosity": porosity,
        "conductivity": conductivity,
        "status": Status(int(response.status[0])).name,
        "mean_grad": response.mean_grad[0],
    }
    for name in ("stress", "fluid_volume", "potential"):
        values = getattr(response, name)
        found[name] = None if values is None else values[0]
    if response.conductivity is not None and response.min_fluid_jacobian is not None:
        found["deformed_conductivity"] = response.conductivity[0]
        found["min_fluid_jacobian"] = response.min_fluid_jacobian[0]
    for part, holder in (("tangent", response.tangent), ("peaks", response.extrema)):
        if holder is not None:
            found[part] = {name: value[0] for name, value in vars(holder).items() if value is not None}
    if rest:
        found |= _properties(response, porosity, conductivity, cell, config.conductivity, config.fem.backend)
    if response.slopes is not None:
        found["slopes"] = _by_parameter(response.slopes, [each.name for each in config.cell.parameters])
    return found | {
        "seconds": {
            "set_up": ready - began + saved_at_rest,
            "solve": time.perf_counter() - ready + sum(saved),
        }
    }


def _properties(
    response: CellResponse,
    porosity: float,
    conductivity: Array,
    cell: Cell,
    law: ConductivityLaw,
    backend: str,
) -> dict[str, Any]:
    """Return the effective properties of the cell by its response at rest, and warnings."""
    derivatives = response.tangent
    flow = EffectiveProperties.of_flow(porosity, conductivity, cell.viscosity)
    if response.status[0] != Status.converged:
        name = Status(int(response.status[0])).name
        why = f"at rest the cell ended with the status '{name}', so its moduli are not known"
        return {"properties": flow, "warnings": [why]}
    if derivatives is None or response.fluid_volume is None or derivatives.stress_grad_u is None:
        why = f"the cell solver '{backend}' gives no derivatives, so there are no moduli"
        return {"properties": flow, "warnings": [why]}
    reference = CellReference("", response, conductivity, {}, porosity if cell.solid.swells else None)
    return {
        "properties": reference.properties(cell, law),
        "warnings": broken_by_the_mesh(response, cell.point_group),
    }


def _by_parameter(slopes: CellSlopes, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the slopes of one row by parameter, then by response."""
    given = {name: getattr(slopes, name) for name in SLOPES}
    return {
        parameter: {name: values[0][..., k] for name, values in given.items() if values is not None}
        for k, parameter in enumerate(names)
    }
