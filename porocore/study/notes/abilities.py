"""Notes on what a study asks of plugins and machine: parts, memory, symmetry, functions of time, voxels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import numpy as np
import psutil

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import undeformed_count
from porocore.cell.level_sets.cutting import lattice_edges
from porocore.cell.level_sets.voxels import Voxels, least_thickness
from porocore.cell.quality import (
    FEWEST,
    Advice,
    at_most,
    can_be_meshed,
    count_text,
    disagreements,
    too_fine,
    voxel_edges,
)
from porocore.core.echo import echo, joined
from porocore.core.files.yaml_document import dotted
from porocore.core.formulas import Expression, TimeFunction, first_fault
from porocore.core.inputs import InputSpace
from porocore.core.models.bounds import LARGEST_PRESSURE, MOST_STATES
from porocore.core.models.strict import walk
from porocore.core.tensors import PointGroup
from porocore.core.units import ResultUnits, Scales, length_text, units_now
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.charges import require_charges
from porocore.macro.composition.regions import (
    CellRanges,
    region_numbers,
    regions_of_cell,
    require_composition,
    sections,
)
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroSetup
from porocore.states import Array, CellResponse
from porocore.study.config.config import RunConfig, SamplingSettings
from porocore.study.notes.cost import LIBRARIES, costs
from porocore.study.notes.forecast import as_time, expected_cost
from porocore.surrogates.potential import STILL, variables
from porocore.surrogates.stretch import PLACES, LogStretch
from porocore.surrogates.symmetry import acting_across, on_places


def offers_conductivity(solver: type[CellSolver], which: str) -> bool:
    """Return True if a cell solver computes what the law ``which`` of the conductivity needs."""
    return ("deformed" if which == "deformed" else "piola") in solver.conductivities


def require_conductivity(solver: type[CellSolver], name: str, which: str) -> None:
    """Refuse a cell solver that does not compute a conductivity.

    Parameters
    ----------
    solver, name
        Class and name of the solver.
    which
        Law of the conductivity, as the configuration has it; all but ``deformed`` rest on K of the undeformed cell.

    Raises
    ------
    ConfigurationError
        The conductivity is not among :attr:`~porocore.CellSolver.conductivities`.
    """
    if offers_conductivity(solver, which):
        return
    if not solver.conductivities:
        raise ConfigurationError(
            f"fem.backend: the cell solver '{name}' computes no conductivity, without which no body can be solved; "
            "choose another fem.backend"
        )
    raise ConfigurationError(
        f"conductivity: the cell solver '{name}' does not compute that of the deformed pore; choose "
        f"conductivity: {solver.conductivities[0]} or another fem.backend"
    )


def lacking(solver: type[MacroSolver], problem: MacroSetup) -> str:
    """Return in words what a problem needs and a macro solver does not offer; empty if it offers all."""
    kinds = solver.bodies
    column = kinds is not None and "column" in kinds and problem.is_column
    if kinds is not None and problem.body.kind not in kinds and not column:
        other = "a box that is no confined column" if "column" in kinds and problem.body.kind == "box" else ""
        return f"{other or f'the body {problem.body.kind!r}'} (bodies = {', '.join(kinds)})"
    missing = sorted(problem.parts - solver.parts)
    return f"{' and '.join(missing)} (parts = {', '.join(sorted(solver.parts)) or 'none'})" if missing else ""


def require_parts(solver: type[MacroSolver], name: str, problem: MacroSetup) -> None:
    """Refuse a macro solver that does not offer what a problem needs.

    Raises
    ------
    ConfigurationError
        The solver does not declare the body's kind, or a part of the problem.
    """
    missing = lacking(solver, problem)
    if missing:
        raise ConfigurationError(
            f"macro: this problem needs {missing.partition(' (')[0]}, which the macro solver '{name}' does not offer; "
            "choose another macro.backend, or leave it out"
        )


def require_parameters_sampled(sampler: type[Sampler], name: str, cell: Cell) -> None:
    """Refuse a sampler that draws no parameters for a cell that has some.

    Raises
    ------
    ConfigurationError
        A number of the cell is a range, and the sampler draws no parameters.
    """
    if cell.is_family and not sampler.samples_parameters:
        raise ConfigurationError(
            f"sampling.sampler: '{name}' does not sample cells with parameters, but {cell.parameters[0].key} is a "
            "range; choose another, such as sobol, or give one number"
        )


def require_learner(surrogate: Surrogate, name: str, cell: Cell) -> None:
    """Refuse a surrogate that cannot learn a cell with parameters.

    Parameters
    ----------
    surrogate, name
        The surrogate, and its name.
    cell
        The cell.

    Raises
    ------
    ConfigurationError
        A number of the cell is a range, and the surrogate learns no parameters.
    """
    if surrogate.learns_parameters or not cell.is_family:
        return
    key, model = cell.parameters[0].key, surrogate.model
    if len(type(surrogate).models) > 1:
        raise ConfigurationError(
            f"surrogate.model: {model} of '{name}' learns no cells with parameters, but {key} is a range; set "
            "surrogate.model: potential, or give one number"
        )
    raise ConfigurationError(
        f"surrogate.backend: '{name}' learns no cells with parameters, but {key} is a range; choose one that does, "
        "such as --surrogate polynomial, or give one number"
    )


def require_cells(problem: MacroSetup, mesh: BodyMesh) -> None:
    """Refuse a body of several cells of which no part has the cell of the rest.

    Raises
    ------
    ConfigurationError
        Every element lies in a region with another cell; or regions are empty or overlap.
    """
    rest = regions_of_cell(problem.regions, None)
    if not np.isin(region_numbers(mesh, problem.regions), rest).any():
        raise ConfigurationError(
            "cell: no part of the body has it, since every element lies in a region with another cell; give one of "
            "'cells:' here, at the top level, and leave 'cell:' of its regions out"
        )


def require_fields(cells: CellRanges, problem: MacroSetup, mesh: BodyMesh) -> None:
    """Refuse regions and fields that do not suit the mesh or the parameters of the cells.

    Raises
    ------
    ConfigurationError
        A field is of no parameter, leaves its range or has no value; a parameter has no field; regions are empty or
        overlap; a file does not cover the body; charges are negative, or their bath is without salt.
    """
    require_composition(problem, mesh, cells, problem.time.end)
    if problem.charges is not None:
        require_charges(problem.charges, mesh, run_times(problem))


def members_of(config: RunConfig, sampler: Sampler) -> tuple[int, int]:
    """Return how many members of a family of cells are prepared for the sampler's states and for the held-out ones."""
    if not config.cell.is_family:
        return 0, 0
    test, used = config.sampling.test, len(config.used_parameters)
    held_out = math.ceil(test.count / test.together)
    return min(sampler.members, used or sampler.expected), min(held_out, used or held_out)


