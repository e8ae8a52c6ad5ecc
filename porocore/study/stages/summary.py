"""From the files of a run to what the report shows and to the figures of merit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from porocore.cell.geometry.kinds import OrthogonalChannels
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.inputs.sampled_range import SampledRange
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.body.kinds import Box
from porocore.macro.closure_error import ClosureError, closure_error
from porocore.macro.drainage import undrained
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.direct_record import direct_records
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.oscillation import diffusion_time, unresolved
from porocore.macro.reference import CellReference
from porocore.plugins.border import prediction_of
from porocore.report.context import (
    DEHGHANI_ZILIAN,
    Case,
    CellSummary,
    DirectCost,
    FallbackDone,
    OutputCheck,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.dimensional import dimensional_metrics
from porocore.report.law_differences import case_gaps
from porocore.report.loading_mode import LoadingMode, reactions
from porocore.report.metrics import report_metrics, rms_percent, worst_percent
from porocore.report.statuses import solved_shares, visited_shares
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import MacroState, Status
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.files import LINEAR, direct_law, fallback_law
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.training_curve import read_training_curve

#: An output whose values span less than this is zero up to the cell solver's tolerance and is not judged.
FLAT = 1e-9
_SUBSCRIPTS = "₁₂₃"


def gather(
    folder: RunFolder,
    config: RunConfig,
    reference: CellReference,
    coefficients: LinearCoefficients,
    surrogates: dict[str, Surrogate],
    timings: dict[str, float],
    runs: dict[str, int],
) -> tuple[ReportContext, dict[str, Any]]:
    """Return the report's context, and the figures of merit ready for JSON.

    ``surrogates`` by closure: that of ``config``, and those of the other closures that were solved with. ``runs`` says
    by stage how many runs a time in ``timings`` is of.
    """
    dataset = Dataset.open(folder.dataset, identity=config.stages.sampling)
    held_out = Dataset.open(folder.test_dataset, identity=config.stages.test)
    cases = tuple(
        Case(
            MacroSolution.load_file(folder.solution(config.closure, load)),
            MacroSolution.load_file(folder.solution(LINEAR, load)),
            tuple(
                MacroSolution.load_file(folder.solution(law, load))
                for law in folder.solved(load)
                if law != config.closure
            ),
        )
        for load in config.macro.loads
    )
    cases = tuple(
        replace(case, flagged=flagged_place(case.nonlinear, surrogates[config.closure])) for case in cases
    )
    responses = dataset.responses()
    training = responses.stable
    summaries = {
        name: _surrogate_summary(folder, config.with_closure(name), reference, dataset, held_out, surrogate)
        for name, surrogate in surrogates.items()
    }
    main = summaries.pop(config.closure)
    outputs, closure = main.outputs, main.closure_error
    limit = diffusion_time(config.macro, coefficients)
    direct = direct_costs(folder, config, timings)
    context = ReportContext(
        title=config.title or folder.path.name,
        cell=_cell_summary(config, reference, coefficients),
        sampling=SamplingSummary(dataset.inputs, dataset.x(), responses.status, training),
        surrogate=main,
        cases=cases,
        stages=tuple(
            Stage(name, seconds, f"in {runs[name]} runs" if runs.get(name, 1) > 1 else "")
            for name, seconds in timings.items()
        ),
        provenance={**versions(), **reference.mesh, "run identity": config.identity},
        config_text=config.resolved_yaml(),
        published=DEHGHANI_ZILIAN if _is_the_benchmark(config) else None,
        warnings=(*undrained(config.macro, reference.conductivity), *_overshoots(config, cases, limit)),
        other_surrogates=tuple(summaries.values()),
        direct=direct,
        scenarios=config.scenarios,
        fallbacks=(fallbacks := fallbacks_done(folder, config)),
        units=config.result_units,
        drive=(drive := LoadingMode.of(config.macro)),
    )
    metrics = {
        "cell": {
            "porosity": reference.porosity,
            "conductivity": reference.conductivity.tolist(),
            "M_2222": float(coefficients.mean_grad_grad_u[1, 1, 1, 1]),
            "M_2211": float(coefficients.mean_grad_grad_u[1, 1, 0, 0]),
            "Q_11": float(coefficients.mean_grad_p[0, 0]),
            "C_eff_2222": float(coefficients.stiffness[1, 1, 1, 1]),
            "biot_coefficient": float(coefficients.biot[1, 1]),
            "biot_modulus": coefficients.biot_modulus,
            "consolidation_coefficient": coefficients.consolidation_coefficient(),
        },
        "sampling": {
            "states": len(dataset),
            "statuses": _counts(responses.status),
            "shares": solved_shares(context.sampling),
            "solve_seconds_mean": float(np.mean(dataset.seconds())),
            "held_out_states": len(held_out),
            "held_out_statuses": _counts(held_out.responses().status),
        },
        "surrogate": {
            "training_states": int(training.sum()),
            "test_states": int(outputs[0].counted.sum()) if outputs else 0,
            "test_states_beyond_range": bool(outputs) and outputs[0].all_outside,
            **_errors(main),
        },
        "closure": None if closure is None else closure.for_json(),
        "macro": [
            {
                **found,
                "mesh_diffusion_time": limit,
                "gaps": case_gaps(case),
                "cell_states": visited_shares(case.nonlinear, context.sampling),
            }
            for found, case in zip(report_metrics(cases)["cases"], cases, strict=True)
        ],
    }
    solutions = [each for case in cases for each in (case.nonlinear, case.linear, *case.others)]
    if drive.displaced:
        metrics["reactions"] = [
            {"law": each.law, "load": each.load, "surfaces": reactions(each)} for each in solutions
        ]
    if config.result_units.given:
        metrics["dimensional"] = dimensional_metrics(solutions, config.result_units)
    if summaries:
        metrics["other_surrogates"] = {name: _errors(summary) for name, summary in summaries.items()}
    if fallbacks:
        metrics["fallback"] = [asdict(done) for done in fallbacks]
    if direct:
        metrics["direct"] = [asdict(cost) | {"speed_up": cost.speed_up} for cost in direct]
    return context, metrics


def _overshoots(config: RunConfig, cases: tuple[Case, ...], limit: float) -> Iterator[str]:
    """Warnings of largest pressures that the mesh does not resolve."""
    for case in cases:
        for solution in (case.nonlinear, case.linear, *case.others):
            warning = unresolved(config.macro.problem(case.load), limit, solution)
            if warning is not None:
                yield warning


def _errors(summary: SurrogateSummary) -> dict[str, Any]:
    return {
        "rms_error_percent_of_range": {check.plain: rms_percent(check) for check in summary.outputs},
        "largest_error_percent_of_range": {check.plain: worst_percent(check) for check in summary.outputs},
    }


def _surrogate_summary(
    folder: RunFolder,
    config: RunConfig,
    reference: CellReference,
    dataset: Dataset,
    held_out: Dataset,
    surrogate: Surrogate,
) -> SurrogateSummary:
    model = surrogate.model
    return SurrogateSummary(
        backend=config.surrogate.backend,
        description=f"{f'model {model}, ' if model else ''}{config.closure} closure; trained on stable states only",
        training_states=int(dataset.responses().stable.sum()),
        outputs=output_checks(dataset, held_out, surrogate),
        curve=_training_curve(folder, config),
        closure_error=_closure_error(config, reference, dataset),
        closure=config.closure,
        exact_closure="stress" in CLOSURES[config.closure].responses,
    )


def direct_costs(folder: RunFolder, config: RunConfig, timings: dict[str, float]) -> tuple[DirectCost, ...]:
    """Of every solution by direct FE² whose cost was recorded."""
    records, found = direct_records(folder.direct_work), []
    for load in config.macro.loads:
        for closure in CLOSURES:
            law = direct_law(closure)
            path = folder.solution(law, load)
            work = records.get(path.stem)
            seconds = timings.get(f"macro, {law}, load {load:g}")
            if work is None or seconds is None or not path.exists():
                continue
            failed = sum(work.get(status.name, 0) for status in Status if not status.has_values)
            found.append(
                DirectCost(
                    law,
                    load,
                    int(work["points"]),
                    int(work["solves"]),
                    int(failed),
                    work["seconds"],
                    seconds,
                    timings.get(f"macro, {closure}, load {load:g}"),
                )
            )
    return tuple(found)


def fallbacks_done(folder: RunFolder, config: RunConfig) -> tuple[FallbackDone, ...]:
    """Of every solution with a fallback."""
    records, found = direct_records(folder.fallback_work), []
    for load in config.macro.loads:
        for law in map(fallback_law, CLOSURES):
            path = folder.solution(law, load)
            work = records.get(path.stem)
            if work is not None and path.exists():
                solves, failed, learned, refits = (
                    int(work[name]) for name in ("solves", "failed", "learned", "refits")
                )
                seconds = work["solve_seconds"], work["fit_seconds"]
                found.append(FallbackDone(law, load, solves, failed, learned, refits, *seconds))
    return tuple(found)


def _closure_error(config: RunConfig, reference: CellReference, dataset: Dataset) -> ClosureError | None:
    """Of the run's closure on the stable states; None from a cell solver that gives no stress."""
    solved = np.flatnonzero(dataset.responses().stable)
    exact = dataset.responses()[solved]
    if exact.stress is None or exact.fluid_volume is None:
        return None
    # It is about stress and storage; the flux has no part in it, and not all states have its conductivity.
    closure = reference.closure(config.closure, config.cell.solid, "piola")
    return closure_error(closure, dataset.states()[solved], exact)


