"""Outline of a run before its first solve: cells, samples, surrogate, body, work and its time; notes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.pore import require_one_cell, require_one_wall
from porocore.cell.quality import MeshQuality, measure_mesh_quality, quality_lines
from porocore.core.formulas import TimeFunction, Value
from porocore.core.units import ResultUnits, using_units
from porocore.errors import PluginError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.sampler import Sampler
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.boundary.drainage import undrained
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.composition.fields import covered_lines
from porocore.macro.composition.regions import region_numbers, sections
from porocore.macro.problem import Boundary
from porocore.plugins import registry
from porocore.report.text import whole_words
from porocore.study.config.config import RunConfig, lines_of_cell
from porocore.study.notes.abilities import (
    family_lines,
    late_functions,
    members_of,
    resolution,
    slow_states,
    uncovered,
    unmirrored,
)
from porocore.study.notes.at_rest import edges
from porocore.study.notes.checks import place
from porocore.study.notes.forecast import RunTimes, Workload, decisions, share_solved, sheared, work_lines
from porocore.study.notes.magnitudes import (
    WARNING,
    formulas,
    free_cuts,
    left_out,
    level_tables,
    long_step,
    out_of_plane,
    part_as_it_is,
    prescribed_times,
    separation,
    sideways,
    too_thin,
    unloaded,
)
from porocore.study.notes.memory import law_lines, memory_warnings
from porocore.study.run.composition import make_backend

#: Round shapes of indenters as a section has them.
IN_A_SECTION = {
    "sphere": "a cylinder of that radius",
    "cone": "a wedge of that angle",
    "punch": "a strip of twice that radius",
}
#: Points of a table that are shown.
MOST_POINTS = 4


def outline(config: RunConfig) -> Iterator[str]:
    """Yield the outline of a run, line by line; the cell is meshed for it.

    Raises
    ------
    ConfigurationError
        The cell cannot be meshed, has no pores, no stiffness or other regions, or its fluid cannot follow the solid.
    """
    yield config.title or "a study without a title"
    cells = {name: config.of_cell(name) for name in config.cell_names}
    measured = dict[str | None, MeshQuality]()
    for name, one in cells.items():
        with config.keys_of(name):
            measured[name] = measure_mesh_quality(one.cell)
            yield from _cell(one, name, measured[name])
            yield _samples(one, name)
    yield f"surrogate: {config.surrogate.backend}, model {config.surrogate_model}; closure {config.closure}"
    yield from _body(config)
    elements = len(place(config).cells)
    samplers: dict[str | None, Sampler] = {name: make_backend("sampler", one) for name, one in cells.items()}
    works = dict[str | None, Workload]()
    for name, one in cells.items():
        sampler, nodes = samplers[name], _nodes(one.cell, measured[name])
        works[name] = Workload.of(one, sampler.expected, elements, nodes, sum(members_of(one, sampler)))
        yield from lines_of_cell(name, family_lines(one, sampler))
    yield from work_lines(works)
    for name, one in cells.items():
        yield from lines_of_cell(name, decisions(one.macro, one.closure, samplers[name]))
    times = [RunTimes.of(one, works[name], samplers[name]) for name, one in cells.items()]
    yield RunTimes.together(times).line(max(1, works[None].workers))
    mesh = place(config)
    yield from dict.fromkeys(f"{WARNING}{text}" for one in cells.values() for text in too_thin(one, mesh))
    yield from dict.fromkeys(f"note: {text}" for one in cells.values() for text in separation(one, mesh))
    yield from (f"note: {text}" for text in out_of_plane(config, mesh))
    for name, one in cells.items():
        yield from lines_of_cell(
            name, (f"note: {note}" for note in _notes(one, _nodes(one.cell, measured[name])[0]))
        )
    yield from (f"note: {warning}" for warning in config.unit_notes)
    yield from (f"note: {warning}" for warning in late_functions(config.macro, config.result_units))
    yield from (f"note: {warning}" for warning in long_step(config.macro, config.result_units))
    parts = (*part_as_it_is(config.macro), *free_cuts(config.macro))
    tables = level_tables(config.macro, config.result_units)
    yield from (f"note: {text}" for text in (*sideways(config.macro), *parts, *tables))
    yield from (f"{WARNING}{text}" for text in unloaded(config.macro, config.all_cells))
    yield from (f"{WARNING}{text}" for text in memory_warnings(config, mesh))
    # K is not known yet, but along which axes it is positive in any of the cells.
    percolates = [any(axis not in quality.blocked for quality in measured.values()) for axis in "xyz"]
    yield from (f"note: {warning}" for warning in undrained(config.macro, np.diag(percolates).astype(float)))


def _cell(config: RunConfig, name: str | None, quality: MeshQuality) -> Iterator[str]:
    """Yield pores, meshes, solid and fluid of a cell, after a check of them."""
    yield from cell_outline(config, name, quality)
    config.cell.require_pores()
    config.cell.require_stiffness()


def cell_outline(config: RunConfig, name: str | None, quality: MeshQuality) -> Iterator[str]:
    """Yield pores, meshes, solid and fluid of a cell, which may have no pores or no stiffness.

    Raises
    ------
    ConfigurationError
        Its mesh has other regions, or its fluid cannot follow the solid.
    """
    cell, units = config.cell, config.result_units
    head = "cell" if name is None else f"cell {name}"
    yield from (f"{head}: {line}" if i == 0 else f"  {line}" for i, line in enumerate(quality_lines(quality)))
    yield from resolution(cell, config.cell_length)
    _require_that_the_fluid_follows(config.fem.backend, cell, config.conductivity)
    if cell.materials is not None:
        cell.solid.on(cell.make_mesh("solid", "whole"))
    yield from edges(cell, config.cell_length)
    with using_units(units):
        yield f"  {cell.solid.description}, viscosity {units.text(cell.viscosity, 'viscosity')}"
    yield f"  point group {cell.point_group.name} of pores and solid together"
    yield from _without_contact(config.fem.backend, cell)


def _samples(config: RunConfig, name: str | None) -> str:
    sampling, swept = config.sampling, config.input_space()
    with using_units(config.result_units):
        ranges = ", ".join(f"{each} in {swept.range_text(each, 4)}" for each in swept.names)
    count = f", {sampling.options['count']} states" if "count" in sampling.options else ""
    head = "samples" if name is None else f"samples of {name}"
    return f"{head}: {sampling.sampler}{count} over {ranges}; {sampling.test.count} held-out states"


def _nodes(cell: Cell, quality: MeshQuality) -> tuple[int, int]:
    """Return the numbers of nodes of the solid and of the fluid."""
    solid, fluid = (phase.nodes if phase else 0 for phase in (quality.solid, quality.fluid))
    return solid * math.prod(cell.supercell), fluid


def _notes(config: RunConfig, nodes: int) -> Iterator[str]:
    """Yield notes on the samples of a cell with so many nodes."""
    share, group = share_solved(config.cell, config.sampling.inputs), config.cell.point_group
    if slow := slow_states(nodes * share, config.cell.mesh.size, share):
        yield slow
    yield from uncovered(config.sampling.input_space(), group)
    yield from sheared(config.cell, config.sampling.inputs, nodes)
    yield from unmirrored(Symmetry.of(config.macro).normals, group)


def _require_that_the_fluid_follows(backend: str, cell: Cell, conductivity: str) -> None:
    """Refuse meshes of the core on which the conductivity of the deformed pore cannot be computed."""
    solver = _cell_solver(backend)
    if solver is not None and conductivity == "deformed" and solver.meshes == "core":
        require_one_cell(cell)
        require_one_wall(cell)


def _without_contact(backend: str, cell: Cell) -> Iterator[str]:
    """Yield a note if the cell solver cannot do what ``cell.contact`` asks for."""
    solver = _cell_solver(backend)
    if solver is not None and cell.contact.kind != "none" and not solver.contact:
        yield (
            f"note: the cell solver '{backend}' does not know contact of the pore wall with itself; a state "
            "whose wall passes through itself has no values"
        )


def _cell_solver(backend: str) -> type[CellSolver] | None:
    """Return the cell solver if it is installed; a stage that needs it reports why it is not."""
    try:
        return registry.get("cell solver", backend)
    except PluginError:
        return None


def unreached(config: RunConfig, mesh: BodyMesh, name: str, indenter: RigidIndenter) -> Iterator[str]:
    """Yield a warning of an indenter whose displacement never brings it to the undeformed body.

    One under a force is at the body from the beginning; if that is not its place, a note tells how far it goes.
    """
    macro, units = config.macro, config.result_units
    times = prescribed_times(macro)
    surfaces = [Facets(mesh, mesh.surface(each, "macro.contact")) for each in indenter.surfaces]
    nodes = np.unique(np.concatenate([each.nodes.ravel() for each in surfaces]))
    way, small = (
        indenter.way_to(mesh.points[nodes] - np.array(indenter.place)),
        1e-9 * np.ptp(mesh.points, axis=0).max(),
    )
    if indenter.displacement is None:
        if small < way < np.inf:
            yield (
                f"note: macro.contact.{name}.place lies {units.text(way, 'displacement', 3)} before the undeformed "
                "body; the indenter is under a force, rests on the body from t = 0 on, and its displacement begins "
                "with that way"
            )
        return
    for load in macro.loads:
        problem = macro.problem(load)
        size = 1.0 if isinstance(indenter.displacement, TimeFunction) else indenter.displacement
        motions = np.array([load * size * problem.factor(indenter.displacement, float(t)) for t in times])
        far = float(motions.max())
        if motions.min() < 0 and not far > 0:
            yield (
                f"warning: macro.contact.{name}.displacement moves the indenter against its direction under the load "
                f"{load:g}, away from the body; turn the sign round"
            )
        elif way == np.inf:
            yield (
                f"warning: macro.contact.{name}: the indenter goes past the undeformed body; move its place, or turn "
                "its direction"
            )
        elif way - far > small:
            yield (
                f"warning: macro.contact.{name}.displacement: the indenter does not reach the undeformed body under "
                f"the load {load:g}; at its largest displacement, {units.text(far, 'displacement', 3)}, "
                f"{units.text(way - far, 'displacement', 3)} are left along its direction. Move its place, or let it "
                "move further"
            )


def _body(config: RunConfig) -> Iterator[str]:
    macro, mesh = config.macro, place(config)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    units = config.result_units
    length = units.factor("displacement")
    extents = list(zip(low, high, strict=True))[: mesh.element.dimension]
    sizes = " × ".join(f"{(b - a) * length:.4g}" for a, b in extents)
    if mesh.revolved and not len(mesh.on_axis):
        inner, outer = (x * length for x in extents[0])
        sizes = f"radii {inner:.4g} to {outer:.4g}, height {(high[1] - low[1]) * length:.4g}"
    name_of_length = f" {units.name('displacement')}" if units.given else ""
    elements = f"{len(mesh.cells)} {mesh.element.shape} elements, {mesh.size} unknowns with those that are prescribed"
    volume = f"volume {mesh.weights.sum() * length**3:.5g}{name_of_length}{'³' * units.given}"
    yield f"body: {macro.body.kind}, {sizes}{name_of_length}, {volume}, {elements}"
    numbers = region_numbers(mesh, macro.regions)
    for k, (name, region) in enumerate(macro.regions.items(), start=1):
        cell = "" if region.cell is None else f": cell {region.cell}"
        yield f"  region {name}, {int((numbers == k).sum())} elements{cell}"
    with using_units(units):
        yield from (f"  {line}" for line in covered_lines(sections(macro), (low, high)))
    symmetry = Symmetry.of(macro)
    if symmetry.normals:
        planes = " and ".join(symmetry.normals)
        yield f"  forces and volumes are those of {whole_words(symmetry.copies)} (symmetry planes {planes})"
    for name, facets in mesh.surfaces.items():
        said = _said(macro.boundary.get(name), units)
        count = f"{len(facets)} {'facet' if len(facets) == 1 else 'facets'}"
        area = f"area {Facets(mesh, facets).areas.sum() * length**2:.5g}{name_of_length}{'²' * units.given}"
        patch = macro.surfaces.get(name)
        if patch is not None and patch.radius is not None:
            disc = np.pi * (patch.radius * length) ** 2
            area += f" (facets with their middle in it; the whole disc has {disc:.5g})"
        yield f"  surface {name}, {count}, {area}: {said or 'free of traction and impermeable'}"
    if mesh.unnamed:
        yield f"  {mesh.unnamed} facets without a name: free of traction and impermeable"
    for name, indenter in macro.contact.items():
        quantity = "displacement" if indenter.force is None else "force"
        drained = [
            f"{'under it' if where == 'under' else 'outside it'} {state}"
            for where, state in (("under", indenter.under), ("outside", indenter.outside))
            if state is not None
        ]
        said = ", ".join([f"{quantity} = {_value(indenter.motion, quantity, units)}", *drained])
        yield f"  indenter {name}, a {indenter.shape.kind}, on {' and '.join(indenter.surfaces)}: {said}"
        if mesh.is_section and indenter.shape.of_revolution:
            yield (
                f"note: macro.contact.{name}.shape: in a section the {indenter.shape.kind} is "
                f"{IN_A_SECTION[indenter.shape.kind]}, infinitely long along z"
            )
        yield from unreached(config, mesh, name, indenter)
    yield from (f"  {line}" for line in law_lines(config, mesh))
    for name, at in macro.probes.items():
        yield f"  probe {name} at {', '.join(f'{x * length:.4g}' for x in at)}{name_of_length}"
    loads = ", ".join(f"{load:g}" for load in macro.loads)
    steps = "steps chosen by their error, at most" if macro.time.tolerance else "in steps of"
    yield (
        f"solutions: loads {loads}, each with the cell's law and linearly, "
        f"up to t = {units.text(macro.time.end, 'time')}, {steps} {units.text(macro.time.step, 'time')}"
    )
    yield from (f"  {line}" for line in (*left_out(macro, units), *formulas(macro, units)))


def _said(boundary: Boundary | None, units: ResultUnits) -> str:
    """Return the prescribed values of a surface as text."""
    if boundary is None:
        return ""
    found = [
        f"u_{i + 1} = {_value(u, 'displacement', units)}"
        for i, u in enumerate(boundary.displacement)
        if u is not None
    ]
    found += [f"t_{i + 1} = {_value(t, 'stress', units)}" for i, t in enumerate(boundary.traction) if t != 0]
    for name, quantity, value in (
        ("normal displacement", "displacement", boundary.normal),
        ("pressure on the deformed surface", "pressure", boundary.follower or None),
        ("force on a plate", "force", boundary.plate),
        ("p", "pressure", boundary.pressure),
        ("outward flux", "velocity", boundary.flux or None),
    ):
        if value is not None:
            found.append(f"{name} = {_value(value, quantity, units)}")
    return ", ".join(found)


def _value(value: Value, quantity: str, units: ResultUnits) -> str:
    """Return a prescribed value, or its function of time, in the units of the configuration."""
    at = units.text
    if not isinstance(value, TimeFunction):
        return at(value, quantity)
    if value.ramp is not None and value.until is not None:
        return f"0 to {at(value.ramp, quantity)} until t = {at(value.until, 'time')}"
    if value.expression is not None:
        return f"{value.expression} with dimensionless t" if units.given else value.expression
    points = [f"{at(number, quantity)} at t = {at(time, 'time')}" for time, number in value.table]
    if len(points) > MOST_POINTS:
        points[MOST_POINTS - 1 : -1] = ["…"]
    return f"({'; '.join(points)})"