def family_lines(config: RunConfig, sampler: Sampler) -> Iterator[str]:
    """Yield the counts of members of a family of cells; nothing of a cell without parameters."""
    if not config.cell.is_family:
        return
    sampled, held_out = members_of(config, sampler)
    used = _used(np.array(config.used_parameters), config.cell)
    ranges = (f"{each.name} in [{each.lower:g}, {each.upper:g}]" for each in config.cell.parameters)
    yield (
        f"  family of cells over {', '.join(ranges)}: {undeformed_count(config.cell)} undeformed "
        f"members; states of {_members(sampled)}, held-out states of {_members(held_out)}{used}"
    )


def _used(rows: Array, cell: Cell) -> str:
    """Return where the body is among the parameters, after a comma; empty where the whole ranges are sampled."""
    if not len(rows):
        return ""
    ends = [
        f"{low:g}" if low == high else f"{low:g} to {high:g}"
        for low, high in zip(rows.min(0), rows.max(0), strict=True)
    ]
    names = (each.name for each in cell.parameters)
    there = ", ".join(f"{name} {at}" for name, at in zip(names, ends, strict=True))
    return f", where the body is: {there} (sampling.parameters: body)"


def _members(count: int) -> str:
    return f"{count} {'member' if count == 1 else 'members'}"


#: A state that takes longer on one core is noted [s].
LONG = 60.0


