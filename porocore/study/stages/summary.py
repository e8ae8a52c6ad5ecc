"""Contents of the report page from the results of a run: cases, costs, errors of surrogate and closure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.level_sets.agreement import disagreements, grains
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import pieces
from porocore.cell.meshing.mesh_quality import CLOSED_PORES, closed_pores
from porocore.core.inputs.sampled_range import SampledRange
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.boundary.drainage import undrained
from porocore.macro.closure_error import ClosureError, closure_error
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.direct_record import direct_records
from porocore.macro.oscillation import diffusion_time, unresolved
from porocore.macro.reference import CellReference
from porocore.plugins.border import prediction_of
from porocore.report.context import (
    AdaptiveSurrogateCost,
    CellSummary,
    DirectCost,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.loading_mode import LoadingMode
from porocore.report.metrics import LoadCase
from porocore.report.words.held_out import OutputCheck
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.samplers.active import LearningSampler
from porocore.states import Array, MacroState, Status
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.preflight.at_rest import edges
from porocore.study.preflight.symmetry_notes import LARGEST_DEFECT
from porocore.study.publication import crease_line, published_values
from porocore.study.reach import MORE, flagged_place, left_out_shear, shears
from porocore.study.run_folder.files import LINEAR, direct_law, fallback_law
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.results import RunResults
from porocore.study.stages.training import read_training_curve

#: An output whose values span less than this is zero up to the cell solver's tolerance and is not judged.
FLAT = 1e-9
#: A component that varies by less than this share of the largest of its tensor is zero up to the mesh, and not judged.
NOTHING = 1e-3
_SUBSCRIPTS = "₁₂₃"
#: Responses of a cell that have a unit.
_QUANTITIES = {"stress": "stress", "conductivity": "conductivity"}


def report_context(results: RunResults) -> ReportContext:
    """Return the contents of the report of a run."""
    config, reference, dataset = results.config, results.reference, results.dataset
    cases = tuple(_case(results, load) for load in config.macro.loads)
    responses = dataset.responses()
    summaries = {name: _surrogate_summary(results, name) for name in results.surrogates}
    main = summaries.pop(config.closure)
    return ReportContext(
        title=config.title or results.folder.path.name,
        cell=_cell_summary(results),
        sampling=SamplingSummary(
            dataset.inputs,
            dataset.x(),
            responses.status,
            responses.stable,
            None if responses.extrema is None else responses.extrema.contact_share,
        ),
        surrogate=main,
        cases=cases,
        stages=tuple(
            Stage(name, each.seconds, f"in {each.runs} runs" if each.runs > 1 else "", each.saved)
            for name, each in results.timings.items()
            if name != "report"  # of an earlier page; this one is not written yet
        ),
        provenance={**versions(), **reference.mesh, "run identity": config.identity},
        config_text=config.resolved_yaml(),
        published=published_values(config),
        warnings=(
            *undrained(config.macro, reference.conductivity),
            *disagreements(config.cell),
            *_overshoots(results),
        ),
        other_surrogates=tuple(summaries.values()),
        direct=direct_costs(results),
        scenarios=config.scenarios,
        fallbacks=fallbacks_done(results),
        units=config.result_units,
        loading_mode=LoadingMode.from_setup(config.macro),
    )


def _case(results: RunResults, load: float) -> LoadCase:
    others = dict(results.solutions[load])
    closure = results.config.closure
    nonlinear, linear = others.pop(closure), others.pop(LINEAR, None)
    objective = results.config.surrogate_model == "potential"
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


def _overshoots(results: RunResults) -> Iterator[str]:
    """Yield warnings of largest pressures that the mesh does not resolve."""
    limit = diffusion_time(results.config.macro, results.coefficients)
    for solution in results.all_solutions:
        warning = unresolved(results.config.macro.problem(solution.load), limit, solution)
        if warning is not None:
            yield warning


def _surrogate_summary(results: RunResults, closure: str) -> SurrogateSummary:
    surrogate = results.surrogates[closure]
    config = results.config.with_closure(closure)
    model = surrogate.model
    table = read_training_curve(results.folder.training_curve_of(config))
    return SurrogateSummary(
        backend=config.surrogate.backend,
        description=f"{f'the model {model}' if model else 'a model'} of the backend {config.surrogate.backend}, for "
        f"the closure {closure}",
        training_states=int(results.dataset.responses().stable.sum()),
        outputs=output_checks(results.dataset, results.held_out, surrogate, _in_bodies(results)),
        # A fit that is done at once has no curve.
        curve=None if table is None or len(table) < 2 else TrainingCurve(*table.T),
        closure_error=_closure_error(config, results.reference, results.dataset),
        closure=closure,
        exact_closure="stress" in CLOSURES[closure].responses,
    )


def direct_costs(results: RunResults) -> tuple[DirectCost, ...]:
    """Return the cost of every solution by direct FE² whose cost was recorded."""
    timings, found = results.seconds, []
    for closure, law, load, work in _recorded(results, results.folder.direct_work, direct_law):
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
    for _, law, load, work in _recorded(results, results.folder.fallback_work, fallback_law):
        solves, failed, learned, refits = (
            int(work[name]) for name in ("solves", "failed", "learned", "refits")
        )
        seconds = work["solve_seconds"], work["fit_seconds"]
        found.append(AdaptiveSurrogateCost(law, load, solves, failed, learned, refits, *seconds))
    return tuple(found)


def _recorded(
    results: RunResults, record: Path, law_with: Callable[[str], str]
) -> Iterator[tuple[str, str, float, dict[str, float]]]:
    """Yield closure, law, load and recorded work of every solution with a law that solves cells."""
    records = direct_records(record)
    for load, solutions in results.solutions.items():
        for closure in CLOSURES:
            law = law_with(closure)
            work = records.get(results.folder.solution(law, load).stem)
            if work is not None and law in solutions:
                yield closure, law, load, work


def _closure_error(config: RunConfig, reference: CellReference, dataset: Dataset) -> ClosureError | None:
    """Return the error of a closure on the stable states; None without stresses of the cell solver."""
    solved = np.flatnonzero(dataset.responses().stable)
    exact = dataset.responses()[solved]
    if exact.stress is None or exact.fluid_volume is None:
        return None
    # Only stress and storage are compared, and not all states have a conductivity.
    closure = reference.closure(config.closure, config.cell.solid, "piola")
    return closure_error(closure, dataset.states()[solved], exact)


def _in_bodies(results: RunResults) -> MacroState | None:
    """Return the states of the elements of the body under all loads at the kept times, turned as sampled states are."""
    found = [
        MacroState(profile.grad_u, profile.element_p)
        for solutions in results.solutions.values()
        for profile in solutions[results.config.closure].profiles
    ]
    if not found:
        return None
    states, inputs = MacroState.concatenate(found), results.dataset.inputs
    return inputs.without_rotation(states) if results.config.surrogate_model == "potential" else states


def output_checks(
    dataset: Dataset, held_out: Dataset, surrogate: Surrogate, in_body: MacroState | None = None
) -> tuple[OutputCheck, ...]:
    """Compare the surrogate with the held-out states, for each predicted component that varies.

    ``in_body`` are the states of the body, which tell how much of a component's range the body uses.
    """
    used = None if in_body is None else prediction_of(surrogate, in_body, tangent=False)
    trained, tested = dataset.responses(), held_out.responses()
    training = trained.stable
    solved = np.flatnonzero(tested.stable)
    states = held_out.states()[solved]
    predicted = prediction_of(surrogate, states, tangent=False)
    outside = SampledRange.around(dataset.inputs, dataset.x()[training]).outside(states)
    checks = []
    for field, at, name, plain in _outputs():
        quantity = _QUANTITIES.get(field, "")
        every, exact, guess = (getattr(response, field) for response in (trained, tested, predicted))
        if every is None or exact is None or guess is None:
            continue
        # Some states have no conductivity of the deformed pore; its scale is that of the viscosity.
        taught, found = every[training][at], exact[solved][at]
        taught, known = taught[np.isfinite(taught)], np.isfinite(found)
        span = float(np.ptp(taught)) if len(taught) else 0.0
        flat = FLAT * (float(np.nanmax(np.abs(every[training]))) if field == "conductivity" else 1.0)
        if known.any() and span >= max(flat, _nothing(every[training], guess[at][known])):
            ends = None if used is None else _ends(getattr(used, field)[at])
            checks.append(
                OutputCheck(name, plain, found[known], guess[at][known], span, outside[known], quantity, ends)
            )
    return tuple(checks)


def _ends(values: Array) -> tuple[float, float] | None:
    """Return least and largest of the values that are finite."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else None