def output_checks(dataset: Dataset, held_out: Dataset, surrogate: Surrogate) -> tuple[OutputCheck, ...]:
    """The surrogate against the solved held-out states, for each component of what it predicts that varies."""
    trained, tested = dataset.responses(), held_out.responses()
    training = trained.stable
    solved = np.flatnonzero(tested.stable)
    states = held_out.states()[solved]
    predicted = prediction_of(surrogate, states, tangent=False)
    outside = SampledRange.around(dataset.inputs, dataset.x()[training]).outside(states)
    checks = []
    for field, at, name, plain in _outputs():
        every, exact, guess = (getattr(response, field) for response in (trained, tested, predicted))
        if every is None or exact is None or guess is None:
            continue
        # Of the deformed pore's conductivity some states have none, and its scale is that of the viscosity.
        taught, found = every[training][at], exact[solved][at]
        taught, known = taught[np.isfinite(taught)], np.isfinite(found)
        span = float(np.ptp(taught)) if len(taught) else 0.0
        flat = FLAT * (float(np.nanmax(np.abs(every[training]))) if field == "conductivity" else 1.0)
        if span >= flat and known.any():
            checks.append(OutputCheck(name, plain, found[known], guess[at][known], span, outside[known]))
    return tuple(checks)


def _outputs() -> Iterator[tuple[str, Any, str, str]]:
    """Field of the response, which component of it, and its name in mathematics and in plain text."""
    for field, name, plain in (
        ("mean_grad", r"\langle\nabla_Y u^1\rangle", "⟨∇u¹⟩"),
        ("stress", "P_E", "P_E"),
    ):
        for i in range(3):
            for j in range(3):
                indices = f"{i + 1}{j + 1}"
                mathematics = f"${name}_{{{indices}}}$" if field == "mean_grad" else f"$P_{{E,{indices}}}$"
                comma = "," if field == "stress" else ""
                digits = indices if field == "stress" else f"{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}"
                yield field, (slice(None), i, j), mathematics, f"{plain}{comma}{digits}"
    yield "fluid_volume", slice(None), r"$\varphi$", "fluid volume φ"
    for i in range(3):
        for j in range(i, 3):
            plain = f"K{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}"
            yield "conductivity", (slice(None), i, j), f"$K_{{{i + 1}{j + 1}}}$", plain


