"""Contents of the report page from the results of a run: cases, cells, costs, errors, published values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.family import parameter_quantities
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.connectivity import pieces
from porocore.cell.quality import CLOSED_PORES, closed_pores, disagreements, grains
from porocore.interfaces.law import CellLaw
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.body.kinds import Box
from porocore.macro.boundary.contact import united
from porocore.macro.boundary.drainage import diffusion_time, undrained, unresolved
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.laws.closure import CLOSURES, Closure, ClosureError, closure_error
from porocore.macro.laws.direct import direct_records
from porocore.macro.laws.linear import LinearCoefficients, RestCoefficients, coefficients_of_elements
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.report.context import (
    AdaptiveSurrogateCost,
    CellSummary,
    DirectCost,
    LoadingMode,
    Published,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.metrics import LoadCase
from porocore.report.words.parameters import BodyCells, FamilySummary, volumes_of
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.samplers.active import LearningSampler
from porocore.states import Array, IntArray, MacroState, Status
from porocore.study.config.config import RunConfig
from porocore.study.notes.at_rest import edges
from porocore.study.notes.checks import place
from porocore.study.notes.magnitudes import out_of_plane, unloaded
from porocore.study.notes.parameters import family_summary, output_checks
from porocore.study.notes.reach import MORE, flagged_place, left_out_shear, shears
from porocore.study.run.composition import law_of_body, law_of_cell, make_backend
from porocore.study.run.folder import LINEAR, RunFolder, direct_law, fallback_law, versions
from porocore.study.run.results import RunResults, load_undeformed, times_of_all_cells
from porocore.study.run.training import read_training_curve


def report_context(results: RunResults) -> ReportContext:
    """Return the contents of the report of a run."""
    config, rest, cells = results.config, rest_of_body(results), results.by_cell
    whole = ReportContext(
        title=config.title or results.folder.path.name,
        **_of_cell(cells[None]),
        cases=tuple(_case(results, load) for load in config.macro.loads),
        stages=tuple(
            Stage(name, each.seconds, f"in {each.runs} runs" if each.runs > 1 else "", each.saved)
            for name, each in times_of_all_cells(results.folder).items()
            if name != "report"  # of an earlier page; this one is not written yet
        ),
        provenance={
            **versions(),
            **{
                each.folder.stage_of_cell(name): value
                for each in cells.values()
                for name, value in each.reference.mesh.items()
            },
            "run identity": config.identity,
        },
        config_text=config.resolved_yaml(),
        published=published_values(config),
        warnings=(
            *unloaded(config.macro, config.all_cells),
            *undrained(
                config.macro, np.max([each.reference.conductivity for each in cells.values()], axis=0)
            ),
            *(
                each.folder.said_of_cell(warning)
                for each in cells.values()
                for warning in (
                    *each.config.cell.geometry.warnings,
                    *(note.text for note in disagreements(each.config.cell)),
                )
            ),
            *_overshoots(results, rest),
            *out_of_plane(config, place(config)),
        ),
        direct=direct_costs(results),
        scenarios=config.scenarios,
        indenters=config.macro.contact,
        fallbacks=fallbacks_done(results),
        units=config.result_units,
        loading_mode=LoadingMode.from_setup(config.macro),
        body=body_cells(results, rest),
        relaxations=tuple(each for each in config.relaxations.values() if each is not None),
    )
    if not config.cells:
        return whole
    return replace(whole, parts=tuple(_part(whole, each) for each in cells.values()))


def _of_cell(results: RunResults) -> dict[str, Any]:
    """Return what a report shows of one cell."""
    dataset = results.dataset
    responses = dataset.responses()
    summaries = {name: _surrogate_summary(results, name) for name in results.surrogates}
    main = summaries.pop(results.config.closure)
    return {
        "cell": _cell_summary(results),
        "sampling": SamplingSummary(
            dataset.inputs,
            dataset.x(),
            responses.status,
            responses.stable,
            None if responses.extrema is None else responses.extrema.contact_share,
        ),
        "surrogate": main,
        "other_surrogates": tuple(summaries.values()),
        "family": _family(results),
    }


def _part(whole: ReportContext, results: RunResults) -> ReportContext:
    """Return what a report shows of one of several cells, where the body has it."""
    name, config = results.folder.cell, results.config
    of = "rest of the body" if name is None else name
    body = None
    if config.cell.is_family and whole.body is not None:
        regions = regions_of_cell(results.folder.whole.written.macro.regions, name)
        body = whole.body.of_regions(regions, [parameter.name for parameter in config.cell.parameters])
    return replace(
        whole,
        **_of_cell(results),
        of=of,
        name=name or "",
        cases=tuple(_case(results, load) for load in config.macro.loads),
        body=body,
    )


def _family(results: RunResults) -> FamilySummary | None:
    """Return the cell over its parameters; None for a cell without."""
    config = results.config
    if not config.cell.is_family:
        return None
    surrogate = results.surrogates[config.closure]
    law = ClosedLaw(
        surrogate, results.reference.closure(config.closure, config.cell.solid, config.conductivity)
    )
    return family_summary(config.cell, load_undeformed(results.folder), law, surrogate)


def _case(results: RunResults, load: float) -> LoadCase:
    others = dict(results.solutions[load])
    closure = results.config.closure
    nonlinear, linear = others.pop(closure), others.pop(LINEAR, None)
    if results.config.cells:
        parts = [(_case(each, load).flagged, each.folder) for each in results.by_cell.values()]
        flagged = " ".join(files.said_of_cell(said) for said, files in parts if said)
        return LoadCase(nonlinear, linear, tuple(others.values()), flagged=flagged)
    objective = results.config.learns_potential
    surrogate, units = results.surrogates[closure], results.config.result_units
    flagged = flagged_place(nonlinear, surrogate, objective, units, _more_states(results))
    left_out = None
    if objective and results.config.cell.mirrored and not shears(surrogate.inputs.names):
        left_out = left_out_shear(nonlinear, surrogate, results.config.surrogate.tolerance, units)
    return LoadCase(nonlinear, linear, tuple(others.values()), flagged=flagged, left_out=left_out)


def _more_states(results: RunResults) -> str:
    """Return what makes the sampler ask for more states: its tolerance, if it has ended before its budget."""
    sampler = make_backend("sampler", results.config)
    asked = len(results.dataset)
    if isinstance(sampler, LearningSampler) and asked < sampler.count:
        return f"lower sampling.tolerance, which ended the sampling after {asked} of {sampler.count} states"
    return MORE


def untouched(solution: MacroSolution) -> Iterator[str]:
    """Yield a warning for each indenter that touches nothing at any time."""
    for name, series in solution.contact.items():
        if not series[:, 0].any():
            yield (
                f"Load {solution.load:g}, law {solution.law}: the indenter '{name}' never touches the body, which "
                f"bears nothing of it. Move macro.contact.{name}.place to the surface, or give it a longer way; one "
                "smaller than a facet passes between the points of its contact, and needs smaller elements there."
            )


#: Facets below an indenter in three dimensions from which a contact area is read no better than to some fifth.
FEW = 8
#: Elements below one in two dimensions from which it is read no better than to some tenth, or some twentieth.
FEW_OF_CONE, FEW_OF_ROUND = 5, 3


def rough_contacts(solution: MacroSolution, problem: MacroProblem) -> Iterator[str]:
    """Yield a warning for each indenter whose contact area is that of a few facets, where its edge crosses them."""
    mesh = body_mesh(problem)
    for name, indenter in problem.contact.items():
        kind, series = indenter.shape.kind, solution.contact[name]
        at = int(series[:, 0].argmax())
        none = series[at, 0] > 0 and series[at, 2] == 0
        if kind not in ("sphere", "cone", "cylinder" if mesh.flat else "surface") and not none:
            continue
        surfaces = [mesh.surface(each, f"macro.contact.{name}.surfaces") for each in indenter.surfaces]
        nodes = united(mesh, surfaces).nodes
        counts = [int((each.contact_pressure[nodes] > 0).all(axis=1).sum()) for each in solution.profiles]
        most = max(counts, default=0)
        few, share = FEW, "fifth"
        if mesh.flat:
            few, share = (FEW_OF_CONE, "tenth") if kind == "cone" else (FEW_OF_ROUND, "twentieth")
        if none:
            yield (
                f"Load {solution.load:g}, law {solution.law}: the indenter '{name}' touches the body at the rim of an "
                f"element alone, and its contact area is told as 0. Take smaller elements below macro.contact.{name}"
                ".place; its force is not accurate either."
            )
        elif 0 < most <= few:
            radius = " and radius" * indenter.touches_circle(section=mesh.is_section)
            touched = f"{most} facet{'s' * (most > 1)}"
            yield (
                f"Load {solution.load:g}, law {solution.law}: the indenter '{name}' touches {touched} of the body at "
                f"most, from which its contact area{radius} is read no better than to some {share}. Take smaller "
                f"elements below macro.contact.{name}.place where these matter; its force is more accurate."
            )


def _overshoots(results: RunResults, rest: LinearCoefficients | RestCoefficients) -> Iterator[str]:
    """Yield warnings of largest pressures that the mesh does not resolve, and of indenters that touch nothing."""
    limit = diffusion_time(results.config.macro, rest)
    for solution in results.all_solutions:
        problem = results.config.macro.problem(solution.load)
        warning = unresolved(problem, limit, solution)
        if warning is not None:
            yield warning
        yield from untouched(solution)
        yield from rough_contacts(solution, problem)


def _surrogate_summary(results: RunResults, closure: str) -> SurrogateSummary:
    surrogate = results.surrogates[closure]
    config = results.config.with_closure(closure)
    model = surrogate.model
    table = read_training_curve(results.folder.with_config(config).training_curve)
    return SurrogateSummary(
        backend=config.surrogate.backend,
        description=f"{f'the model {model}' if model else 'a model'} of the backend {config.surrogate.backend}, for "
        f"the closure {closure}",
        training_states=int(results.dataset.responses().stable.sum()),
        outputs=output_checks(results.dataset, results.held_out, surrogate, _in_bodies(results)),
        # A fit that is done at once has no curve.
        curve=None if table is None or len(table) < 2 else TrainingCurve(*table.T),
        # Only stress and storage are compared, and not all states have a conductivity.
        closure_error=_closure_error(
            results.reference.closure(closure, config.cell.solid, "piola"), results.dataset, surrogate
        ),
        closure=closure,
        exact_closure="stress" in CLOSURES[closure].responses,
    )


def _closure_error(closure: Closure, dataset: Dataset, surrogate: Surrogate) -> ClosureError | None:
    """Return the error of a closure on the stable states; None without stresses of the cell solver.

    The surrogate gives φ_f of the undeformed members of a family.
    """
    solved = np.flatnonzero(dataset.responses().stable)
    exact = dataset.responses()[solved]
    if exact.stress is None or exact.fluid_volume is None:
        return None
    states = dataset.states()[solved]
    cells = None if states.parameters is None else surrogate.undeformed(states.parameters)
    return closure_error(closure, states, exact, cells)


def _in_bodies(results: RunResults) -> MacroState | None:
    """Return the states of the elements of the body under all loads at the kept times, turned as sampled states are."""
    found = [
        solution.cell_states(i)
        for solution in (each[results.config.closure] for each in results.solutions.values())
        for i in range(len(solution.profiles))
    ]
    if not found:
        return None
    states, inputs = MacroState.concatenate(found), results.dataset.inputs
    return inputs.without_rotation(states) if results.config.learns_potential else states


def _cell_summary(results: RunResults) -> CellSummary:
    cell = results.config.cell
    shown = cell.at([each.base for each in cell.parameters]) if cell.is_family else cell
    single = cell.model_copy(update={"supercell": (1, 1, 1)})
    solid = cell.make_mesh("solid", "whole")
    closed = closed_pores(pieces(single.make_mesh("fluid", "whole")))
    return CellSummary(
        description=f"{shown.geometry.description}; {shown.solid.description}",
        porosity=results.reference.porosity,
        viscosity=cell.viscosity,
        linear=results.coefficients,
        mesh=results.reference.mesh,
        surface=(solid.points, solid.cells),
        crease=None if cell.is_family else crease_line(cell),
        law=results.config.conductivity,
        remarks=(
            *cell.geometry.notes,
            *grains(single),
            *(line.strip() for line in edges(cell, results.config.cell_length)),
            *([CLOSED_PORES] if closed else []),
            *([cell.geometry.error_of_shape] if cell.geometry.error_of_shape else []),
        ),
        image_porosity=cell.geometry.porosity if isinstance(cell.geometry, Voxels) else None,
        parting=cell.geometry.parting if isinstance(cell.geometry, Voxels) else None,
        which="in the middle of the ranges" if cell.is_family else "",
    )


def body_solution(results: RunResults) -> MacroSolution:
    """Return the solution of the first load with the closure that is shown."""
    return results.solutions[results.config.macro.loads[0]][results.config.closure]


def rest_of_body(results: RunResults) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity at rest of the elements at first; of one cell everywhere that of the cell."""
    cells, config = body_solution(results).element_cells, results.config
    if cells is None:
        return results.coefficients
    with ExitStack() as stack:
        laws = {
            files.cell: law_of_cell(files, stack, "surrogate").law for files in results.folder.of_each_cell
        }
        return coefficients_of_elements(law_of_body(config, laws), cells)