def require_memory(cell: Cell, sampling: SamplingSettings) -> None:
    """Refuse processes that this machine has too little memory for.

    Raises
    ------
    ConfigurationError
        The mesh of the cell is too fine, or the processes are too many.
    """
    workers, there = sampling.workers_here, memory_here()
    expected = expected_cost(cell, sampling.inputs)
    if workers == 0:
        return
    (nodes, flow), mesh, process = expected.nodes, cell.mesh, expected.memory
    spare = max(there - LIBRARIES, LIBRARIES)
    for key, count, phase, needs, bytes_of in (
        ("size", nodes, "solid", process, costs(expected.parts[0]).solid),
        ("fluid_size", flow, "fluid", expected.memory_of_flow, costs(expected.parts[1]).fluid),
    ):
        if needs > there:
            larger = getattr(mesh, key) * (count / bytes_of.nodes_for(spare)) ** (1 / 3)
            raise ConfigurationError(
                f"cell.mesh.{key}: at {getattr(mesh, key):g} the {phase} has about {count:,.0f} nodes, and solving it "
                f"needs some {needs / 1e9:.3g} GB of memory, but this machine has {there / 1e9:.3g} GB; take "
                f"{_at_least(larger)} or more, or a part of the cell"
            )
    if workers > 1 and (workers + 1) * process > there:
        raise ConfigurationError(
            f"sampling.workers: {workers} workers and the run itself need some {(workers + 1) * process / 1e9:.3g} GB "
            f"of memory, {process / 1e9:.3g} GB each for the {nodes:,.0f} nodes of cell.mesh.size = {mesh.size:g}, "
            f"but this machine has {there / 1e9:.3g} GB; give larger elements, or take at "
            f"most {max(1, int(there / process) - 1)}"
        )


def slow_states(nodes: float, size: float, share: float = 1.0) -> str:
    """Return a note on a solid of which a state takes long; empty for a smaller one. Nodes are those of a share."""
    law = costs(share).state
    seconds = law.at(nodes)
    if seconds <= LONG:
        return ""
    larger = size * (nodes / law.nodes_for(LONG)) ** (1 / 3)
    beyond = ", which is beyond what was measured" if nodes > 1.2 * law.nodes[-1] else ""
    return (
        f"a state of {nodes:,.0f} nodes of the solid takes about {as_time(seconds)} on one core{beyond}; "
        f"cell.mesh.size: {_at_least(larger)} takes {as_time(LONG)}"
    )


def _at_least(size: float) -> str:
    """Return a size in two digits, rounded up."""
    digits = 1 - math.floor(math.log10(size))
    return f"{math.ceil(round(size * 10**digits, 6)) / 10**digits:g}"


def require_states(sampler: str, expected: int) -> None:
    """Refuse a sampler that expects to ask for more states than can be solved.

    Raises
    ------
    ConfigurationError
        The states are too many.
    """
    if not expected <= MOST_STATES:
        raise ConfigurationError(
            f"sampling: sampler '{sampler}' would ask for {float(expected):.3g} states; at most "
            f"{MOST_STATES} are solved: take fewer or larger steps"
        )


def memory_here() -> float:
    """Return the memory of this machine [bytes]."""
    return float(psutil.virtual_memory().total)


def unit_of_the_modulus(scales: Scales | None, name: str) -> str:
    """Return which key may be to blame for a pressure that is too large for the cell."""
    if name != "p" or scales is None or scales.modulus is None:
        return ""
    return (
        f": that is {LARGEST_PRESSURE:g} times the modulus; is scales.modulus = {scales.modulus:g} Pa meant?"
    )


#: Largest asymmetry of the stiffness at rest without a warning.
LARGEST_DEFECT = 0.02
#: Entries of a mirror closer than this to a whole number are one.
SAME = 1e-6
#: States in the box of the inputs that show which variables they move.
STATES = 16


def uncovered_shears(inputs: InputSpace, group: PointGroup) -> list[str]:
    """Return shears, such as ``H12``, that are no inputs but on which a cell with this group bears under the inputs.

    Their stress is learned; the stiffness against them is that at rest. A body that gives way leaves what was sampled.
    """
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(0).random((STATES, len(inputs))))
    y = variables(LogStretch.from_gradient(states.grad_u), states.p)
    moved = np.abs(np.nan_to_num(y)).max(axis=1) > STILL
    active = tuple(int(a) for a in np.flatnonzero(moved))
    found = [PLACES[a] for a in acting_across(group, active) if 3 <= a < 6]
    return sorted(f"H{i + 1}{j + 1}" for i, j in found)


def uncovered(inputs: InputSpace, group: PointGroup) -> list[str]:
    """Return a warning of :func:`uncovered_shears`, none without such shears."""
    shears = uncovered_shears(inputs, group)
    if not shears:
        return []
    names = " and ".join(shears)
    are = "is no input" if len(shears) == 1 else "are no inputs"
    return [
        f"in a cell of the point group {group.name} {', '.join(inputs.names)} may cause stresses along {names}, which "
        f"{are}. The surrogate learns these stresses, but it knows the stiffness against {names} only at rest. Where "
        f"the body shears by {names}, states are flagged, and Newton's iteration may fail. Add {names} to "
        f"sampling.inputs, unless the body is held against such shear. Add "
        f"{_transposed(shears)} instead where a boundary moves the body so; the cell is stretched the same"
    ]


