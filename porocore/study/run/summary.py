"""Contents of the report page from the results of a run: cases, costs, errors of surrogate and closure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from porocore.cell.level_sets.agreement import disagreements, grains
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import pieces
from porocore.cell.meshing.mesh_quality import CLOSED_PORES, closed_pores
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.boundary.drainage import undrained
from porocore.macro.composition.linearised_law import RestCoefficients
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.laws import CLOSURES, ClosedLaw
from porocore.macro.laws.closure import ClosureError, closure_error
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference, diffusion_time, unresolved
from porocore.report.context import (
    CellSummary,
    LoadingMode,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.metrics import LoadCase
from porocore.report.words.parameters import FamilySummary
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.samplers.active import LearningSampler
from porocore.states import MacroState
from porocore.study.config.config import RunConfig
from porocore.study.notes.at_rest import edges
from porocore.study.notes.magnitudes import unloaded
from porocore.study.notes.members import body_cells, direct_costs, fallbacks_done, rest_of_body
from porocore.study.notes.parameters import family_summary, output_checks
from porocore.study.notes.publication import crease_line, published_values
from porocore.study.notes.reach import MORE, flagged_place, left_out_shear, shears
from porocore.study.run.composition import make_backend
from porocore.study.run.folder import LINEAR, versions
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
                for warning in (*each.config.cell.geometry.warnings, *disagreements(each.config.cell))
            ),
            *_overshoots(results, rest),
        ),
        direct=direct_costs(results),
        scenarios=config.scenarios,
        fallbacks=fallbacks_done(results),
        units=config.result_units,
        loading_mode=LoadingMode.from_setup(config.macro),
        body=body_cells(results, rest),
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


def _overshoots(results: RunResults, rest: LinearCoefficients | RestCoefficients) -> Iterator[str]:
    """Yield warnings of largest pressures that the mesh does not resolve."""
    limit = diffusion_time(results.config.macro, rest)
    for solution in results.all_solutions:
        warning = unresolved(results.config.macro.problem(solution.load), limit, solution)
        if warning is not None:
            yield warning


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
        closure_error=_closure_error(config, results.reference, results.dataset, surrogate),
        closure=closure,
        exact_closure="stress" in CLOSURES[closure].responses,
    )


def _closure_error(
    config: RunConfig, reference: CellReference, dataset: Dataset, surrogate: Surrogate
) -> ClosureError | None:
    """Return the error of a closure on the stable states; None without stresses of the cell solver.

    The surrogate gives φ_f of the undeformed members of a family.
    """
    solved = np.flatnonzero(dataset.responses().stable)
    exact = dataset.responses()[solved]
    if exact.stress is None or exact.fluid_volume is None:
        return None
    # Only stress and storage are compared, and not all states have a conductivity.
    closure = reference.closure(config.closure, config.cell.solid, "piola")
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
        which="in the middle of the ranges" if cell.is_family else "",
    )