def body_cells(results: RunResults, rest: LinearCoefficients | RestCoefficients) -> BodyCells | None:
    """Return the cells of the body; None for a body of one cell without parameters.

    ``rest`` is that of :func:`rest_of_body`.
    """
    solution, config = body_solution(results), results.config
    cells = solution.element_cells
    if cells is None:
        return None
    assert isinstance(rest, RestCoefficients)
    quantities: dict[str, str] = {}
    for each in results.by_cell.values():
        quantities |= parameter_quantities(each.config.cell)
    names = [region.cell for region in config.macro.regions.values()] if config.cells else []
    return BodyCells(
        cells,
        tuple(profile.time for profile in solution.profiles),
        volumes_of(solution),
        rest.conductivity,
        _porosity(results, cells.region),
        quantities,
        tuple(name or "cell" for name in (None, *names)) if config.cells else (),
    )


def _porosity(results: RunResults, region: IntArray) -> Array | None:
    """Return φ_f of the undeformed cells of the elements at first, by their regions; None for a body of one cell."""
    if not results.config.cells and not results.config.cell.is_family:
        return None
    found = np.full(len(region), np.nan)
    for name, each in results.by_cell.items():
        cells = body_solution(each).element_cells
        values = None if cells is None else cells.values_at(0)
        surrogate: CellLaw = each.surrogates[each.config.closure]
        undeformed = None if values is None else surrogate.undeformed(values)
        inside = np.isin(region, regions_of_cell(results.config.macro.regions, name))
        found[inside] = each.reference.porosity if undeformed is None else undeformed.porosity
    return found


