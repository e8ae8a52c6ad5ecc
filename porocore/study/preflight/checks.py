"""Checks before the first solve: backends, sampled box, workers, body; outline of the run."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

import numpy as np

from porocore.cell.conductivity.pore import require_one_cell, require_one_wall
from porocore.cell.meshing.mesh_quality import measure_mesh_quality, quality_lines
from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.core.inputs.input_space import value_text
from porocore.core.inputs.possible_states import least_volume
from porocore.core.models.bounds import LARGEST_GRADIENT, LARGEST_PRESSURE
from porocore.core.units.results import ResultUnits, speaking
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.surrogate import MORE_STATES, least_states
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.boundary.drainage import undrained
from porocore.macro.boundary.probes import interpolation
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.problem import Boundary, MacroProblem, body_mesh
from porocore.plugins import registry
from porocore.plugins.kinds import KINDS, Kind
from porocore.report.text import whole_words
from porocore.sampling.execution.address import check_reachable
from porocore.study import backends
from porocore.study.config.config import RunConfig
from porocore.study.magnitudes.left_out import left_out
from porocore.study.magnitudes.prescribed import require_right_side_out
from porocore.study.magnitudes.separation import separation
from porocore.study.preflight.abilities import require_fields, require_without_swelling
from porocore.study.preflight.at_rest import cell_length, edges
from porocore.study.preflight.guess import RunTimes, decisions
from porocore.study.preflight.limits import require_memory, slow_states, unit_of_the_modulus
from porocore.study.preflight.resolution import resolution
from porocore.study.preflight.symmetry_notes import uncovered, unmirrored
from porocore.study.preflight.time_functions import check_time_functions, late_functions
from porocore.study.preflight.workload import Workload, family_lines, members_of, share_solved, sheared

#: Points of a table that are shown.
MOST_POINTS = 4


def check_backends(config: RunConfig, needed: Collection[Kind] | None = None) -> None:
    """Refuse a study with faults that show before the first solve; ``check`` and ``run`` both call this.

    Finds the backends and tries their options, checks the sampled box, the scheduler and the workers, evaluates
    functions of time, and meshes the body with boundary conditions and probes.

    Parameters
    ----------
    config
        The study.
    needed
        Kinds of backends that must be installed; those of later stages may be elsewhere. None: all.

    Raises
    ------
    PluginError
        A needed backend is unknown, missing or broken.
    ConfigurationError
        Options are unusable, the box reaches det F ≤ 0, states are too few or too many, nobody listens at the
        scheduler's address, a function of time has no value somewhere, there is no such surface, boundary conditions
        contradict each other, do not hold the body or turn it inside out, or a probe lies outside; its solid swells.
    """
    with speaking(config.result_units):
        _check(config, KINDS if needed is None else needed)


def _check(config: RunConfig, needed: Collection[Kind]) -> None:
    require_without_swelling(config.cell)
    find_backends(config, needed)
    check_sampling(config, trained="surrogate" in needed)
    check_time_functions(config.macro)
    require_right_side_out(config.macro, place(config), config.result_units)
    for kind in KINDS:
        try:
            backends.check(kind, config)
        except PluginError:
            if kind in needed:
                raise


def find_backends(config: RunConfig, needed: Collection[Kind]) -> None:
    """Find the backends; one error names all that are missing, each name once.

    Raises
    ------
    PluginError
        Some are unknown, missing or broken; one line for each.
    """
    faults: dict[str, str] = {}
    for kind in needed:
        name = backends.backend_name(kind, config)
        try:
            registry.registry().find(kind, name)
        except PluginError as error:
            faults.setdefault(name, str(error))
    if faults:
        raise PluginError("\n".join(faults.values()))


def check_sampling(config: RunConfig, *, trained: bool) -> None:
    """Check the sampled box, the workers, and the number of states if a surrogate learns from them.

    Raises
    ------
    ConfigurationError
        See :func:`check_backends`.
    """
    sampling = config.sampling
    inputs = sampling.input_space()
    for name, swept in sampling.inputs.items():
        largest = LARGEST_PRESSURE * config.cell.modulus if name == "p" else LARGEST_GRADIENT
        if max(map(abs, swept.range)) > largest:
            raise ConfigurationError(
                f"sampling.inputs.{name}.range: expected at most {value_text(name, largest)}, got "
                f"{inputs.range_text(name)}; no cell bears more{unit_of_the_modulus(config, name)}"
            )
    J, corner = least_volume(inputs)
    if J <= 0:
        at = ", ".join(f"{name} = {value:g}" for name, value in corner.items())
        raise ConfigurationError(
            f"sampling.inputs: the ranges reach det F = {J:.4g} at {at}, but a solid has det F > 0 with F = I + H; "
            "narrow them"
        )
    given, least = sampling.options.get("count"), least_states(len(inputs))
    if trained and type(given) is int and 0 < given < least:
        raise ConfigurationError(
            f"sampling.options.count: {given} states are too few to train on, at least {least} are needed: "
            f"{MORE_STATES}"
        )
    require_memory(config)
    if sampling.scheduler is not None:
        check_reachable(sampling.scheduler)


def place(config: RunConfig) -> BodyMesh:
    """Return the mesh of the body after a check of its boundary conditions, probes, regions and fields.

    Raises
    ------
    ConfigurationError
        See :func:`check_backends`.
    """
    problem: MacroProblem = config.macro.problem(config.macro.loads[0])
    mesh = body_mesh(problem)
    boundary_data(mesh, problem)
    interpolation(mesh, problem.probes)
    Symmetry.of(problem)
    return require_fields(config.cell, problem, mesh)


def outline(config: RunConfig) -> Iterator[str]:
    """Yield the outline of a run, line by line; the cell is meshed for it.

    Raises
    ------
    ConfigurationError
        The cell cannot be meshed, has no pores, no stiffness or other regions, or its fluid cannot follow the solid.
    """
    yield config.title or "a study without a title"
    quality = measure_mesh_quality(config.cell)
    yield from (f"cell: {line}" if i == 0 else f"  {line}" for i, line in enumerate(quality_lines(quality)))
    yield from resolution(config.cell, cell_length(config))
    config.cell.require_pores()
    config.cell.require_stiffness()
    _require_that_the_fluid_follows(config)
    if config.cell.materials is not None:
        config.cell.solid.on(config.cell.make_mesh("solid", "whole"))
    yield from edges(config)
    units = config.result_units
    with speaking(units):
        yield f"  {config.cell.solid.description}, viscosity {units.text(config.cell.viscosity, 'viscosity')}"
        swept = config.input_space()
        ranges = ", ".join(f"{name} in {swept.range_text(name, 4)}" for name in swept.names)
    yield f"  point group {config.cell.point_group.name} of pores and solid together"
    yield from _without_contact(config)
    sampling = config.sampling
    count = f", {sampling.options['count']} states" if "count" in sampling.options else ""
    yield f"samples: {sampling.sampler}{count} over {ranges}; {sampling.test.count} held-out states"
    yield f"surrogate: {config.surrogate.backend}, model {config.surrogate_model}; closure {config.closure}"
    yield from _body(config)
    sampler = backends.make_backend("sampler", config)
    nodes, fluid = (phase.nodes if phase else 0 for phase in (quality.solid, quality.fluid))
    nodes *= math.prod(config.cell.supercell)
    yield from family_lines(config, sampler)
    elements, members = len(place(config).cells), sum(members_of(config, sampler))
    work = Workload.of(config, sampler.expected, elements, (nodes, fluid), members)
    yield from work.as_lines()
    yield from decisions(config, sampler)
    yield RunTimes.of(config, work, sampler).line(max(1, work.workers))
    share = share_solved(config)
    if slow := slow_states(nodes * share, config.cell.mesh.size, share):
        yield f"note: {slow}"
    yield from (f"note: {warning}" for warning in separation(config, place(config)))
    yield from (f"note: {warning}" for warning in uncovered(sampling.input_space(), config.cell.point_group))
    yield from (f"note: {warning}" for warning in sheared(config, nodes))
    planes = Symmetry.of(config.macro).normals
    yield from (f"note: {warning}" for warning in unmirrored(planes, config.cell.point_group))
    yield from (f"note: {warning}" for warning in late_functions(config.macro, units))
    # K is not known yet, but along which axes it is positive.
    percolates = np.diag([float(axis not in quality.blocked) for axis in "xyz"])
    yield from (f"note: {warning}" for warning in undrained(config.macro, percolates))


def _require_that_the_fluid_follows(config: RunConfig) -> None:
    """Refuse meshes of the core on which the conductivity of the deformed pore cannot be computed."""
    solver = _cell_solver(config)
    if solver is not None and config.conductivity == "deformed" and solver.meshes == "core":
        require_one_cell(config.cell)
        require_one_wall(config.cell)


def _without_contact(config: RunConfig) -> Iterator[str]:
    """Yield a note if the cell solver cannot do what ``cell.contact`` asks for."""
    solver = _cell_solver(config)
    if solver is not None and config.cell.contact.kind != "none" and not solver.contact:
        yield (
            f"note: the cell solver '{config.fem.backend}' does not know contact of the pore wall with itself; a state "
            "whose wall passes through itself has no values"
        )


def _cell_solver(config: RunConfig) -> type[CellSolver] | None:
    """Return the cell solver if it is installed; a stage that needs it reports why it is not."""
    try:
        return registry.get("cell solver", config.fem.backend)
    except PluginError:
        return None


def _body(config: RunConfig) -> Iterator[str]:
    macro, mesh = config.macro, place(config)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    units = config.result_units
    length = units.factor("displacement")
    sizes = " × ".join(f"{(b - a) * length:.4g}" for a, b in zip(low, high, strict=True))
    name_of_length = f" {units.name('displacement')}" if units.given else ""
    elements = f"{len(mesh.cells)} {mesh.element.shape} elements, {mesh.size} unknowns with those that are prescribed"
    yield f"body: {macro.body.kind}, {sizes}{name_of_length}, {elements}"
    symmetry = Symmetry.of(macro)
    if symmetry.normals:
        planes = " and ".join(symmetry.normals)
        yield f"  forces and volumes are those of {whole_words(symmetry.copies)} (symmetry planes {planes})"
    for name, facets in mesh.surfaces.items():
        said = _said(macro.boundary.get(name), units)
        count = f"{len(facets)} {'facet' if len(facets) == 1 else 'facets'}"
        yield f"  surface {name}, {count}: {said or 'free of traction and impermeable'}"
    for name, at in macro.probes.items():
        yield f"  probe {name} at {', '.join(f'{x * length:.4g}' for x in at)}{name_of_length}"
    loads = ", ".join(f"{load:g}" for load in macro.loads)
    steps = "steps chosen by their error, at most" if macro.time.tolerance else "in steps of"
    yield (
        f"solutions: loads {loads}, each with the cell's law and linearly, "
        f"up to t = {units.text(macro.time.end, 'time')}, {steps} {units.text(macro.time.step, 'time')}"
    )
    yield from (f"  {line}" for line in left_out(macro, units))


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