def _nothing(taught: Array, guess: Array) -> float:
    """Return the span up to which a component is zero by symmetry, given all of its tensor and its predictions.

    It varies by the error of the mesh, which is no error of the surrogate. A mesh that breaks the symmetry by more is
    warned of.
    """
    largest = float(np.nanmax(np.ptp(taught.reshape(len(taught), -1), axis=0), initial=0.0))
    return (LARGEST_DEFECT if np.ptp(guess) <= FLAT * largest else NOTHING) * largest


def _outputs() -> Iterator[tuple[str, Any, str, str]]:
    """Yield field of the response, index of a component, and its name in mathematics and in plain text."""
    for i, j in np.ndindex(3, 3):
        name, plain = (
            rf"$\langle\nabla_Y u^1\rangle_{{{i + 1}{j + 1}}}$",
            f"⟨∇u¹⟩{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}",
        )
        yield "mean_grad", (slice(None), i, j), name, plain
    for i, j in np.ndindex(3, 3):
        yield "stress", (slice(None), i, j), f"$P_{{E,{i + 1}{j + 1}}}$", f"P_E,{i + 1}{j + 1}"
    yield "fluid_volume", slice(None), r"$\varphi$", "fluid volume φ"
    for i, j in zip(*np.triu_indices(3), strict=True):
        plain = f"K{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}"
        yield "conductivity", (slice(None), i, j), f"$K_{{{i + 1}{j + 1}}}$", plain


def _cell_summary(results: RunResults) -> CellSummary:
    cell = results.config.cell
    single = cell.model_copy(update={"supercell": (1, 1, 1)})
    solid = cell.make_mesh("solid", "whole")
    closed = closed_pores(pieces(single.make_mesh("fluid", "whole")))
    return CellSummary(
        description=f"{cell.geometry.description}; {cell.solid.description}",
        porosity=results.reference.porosity,
        viscosity=cell.viscosity,
        linear=results.coefficients,
        mesh=results.reference.mesh,
        surface=(solid.points, solid.cells),
        crease=crease_line(cell),
        law=results.config.conductivity,
        remarks=(
            *cell.geometry.notes,
            *grains(single),
            *(line.strip() for line in edges(results.config)),
            *([CLOSED_PORES] if closed else []),
        ),
        image_porosity=cell.geometry.porosity if isinstance(cell.geometry, Voxels) else None,
    )