def direct_costs(results: RunResults) -> tuple[DirectCost, ...]:
    """Return the cost of every solution by direct FE² whose cost was recorded."""
    timings, found = results.seconds, []
    for closure, law, load, work in _recorded(results, lambda files: files.direct_work, direct_law):
        seconds = timings.get(f"macro, {law}, load {load:g}")
        if seconds is not None:
            failed = sum(work.get(status.name, 0) for status in Status if not status.has_values)
            counts = (int(work["points"]), int(work["solves"]), int(failed))
            of_surrogate = timings.get(f"macro, {closure}, load {load:g}")
            found.append(DirectCost(law, load, *counts, work["seconds"], seconds, of_surrogate))
    return tuple(found)


def fallbacks_done(results: RunResults) -> tuple[AdaptiveSurrogateCost, ...]:
    """Return the work of the fallback in every solution that has one."""
    found = []
    for _, law, load, work in _recorded(results, lambda files: files.fallback_work, fallback_law):
        solves, failed, learned, refits = (
            int(work[name]) for name in ("solves", "failed", "learned", "refits")
        )
        seconds = work["solve_seconds"], work["fit_seconds"]
        found.append(AdaptiveSurrogateCost(law, load, solves, failed, learned, refits, *seconds))
    return tuple(found)


def _recorded(
    results: RunResults, record: Callable[[RunFolder], Path], law_with: Callable[[str], str]
) -> Iterator[tuple[str, str, float, dict[str, float]]]:
    """Yield closure, law, load and work, of all cells together, of every solution with a law that solves cells."""
    records = [direct_records(record(each.folder)) for each in results.by_cell.values()]
    for load, solutions in results.solutions.items():
        for closure in CLOSURES:
            law = law_with(closure)
            stem = results.folder.solution(law, load).stem
            found = [each[stem] for each in records if stem in each]
            if found and law in solutions:
                names = dict.fromkeys(name for each in found for name in each)
                yield closure, law, load, {name: sum(each.get(name, 0) for each in found) for name in names}