def _transposed(shears: list[str]) -> str:
    """Return H21 for H12, and so on; the stretch of a cell is the same."""
    return " and ".join(f"H{name[2]}{name[1]}" for name in shears)


def unmirrored(planes: Mapping[str, Array], group: PointGroup) -> list[str]:
    """Return a note of symmetry planes of the body at which a cell of this group is not mirrored to itself.

    Parameters
    ----------
    planes
        Normals (3,) by name.
    group
        Point group of the cell.
    """
    mirrors = {name: np.eye(3) - 2 * np.outer(normal, normal) for name, normal in planes.items()}
    names = [
        f"'{name}'"
        for name, Q in mirrors.items()
        if np.abs(Q - np.rint(Q)).max() > SAME or np.rint(Q).astype(int) not in group
    ]
    if not names:
        return []
    return [
        f"the cell, of the point group {group.name}, is not its own mirror image at {' and '.join(names)}: behind "
        "such a plane the whole body is made of mirrored cells. If it is not, solve the whole body, without such "
        "planes; a small patch (macro.surfaces) holds it sideways where only smooth plates do, see docs/bodies.md"
    ]


def defect(stiffness: Array, group: PointGroup) -> float:
    """Return the asymmetry of ∂P_E/∂H (3, 3, 3, 3) under a group, as a share of its largest entry."""
    action, matrix = on_places(group), stiffness.reshape(9, 9)
    return float(np.abs(matrix - action.mean(action, matrix)).max() / np.abs(matrix).max())


def broken_by_the_mesh(reference: CellResponse, group: PointGroup) -> list[str]:
    """Return a warning of a free mesh that breaks the symmetry of its cell at rest, none within the tolerance.

    Parameters
    ----------
    reference
        Response of the undeformed cell with its tangent, one row.
    group
        Point group of the cell.
    """
    tangent = reference.tangent
    if tangent is None or tangent.stress_grad_u is None:
        return []
    share = defect(np.asarray(tangent.stress_grad_u[0]), group)
    if not share > LARGEST_DEFECT:
        return []
    return [
        f"the mesh of the cell breaks its symmetry, {group.name}: the stiffness at rest differs by {share:.1%} of its "
        "largest entry where it should not; the error of the mesh is at least as large, see cell.mesh.size"
    ]


#: Times between 0 and the end at which a function is evaluated, beside those of the steps.
DENSE = 20_000


def check_time_functions(setup: MacroSetup) -> None:
    """Refuse a function of time that has no value somewhere between 0 and the end.

    Raises
    ------
    ConfigurationError
        A function divides by zero, takes the root of a negative number or becomes too large; names key and time.
    """
    expressions = [
        (place.path, place.value.expression)
        for place in walk(MacroSetup, setup)
        if isinstance(place.value, TimeFunction) and place.value.expression is not None
    ]
    times = run_times(setup) if expressions else np.zeros(0)
    for path, text in expressions:
        fault = first_fault(Expression.parse(text, ("t",)), times)
        if fault is not None:
            index, why = fault
            said = partial(units_now().text, quantity="time", digits=6)
            key = dotted(("macro", *path, "expression"))
            raise ConfigurationError(
                f"{key}: {echo(text)} {why} near t = {said(times[index])}, within the run from t = 0 to "
                f"{said(setup.time.end)}; t and the result of an expression are dimensionless"
            )


def run_times(setup: MacroSetup) -> Array:
    """Return the planned times of a run and a dense set between, (n,) in ascending order."""
    stepper = Stepper(setup.time, setup.corners)
    times = [0.0]
    while setup.time.tolerance is None and not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    found: Array = np.unique(np.concatenate([times, np.linspace(0, setup.time.end, DENSE + 1)]))
    return found