def _cell_summary(
    config: RunConfig, reference: CellReference, coefficients: LinearCoefficients
) -> CellSummary:
    geometry, material = config.cell.geometry, config.cell.solid
    solid = config.cell.make_mesh("solid", "whole")
    benchmark_like = (
        isinstance(geometry, OrthogonalChannels)
        and geometry.axes == "xyz"
        and abs(geometry.radius - 0.25) < 1e-12
    )
    return CellSummary(
        description=f"{geometry.description}; {material.description}",
        porosity=reference.porosity,
        viscosity=config.cell.viscosity,
        linear=coefficients,
        mesh=reference.mesh,
        surface=(solid.points, solid.cells),
        crease=(-0.15, -0.33) if benchmark_like and material == NeoHookean(poisson_ratio=0.35) else None,
        law=config.conductivity,
    )


def flagged_place(solution: MacroSolution, surrogate: Surrogate) -> str:
    """Return where and when in a body most of an element is flagged, and which component is at fault.

    Of elements alike it is the first at the latest kept time; empty where no kept time shows one.
    """
    shares = [float(profile.outside_training_range.max(initial=0.0)) for profile in solution.profiles]
    if not max(shares, default=0.0) > 0:
        return ""
    profile = solution.profiles[len(shares) - 1 - int(np.argmax(shares[::-1]))]
    element = int(np.argmax(profile.outside_training_range))
    place = ", ".join(f"{x:.3g}" for x in solution.points[solution.cells[element]].mean(axis=0))
    state = MacroState(profile.grad_u[[element]], profile.element_p[[element]])
    (why,) = surrogate.reasons(state)
    return f"So it is around ({place}) at t = {profile.time:.3g}{why and ': ' + why}."


def _is_the_benchmark(config: RunConfig) -> bool:
    """The paper's cell and column, whichever of the two radii."""
    macro, geometry = config.macro, config.cell.geometry
    return (
        isinstance(geometry, OrthogonalChannels)
        and geometry.axes == "xyz"
        and geometry.radius in (0.2, 0.25)
        and isinstance(macro.body, Box)
        and macro.body.size == (0.1, 7.5, 0.1)
        and -0.2 in macro.loads
    )


def _training_curve(folder: RunFolder, config: RunConfig) -> TrainingCurve | None:
    table = read_training_curve(folder.training_curve_of(config))
    return None if table is None else TrainingCurve(table[:, 0], table[:, 1], table[:, 2])


def _counts(status: Any) -> dict[str, int]:
    return {s.name: int((status == s).sum()) for s in Status if (status == s).any()}