#: The benchmark of Dehghani & Zilian.
DEHGHANI_ZILIAN = Published(
    source="H. Dehghani and A. Zilian, Finite strain poro-hyperelasticity: an asymptotic multi-scale ALE-FSI "
    "approach supported by ANNs",
    load=-0.2,
    porosity=0.29,
    conductivity_viscosity=1.943e-3,
    mean_grad_2222=-0.23,
    mean_grad_2211=-0.076,
    mean_grad_p_11=-0.113,
    settlement="around 20 % smaller",
    steady_time=38.0,
    duration="considerably shorter time",
    note="The text of the paper gives the radius 0.2, and the published porosity belongs to this radius. But the "
    "published K, M and Q belong to a radius of 0.25 and a Poisson ratio of 0.35.",
)


def published_values(config: RunConfig) -> Published | None:
    """Return the values of Dehghani & Zilian for their cell and column with either radius; None for other studies."""
    macro, geometry = config.macro, config.cell.geometry
    same = (
        isinstance(geometry, OrthogonalChannels)
        and geometry.axes == "xyz"
        and geometry.radius in (0.2, 0.25)
        and isinstance(macro.body, Box)
        and macro.body.size == (0.1, 7.5, 0.1)
        and -0.2 in macro.loads
        and not config.cells
    )
    return DEHGHANI_ZILIAN if same else None


def crease_line(cell: Cell) -> tuple[float, float] | None:
    """Return (a, b) of the benchmark's cell, None for others.

    Beyond H_22 = a + b p the ridges of its solid crease on a very fine mesh.
    """
    geometry = cell.geometry
    same = (
        isinstance(geometry, OrthogonalChannels)
        and geometry.axes == "xyz"
        and abs(geometry.radius - 0.25) < 1e-12
        and cell.solid == NeoHookean(poisson_ratio=0.35)
    )
    return (-0.15, -0.33) if same else None