def late_functions(setup: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield notes of functions of time that go on after the end of the run, as a missing unit may cause."""
    end = setup.time.end
    courses = {
        f"on the surface {name}": [corner for course in boundary.time_functions for corner in course.corners]
        for name, boundary in setup.boundary.items()
    }
    courses |= {
        f"of {prefix}.{name}": list(entry.corners)
        for prefix, entries in sections(setup)
        for name, entry in entries.items()
        if not isinstance(entry, float | str)
    }
    courses |= {
        f"of macro.contact.{name}": list(course.corners)
        for name, indenter in setup.contact.items()
        for course in (indenter.displacement, indenter.force)
        if isinstance(course, TimeFunction)
    }
    if setup.charges is not None:
        courses["of macro.charges"] = list(setup.charges.corners)
    for where, corners in courses.items():
        last = max(corners, default=0.0)
        if last > end:
            last_time, end_time = (units.text(t, "time") for t in (last, end))
            yield (
                f"the function of time {where} goes on until t = {last_time}, beyond the "
                f"end, {end_time}, and is cut there; check macro.time.end and the unit of the time"
            )


#: Difference of the real from the given size of the elements from which both are named, as a share.
SAME_SIZE = 1e-3
#: Voxels across a wall or a pore that the smoothed image still has.
SEEN = 2.0


def resolution(cell: Cell, length: float | None = None) -> Iterator[str]:
    """Yield the size of the elements in voxels, how many lie across the thinnest parts of an image, and notes.

    The notes are on parts with too few elements, and on what the meshes have otherwise than the image. Nothing is known
    of cells that are no images. ``length`` is that of the cell in metres, if it is known.
    """
    geometry = cell.geometry
    if not isinstance(geometry, Voxels):
        return
    solid = geometry.solid
    whole = geometry.unfolding == "whole"
    voxel = voxel_edges(geometry)
    for key, size in (("size", cell.mesh.size), ("fluid_size", cell.mesh.fluid_size)):
        yield f"  mesh.{key} {size:g} {_edge_text(geometry, size, length)}"
    notes = list[Advice]()
    for name, phase, key, size in (
        ("thinnest wall", solid, "size", cell.mesh.size),
        ("narrowest pore", ~solid, "fluid_size", cell.mesh.fluid_size),
    ):
        thickness = least_thickness(phase, voxel, periodic=whole)
        if not np.isfinite(thickness):
            continue
        elements, voxels = thickness / lattice_edges(geometry, size)[0], thickness / voxel.min()
        yield (
            f"  {name}, by the largest ball in it: some {_voxels(geometry, thickness)} or {thickness:.2g} of the cell, "
            f"{count_text(elements)} of mesh.{key}"
        )
        if elements < FEWEST and voxels >= SEEN:
            needed = at_most(thickness / FEWEST)
            advice = Advice(f"cell.mesh.{key}: {needed:g} has {FEWEST:g} there", {key: needed})
            advice = advice if can_be_meshed(geometry, needed) else Advice(too_fine(needed))
            notes.append(advice.of(f"{count_text(elements)} across the {name} resolve it poorly; "))
    notes += disagreements(cell, tried=True)
    yield from (f"note: {note.text}" for note in notes)
    yield from _together(notes)


def _together(notes: Iterable[Advice]) -> Iterator[str]:
    """Yield the sizes that serve all notes, where they advise several of one key."""
    advised: dict[str, set[float]] = {}
    for note in notes:
        for key, size in note.sizes.items():
            advised.setdefault(key, set()).add(size)
    several = [f"cell.mesh.{key}: {min(sizes):g}" for key, sizes in advised.items() if len(sizes) > 1]
    if several:
        yield f"note: of these sizes the smallest serves all that is said above: {joined(several)}"


def _voxels(geometry: Voxels, length: float) -> str:
    """Return a length of the cell in voxels; where they are no cubes, in the shortest of their edges."""
    voxel = voxel_edges(geometry)
    count = f"{length / voxel.min():.2g} voxels"
    return count if np.ptp(voxel) <= SAME_SIZE * voxel.min() else f"{count} along {'xyz'[voxel.argmin()]}"


def _edge_text(geometry: Voxels, size: float, length: float | None) -> str:
    """Return the real edge of the elements of a size, and between which sizes the mesh is the same."""
    edge, coarser = lattice_edges(geometry, size)
    voxels = _voxels(geometry, edge)
    if length is not None:
        voxels += f", {length_text(edge * length)}"
    if abs(edge - size) < SAME_SIZE * size:
        return f"is {voxels}"
    # Rounded into the range.
    low, high = np.ceil(edge * 1e4) / 1e4, np.floor(coarser * (1 - 1e-9) * 1e4) / 1e4
    same = f"from {low:g} to {high:g}" if np.isfinite(coarser) else f"from {low:g} on"
    return (
        f"becomes {edge:.3g}, so that whole elements fill the cell: {voxels}; any size {same} gives this mesh"
    )
