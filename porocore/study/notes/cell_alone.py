"""Cells without a study: outline before a solve, and the table of the properties of one at rest, with notes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.family import member_with
from porocore.cell.meshing.connectivity import blocked, pieces
from porocore.cell.quality import CLOSED_PORES, closed_pores, grains, measure_mesh_quality
from porocore.core.files.store import ResultStore
from porocore.core.units import MULTIPLES, ResultUnits, Scales, using_units
from porocore.errors import PluginError
from porocore.macro.laws.linear import SAME, EffectiveProperties
from porocore.plugins import registry
from porocore.report.format import multiple, number, percent, plain
from porocore.report.words.cell import held_rows, moduli_rows, symmetric
from porocore.states import Array
from porocore.study.config.config import RunConfig, lines_of_cell
from porocore.study.notes.abilities import resolution, slow_states
from porocore.study.notes.at_rest import (
    cell_lines,
    coefficients_of_consolidation,
    edges,
    tetrahedra_solved,
    thin_fluid,
    too_large_to_solve,
)
from porocore.study.notes.cost import CellCost
from porocore.study.notes.forecast import as_time, parts_at_rest
from porocore.study.notes.outline import cell_outline
from porocore.study.run.reference import solve_cell

#: A conductivity below this share of the largest, or of d²/μ_c, is round-off.
ROUND_OFF = 1e-9, 1e-12
#: Numbers of a study without scales.
DIMENSIONLESS = (
    "dimensionless: multiples of E, the reference modulus (Young's modulus of a neo-Hookean solid), of d, the edge of "
    "the cell (of a box the cube root of its volume), and of μ_c, the unit of cell.viscosity; with 'scales:' numbers "
    "have units"
)
AXES = (
    "axes 1, 2, 3 are x, y, z; the permeability is k = K μ_f; ν_ij is the contraction along j by the extension along i "
    "under stress along i"
)


def outline_of_cells(config: RunConfig, store: ResultStore | None) -> Iterator[str]:
    """Yield the outline of the cells of a file that has no more: meshes, cost, and their properties at rest.

    Raises
    ------
    ConfigurationError
        A cell cannot be meshed.
    PorocoreError
        The undeformed cell cannot be solved.
    """
    yield config.title or (
        "a cell without a study" if len(config.own_cells) == 1 else "cells without a study"
    )
    for name in config.own_cells:
        one = config.of_cell(name)
        with config.keys_of(name):
            quality = measure_mesh_quality(one.cell)
            yield from cell_outline(one, name, quality)
            solid, fluid = (phase.nodes if phase else 0 for phase in (quality.solid, quality.fluid))
            if one.cell.is_family:
                ranges = ", ".join(f"{p.name} {p.lower:g} to {p.upper:g}" for p in one.cell.parameters)
                yield f"  a family of cells: {ranges}; meshes, pores and moduli are those of the middle"
            yield from _cost(one.cell, solid * math.prod(one.cell.supercell), fluid)
            yield from _at_rest(one, name, store)
            yield from lines_of_cell(name, thin_fluid(one.cell, one.scales))


def _cost(cell: Cell, solid: int, fluid: int) -> Iterator[str]:
    """Yield what a state at rest and K take; the nodes are those of the whole cell."""
    cost = CellCost(solid, fluid, parts_at_rest(cell))
    yield (
        f"  solved are {cost.nodes[0]:,.0f} nodes of the solid and {cost.nodes[1]:,.0f} of the fluid: "
        f"{as_time(cost.first + cost.state)} for the state at rest, {as_time(cost.conductivity)} for K on one quiet "
        "core"
    )
    if slow := slow_states(cost.nodes[0], cell.mesh.size, cost.parts[0]):
        yield f"note: {slow}"


def _at_rest(one: RunConfig, name: str | None, store: ResultStore | None) -> Iterator[str]:
    """Yield the properties of a cell at rest, in short; of a family those of its middle."""
    head = "at rest" if name is None else f"cell {name} at rest"
    try:
        registry.get("cell solver", one.fem.backend)
    except PluginError as error:
        yield f"{head}: not solved: {error}"
        return
    cell = one.cell
    if said := too_large_to_solve(tetrahedra_solved(cell)):
        yield f"{head}: {said}"
        return
    middle = ", in the middle of the ranges" if cell.is_family else ""
    if cell.is_family:
        cell = member_with(cell, {each.name: each.base for each in cell.parameters})
    solved = solve_cell(one.model_copy(update={"cell": cell}), np.zeros((3, 3)), 0.0, store=store)
    found: EffectiveProperties = solved["properties"]
    yield f"{head}, drained{middle}:"
    yield from (f"  {line}" for line in cell_lines(found, cell.viscosity, one.result_units))
    if found.storage > 0:
        yield f"  {coefficients_of_consolidation(found, (0, 1, 2), one.result_units)}"
    yield from (f"note: {warning}" for warning in solved["warnings"])


def table_of_cell(config: RunConfig, found: EffectiveProperties) -> Iterator[str]:
    """Yield the properties of the cell of a configuration at rest as a table, with all that they mean."""
    cell, units = config.cell, config.result_units
    with using_units(units):
        yield f"{cell.geometry.description}; {cell.solid.description}"
        yield from (line.strip() for line in edges(cell, config.cell_length))
        rows = [*_flow_rows(config, found), *held_rows(found), *(moduli_rows(found) if found.stiff else ())]
        width = max(len(name) for name, _ in rows)
        yield from (f"{name:{width}}  {text}" for name, text in rows)
        if found.stiff:
            yield from _matrix(found.stiffness_voigt, units)
            yield _class_of(cell, found)
    yield AXES
    if not units.given:
        yield DIMENSIONLESS
    yield from (f"note: {note}" for note in notes(cell, config.cell_length, config.scales))


def _class_of(cell: Cell, found: EffectiveProperties) -> str:
    """Return the symmetry of the stiffness, and that of the pores and the solid, in a sentence."""
    is_it = "neither isotropic nor cubic" if found.isotropy == "anisotropic" else found.isotropy
    text = f"stiffness: {is_it} to {percent(SAME)}; point group {cell.point_group.name} of pores and solid"
    if found.isotropy == "anisotropic" and cell.point_group.name == "m-3m":
        text += ", which is cubic: what differs between the axes is the error of the mesh (cell.mesh.size)"
    return text


def notes(cell: Cell, length: float | None, scales: Scales | None) -> Iterator[str]:
    """Yield what a reader of the properties of a cell has to know of its pores, image and fluid.

    ``length`` is that of the cell [m], where it is known.
    """
    single = cell.model_copy(update={"supercell": (1, 1, 1)})
    yield from single.geometry.warnings
    yield from single.geometry.notes
    yield from grains(single)
    if single.geometry.error_of_shape:
        yield single.geometry.error_of_shape
    for line in resolution(single, length):
        if line.startswith("note: "):
            yield line.removeprefix("note: ")
    if cell.solid.swells:
        yield (
            "the solid swells: moduli, α, M_B and c_v are those of small changes of the cell whose swelling is held at "
            "H = 0"
        )
    fluid = pieces(single.make_mesh("fluid", "whole"))
    if closed_pores(fluid):
        yield CLOSED_PORES
    if fluid and (axes := blocked(fluid)):
        yield (
            f"the pores do not run through the cell along {', '.join(axes)}; K and k there are 0, up to the error of "
            "the mesh"
        )
    yield from (note.removeprefix("note: ") for note in thin_fluid(cell, scales))


def _flow_rows(config: RunConfig, found: EffectiveProperties) -> Iterator[tuple[str, str]]:
    """Yield porosity, permeability and conductivity."""
    cell, units, length = config.cell, config.result_units, config.cell_length
    described = cell.geometry.porosity
    before = ", before the solid swells" if cell.solid.swells else ""
    yield f"porosity φ_f of the mesh{before}", number(found.porosity if described else 0.0)
    if abs(described - found.porosity) > SAME * described + ROUND_OFF[1]:
        yield "porosity as described, before meshing", number(described)
    square = length**2 if length is not None and not units.given else None

    def k(value: float) -> str:
        text = multiple(value, "permeability")
        return text if square is None or not value else f"{number(value * square)} m² = {text}"

    def K(value: float) -> str:
        text = multiple(value, "conductivity")
        if units.scales is None or not value:
            return text
        return f"{text} = {number(value * units.scales.factor('conductivity'))} m⁴/(N s)"

    viscosity = f"{plain(cell.viscosity * units.factor('viscosity'))} "
    viscosity += units.name("viscosity") if units.given else MULTIPLES["viscosity"]
    if units.given:
        yield "reference modulus E of the materials", multiple(1.0, "stress")
    yield from ((f"permeability {name}", k(x)) for name, x in symmetric("k", _clean(found.permeability), k))
    for name, value in symmetric("K", _clean(found.conductivity), K):
        yield f"conductivity {name} at μ_f = {viscosity}", K(value)


def _clean(K: Array) -> Array:
    """Return a conductivity with 0 for what is round-off."""
    share, least = ROUND_OFF
    return np.where(np.abs(K) > max(share * np.abs(K).max(), least), K, 0.0)


def _matrix(C: Array, units: ResultUnits) -> Iterator[str]:
    """Yield the drained stiffness in Voigt's notation."""
    unit = units.name("stress") if units.given else "E"
    yield f"drained stiffness C_eff [{unit}], axes 11, 22, 33, 23, 13, 12 (of strain 2e₂₃, 2e₁₃, 2e₁₂):"
    shown = np.where(np.abs(C) > ROUND_OFF[0] * np.abs(C).max(), C * units.factor("stress"), 0.0)
    texts = [[number(float(value)) for value in row] for row in shown]
    width = max(len(text) for row in texts for text in row)
    yield from ("  " + "  ".join(f"{text:>{width}}" for text in row) for row in texts)
