"""Linear solutions of a body before its cells are solved; notes on the ranges that it leaves or hardly uses.

What is prescribed is reached in any case, see :mod:`porocore.study.notes.magnitudes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from porocore.core.inputs import NAMES, InputSpace, components
from porocore.core.units import ResultUnits, length_text
from porocore.errors import SolveError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.integration.stepping import SAME, Stepper
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import MacroSetup, TimePlan, body_mesh
from porocore.plugins.border import body_solution_of
from porocore.report.format import percent
from porocore.report.words.results import LEAST_FLAGGED
from porocore.states import MacroState
from porocore.study.config.config import MacroSettings, RunConfig, lines_of_cell
from porocore.study.notes.forecast import sheared
from porocore.study.notes.magnitudes import WARNING, known, prescribed_times, pulls, too_thin
from porocore.study.notes.reach import (
    DIAGONAL,
    LEAST_STRETCH,
    MINUS,
    ROUND_OFF,
    Reach,
    advice,
    beyond,
    change_without,
    shears,
    visited,
    written,
)
from porocore.study.run.composition import make_backend, with_memory

#: Steps after the ramp at least, beside those to the kinks of what is prescribed.
STEPS = 3
#: Equal steps from each kink to the next at most, none shorter than the run's own. One step for an unloading that
#: takes about as long as the consolidation told a suction of 7.6 kPa instead of 9.7, eight steps tell 9.4.
PARTS = 8
#: Unknowns times steps under all loads beyond which a check would take long.
MOST = 200_000


def too_large(macro: MacroSettings) -> str:
    """Return in words why the body is not solved before a run; empty where it is."""
    size, steps = body_mesh(macro).size, len(_times(macro, 1)) * len(_loads(macro))
    if size * steps <= MOST:
        return ""
    return f"{size:,} unknowns of the body times {steps} time steps are more than the {MOST:,} of a check"


def linear_solutions(config: RunConfig, linear: LinearCoefficients | MacroLaw) -> list[MacroSolution]:
    """Return the body's linear solutions on its own mesh under the lowest and the highest load, kept at every step.

    ``linear`` are the coefficients of its cell, or the linear law of the body with its memory.

    Raises
    ------
    SolveError
        A step fails, as one under a follower may.
    """
    law = linear
    if isinstance(law, LinearCoefficients):
        law = with_memory(LinearPoroelasticity(law), config, linear=True)
    solver, plan, found = make_backend("macro solver", config), _plan(config.macro), []
    for load in _loads(config.macro):
        problem = config.problem(load).model_copy(update={"time": plan})
        found.append(body_solution_of(solver, solver.prepare(problem), law, problem))
    return found


def _loads(macro: MacroSettings) -> list[float]:
    """Return the ends of the loads and of zero that are not zero."""
    return [load for load in (min(0.0, *macro.loads), max(0.0, *macro.loads)) if load != 0]


def _plan(macro: MacroSettings) -> TimePlan:
    """Return a time plan of as many steps as a check may take, with fields kept after each."""
    most = MOST // (body_mesh(macro).size * max(1, len(_loads(macro))))
    parts = next((n for n in range(PARTS, 1, -1) if len(_times(macro, n)) <= most), 1)
    return TimePlan.model_validate(_whole_segments(macro.time) | {"profiles": _times(macro, parts)})


def _times(macro: MacroSettings, parts: int) -> tuple[float, ...]:
    """Return the ends of steps, ``parts`` from each kink to the next, but none shorter than steps that are given."""
    time = macro.time
    ramp = time.end_of_ramp
    stepper, times = Stepper(TimePlan.model_validate(_whole_segments(time)), macro.corners), [0.0]
    while not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    found = []
    for begin, end in pairwise(times):
        own = time.ramp_step if end <= ramp * (1 + SAME) else time.step
        least, most = (math.ceil((end - begin) / step - SAME) for step in ((time.end - ramp) / STEPS, own))
        count = max(least, parts if time.tolerance else min(parts, most), 1)
        found += [begin + (end - begin) * k / count for k in range(1, count)] + [end]
    return tuple(found)


def _whole_segments(time: TimePlan) -> dict[str, object]:
    """Return settings of time whose only stops are the kinks of what is prescribed, the end of the ramp and the end."""
    ramp = time.end_of_ramp
    settings = time.model_dump() | {"ramp_increments": 1, "ramp_step": ramp, "tolerance": None}
    return settings | {"step": time.end, "profiles": ()}


#: States, and place and time of each.
Found = tuple[MacroState, Callable[[int], str]]

#: Beyond what the linear solution reaches, a proposed range goes by this share of what was missing: on a plug of a
#: scaffold at -10 % the law of the cell took H13 to -0.0100 where the linear one said -0.0072.
LINEAR_MARGIN = 0.5
#: A component of H, and a pressure as a share of the reference modulus, beyond which the linear solution tells a slip
#: rather than a range, unless half as much was sampled: pores of a tenth of their size gave H22 = 1.2.
UNLIKELY = {"H": 0.5, "p": 1.0}


def predicted_reach(config: RunConfig, linear: LinearCoefficients | MacroLaw) -> Iterator[str]:
    """Yield which components leave the sampled ranges by the linear solution of the body, one line for each.

    ``linear`` are the coefficients of its cell, or the linear law of the body with its memory. Several cells are
    looked at one after the other, each where it is.

    Where the body is too large for a check, or its linear solution fails, that is said, and what is prescribed is
    looked at alone.
    """
    why, failed = too_large(config.macro), ""
    solutions = []
    try:
        solutions = [] if why else linear_solutions(config, linear)
    except SolveError as error:
        failed = f"{WARNING}the linear solution of the body fails, and with it the run would: {error}"
    if why or failed:
        yield from (f"note: {note}" for note in prescribed_reach(config, body_mesh(config.macro)))
        yield failed or f"reach of the body: not predicted, since {why}"
        return
    parts = {name: _part(config, solutions, name) for name in config.cell_names}
    units = config.result_units
    found = {name: [_of_solution(each, units) for each in part] for name, part in parts.items()}
    spaces = {name: config.of_cell(name).sampling.input_space() for name in parts}
    reached = {
        name: extents(spaces[name], config.learns_potential, [states for states, _ in each])
        for name, each in found.items()
    }
    mesh = body_mesh(config.macro)
    thin = any(too_thin(config, mesh))  # a length is wrong, and with it the time that decides what p does
    for name, part in parts.items():
        left: list[str] = []
        lines = [*_reach(config.of_cell(name), part, found[name], name, left, None if config.cells else mesh)]
        yield from lines_of_cell(name, lines)
        if not thin and not any(line.startswith(WARNING) for line in lines):
            yield from lines_of_cell(name, too_wide(config, name, reached, left))
    if config.cells:
        yield from (f"note: {note}" for note in prescribed_reach(config, mesh))


def _part(config: RunConfig, solutions: Sequence[MacroSolution], name: str | None) -> list[MacroSolution]:
    """Return the solutions in the regions of a cell."""
    if not config.cells:
        return list(solutions)
    names = [parameter.name for parameter in config.of_cell(name).cell.parameters]
    return [each.of_regions(regions_of_cell(config.macro.regions, name), names) for each in solutions]


def _reach(
    config: RunConfig,
    solutions: Sequence[MacroSolution],
    found: Sequence[Found],
    name: str | None,
    left: list[str],
    mesh: BodyMesh | None,
) -> Iterator[str]:
    """Yield what the solutions say of the ranges of a cell; what is prescribed, only with the mesh of the body.

    Inputs whose ranges are left are added to ``left``.
    """
    units, where = config.result_units, "the body" if mesh is not None else "its part of the body"
    key = "sampling.inputs" if name is None else f"sampling.cells.{name}.inputs"
    sampled = config.sampling.input_space(), config.learns_potential
    share = max(map(partial(_share, *sampled), solutions, [states for states, _ in found]))
    reached = _beyond(*sampled, found) if share >= LEAST_FLAGGED else []
    if not reached:
        yield "reach of the body: by linear poroelasticity it stays within the sampled ranges"
        if mesh is not None:
            yield from (f"note: {note}" for note in prescribed_reach(config, mesh))
        yield from _crushed(found)
        return
    left += [each.name for each in reached]
    unlikely = list(_unlikely(config, reached))
    yield from unlikely
    crushed = list(_crushed(found))
    if unlikely and crushed:  # no range would do
        yield from crushed
        return
    yield (
        f"note: by linear poroelasticity up to {percent(share)} of {where} leaves the sampled ranges at one time; "
        f"{'only if all of these are meant, ' if unlikely else ''}write under '{key}:'"
    )
    yield from (f"  {each.line(units, LINEAR_MARGIN)}, since {each.in_words(units)}" for each in reached)
    if any(each.name in DIAGONAL and each.value > 0 for each in reached):
        yield from (f"note: {note}" for note in pulls(config.macro))
    yield from crushed
    new = [each.name for each in reached if each.name not in config.sampling.inputs]
    if new and body_mesh(config.macro).element.shape == "tetrahedron":
        yield (
            f"note: {', '.join(new)} may come from the mesh alone, as where a problem in one direction is solved on "
            "coarse tetrahedra; a finer mesh, or one of hexahedra, shows whether they stay"
        )
    nodes = len(config.cell.make_mesh("solid", "whole").points)
    for note in sheared(config.cell, config.sampling.inputs, nodes, left):
        yield f"note: {note}{_without(reached, found) if config.learns_potential else ''}"


def _unlikely(config: RunConfig, reached: Sequence[Reach]) -> Iterator[str]:
    """Yield what may be out by a factor of ten or a unit, where the body goes so far that a range would not do."""
    for each in reached:
        least = UNLIKELY["H"] if each.name != "p" else UNLIKELY["p"] * config.cell.modulus
        if abs(each.value) <= max(least, 2 * max(map(abs, each.sampled or (0.0, 0.0)))):
            continue
        units, scales = config.result_units, config.scales
        solid, pores = "the modulus of cell.material", "the size of the pores"
        if scales is not None:
            key = "scales.force, so a modulus of" if scales.modulus is None else "scales.modulus ="
            solid = f"{key} {units.text(1.0, 'stress', 4)}"
            pores = f"scales.pore = {length_text(scales.pore)} (K goes with its square)"
        yield (
            f"{WARNING}by linear poroelasticity {each.in_words(units)}, which no cell is likely to bear; is one of "
            "these out by a factor of ten, or by a unit?"
        )
        yield (
            f"  the loads and times under macro{_weight(config.macro, units)}; {solid}; {pores}; cell.viscosity = "
            f"{units.text(config.cell.viscosity, 'viscosity')}"
        )
        return


def _weight(macro: MacroSetup, units: ResultUnits) -> str:
    """Return the body force of a study with its unit; empty where there is none."""
    numbers = [value for value in macro.body_force if isinstance(value, int | float)]
    if not any(numbers):
        return ""
    largest = max(numbers, key=abs)
    return f", among them macro.body_force = {units.text(largest, 'body-force')} (a weight is density times 9.81 m/s^2)"


def _crushed(found: Sequence[Found]) -> Iterator[str]:
    """Yield a note where the linear solution crushes the body, or turns it inside out, and no range would do."""
    F = [np.eye(3) + states.grad_u for states, _ in found]
    least = [np.where(np.linalg.det(each) > 0, np.linalg.svd(each)[1][:, -1], 0.0) for each in F]
    k = int(np.argmin([each.min() for each in least]))
    row = int(least[k].argmin())
    if least[k][row] >= LEAST_STRETCH:
        return
    what = f"to {least[k][row]:.2g} of its length" if least[k][row] > 0 else "until it is turned inside out"
    yield (
        f"{WARNING}by linear poroelasticity the body is compressed {what} {found[k][1](row)}, which no cell is likely "
        "to bear; lower the load, bring it up over a longer time ('until' of its ramp, else ramp_increments times "
        "ramp_step), or check its unit"
    )


def _without(reached: Sequence[Reach], found: Sequence[Found]) -> str:
    """Return what leaving the reached shears out would change, for a cell with mirrors and no sampled shear."""
    shear = max((each for each in reached if each.name in shears(NAMES)), key=lambda each: abs(each.value))
    largest = max(float(np.abs(states.grad_u).max()) for states, _ in found)
    return (
        f"; {shear.name} = {shear.value:.2g} is {percent(abs(shear.value) / largest)} of the largest component of H; "
        "without sampling it states stay flagged, and results change by no more than about the square of this share, "
        f"{100 * change_without(shear.value, largest):.2g} %"
    ).translate(MINUS)


def prescribed_reach(config: RunConfig, mesh: BodyMesh) -> list[str]:
    """Return a note of the components that what is prescribed takes out of the sampled ranges, none without such.

    Of several cells it is not known which of them reaches it, so it is noted where it leaves the ranges of all.
    """
    found = [_prescribed(config.macro, config.result_units, mesh)]
    spaces = [config.of_cell(name).sampling.input_space() for name in config.cell_names]
    each = [_beyond(inputs, config.learns_potential, found) for inputs in spaces]
    reached = min(each, key=len)
    if not reached:
        return []
    said = advice(reached, config.result_units)
    return [f"what is prescribed leaves the sampled ranges, on average or more: {said}"]


def _beyond(inputs: InputSpace, objective: bool, found: Sequence[Found]) -> list[Reach]:
    """Return the components that leave the sampled ranges in any of the states that were found, the worst first."""
    states = MacroState.concatenate([states for states, _ in found])
    starts = np.cumsum([0, *(len(states) for states, _ in found)])
    if objective:
        states = inputs.without_rotation(states)

    def where(row: int) -> str:
        k = int(np.searchsorted(starts, row, side="right")) - 1
        return found[k][1](row - int(starts[k]))

    return beyond(inputs, components(states), where)


def _share(inputs: InputSpace, objective: bool, solution: MacroSolution, states: MacroState) -> float:
    """Return the largest share of the body that leaves the sampled ranges at one time, given the states at all."""
    # Fields do not leave the ranges of their parameters.
    states = replace(states, parameters=None)
    if objective:
        states = inputs.without_rotation(states)
    unit = inputs.to_unit(inputs.gather(states))
    outside = inputs.moves_other(states) | (np.abs(unit - 0.5) > 0.5 + ROUND_OFF).any(axis=1)
    volumes = BodyMesh.of(solution).weights.ravel()
    return float((outside.reshape(-1, len(volumes)) @ volumes).max() / volumes.sum())


def _of_solution(solution: MacroSolution, units: ResultUnits) -> Found:
    states, where = visited(solution, units)
    return states, lambda row: f"{where(row)} under the load {solution.load:g}"


def _prescribed(macro: MacroSettings, units: ResultUnits, mesh: BodyMesh) -> Found:
    """Return states of single components that are sure to occur, under all loads, and where each does."""
    times, rows, where = prescribed_times(macro), [np.zeros(10)], ["at rest"]
    for load in macro.loads:
        for each in known(macro, mesh, times):
            k = int(np.abs(each.values).argmax())
            rows.append(np.zeros(10))
            rows[-1][NAMES.index(each.name)] = load * each.values[k]
            where.append(
                f"{each.where} at t = {units.text(float(times[k]), 'time', 3)} under the load {load:g}"
            )
    flat = np.array(rows)
    return MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9]), where.__getitem__


#: Ranges so many times as wide as what is reached are noted: ample ones of the examples are 7, since pressures between
#: the few steps are higher by a third; a component below the smallest share of its range is zero.
WIDE, SMALLEST = 10.0, 1e-4
#: Beyond what the linear solution reaches, the proposed range goes by this share of it.
MARGIN = 0.5

#: Ends of what a cell reaches, zero included, by input.
Extents = Mapping[str, tuple[float, float]]


def extents(inputs: InputSpace, objective: bool, found: Sequence[MacroState]) -> Extents:
    """Return the least and largest value of each input of one cell in some states, zero included.

    States are ``objective`` where the surrogate does not change when they are turned.
    """
    states = MacroState.concatenate(list(found))
    if objective:
        states = inputs.without_rotation(states)
    rows = components(states)
    values = {name: rows[NAMES.index(name)] for name in inputs.names}
    return {name: (min(0.0, float(row.min())), max(0.0, float(row.max()))) for name, row in values.items()}


def too_wide(
    config: RunConfig, cell: str | None, reached: Mapping[str | None, Extents], left: Sequence[str]
) -> Iterator[str]:
    """Yield a note on the inputs of a cell that the body does not move, and on ranges that are much too wide.

    Parameters
    ----------
    config
        Configuration of the body of all cells.
    cell
        Name of the cell; None is that of the rest of the body, whose inputs are those of all cells.
    reached
        What each cell reaches.
    left
        Inputs whose ranges the cell leaves.
    """
    key = "sampling.inputs" if cell is None else f"sampling.cells.{cell}.inputs"
    inputs, units = config.of_cell(cell).sampling.input_space(), config.result_units
    widths = [upper - lower for lower, upper in zip(inputs.lower, inputs.upper, strict=True)]
    still = SMALLEST * min(widths)  # so that it is negligible next to the inputs that are left
    lines, idle = [], []
    for name, *ends in zip(inputs.names, inputs.lower, inputs.upper, strict=True):
        least = SMALLEST * (ends[1] - ends[0])
        heirs = {each: reached[each][name] for each in _heirs(config, name)} if cell is None else {}
        low, high = reached[cell][name]
        if high - low <= least:
            if high - low <= still:
                idle.append((name, [each for each, (below, above) in heirs.items() if above - below > still]))
            continue
        low = min(low, *(below for below, _ in heirs.values())) if heirs else low
        high = max(high, *(above for _, above in heirs.values())) if heirs else high
        times = (ends[1] - ends[0]) / (high - low)
        if name in left or times <= WIDE:
            continue
        more = MARGIN * (high - low)  # at both ends: the law of the cell may turn a sign
        texts = [written(name, end, units) for end in (max(low - more, ends[0]), min(high + more, ends[1]))]
        reaches = f"{written(name, low, units)} to {written(name, high, units)}".translate(MINUS)
        lines.append(
            f"  {name}: {{range: [{', '.join(texts)}]}}, since {name} reaches {reaches} and is sampled {times:.0f} "
            "times as wide"
        )
    if lines:
        yield (
            f"note: by linear poroelasticity the body uses less than one part in {WIDE:g} of a range, and states are "
            f"spent where it never comes; write under '{key}:'"
        )
        yield from lines
    yield from _idle(config, cell, key, idle)


def _heirs(config: RunConfig, name: str) -> Iterator[str]:
    """Yield the named cells whose range of an input is that of ``sampling.inputs``."""
    own = config.sampling.cells
    return (each for each in config.cells if each not in own or name not in own[each].inputs)


def _idle(
    config: RunConfig, cell: str | None, key: str, idle: Sequence[tuple[str, list[str]]]
) -> Iterator[str]:
    """Yield what to do with inputs that stay zero, each with the other cells that need it, where something helps."""
    kept = len(config.sampling.inputs) - len(idle)
    for name, needed in idle:
        if cell is not None and name in config.sampling.inputs:
            continue  # a cell cannot be without what is sampled for all
        if cell is None and not kept:
            continue
        if needed:
            places = " and ".join(f"'sampling.cells.{each}.inputs:'" for each in needed)
            what = f"move {name} from '{key}:' to {places}: the body moves it in no other cell"
        else:
            what = f"remove {name} from '{key}:': the body does not move it"
        yield f"note: {what}, by linear poroelasticity; keep it where large strains may"
