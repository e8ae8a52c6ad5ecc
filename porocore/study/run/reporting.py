"""The report stage: metrics.json with its figures of merit, histories, ParaView files, the page.

Every report writes all of them. A run that is resumed keeps them while the files of its folder are the same.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.family.family import parameter_quantities
from porocore.core.console import Console
from porocore.core.files.atomic import write_text
from porocore.core.files.plain_data import write_json
from porocore.core.parallel.calls import CallProcesses
from porocore.core.units import using_units
from porocore.interfaces.solution import MacroSolution, write_series
from porocore.macro.boundary.drainage import diffusion_time
from porocore.macro.linear_systems import work_figures
from porocore.report.context import ReportContext, SurrogateSummary, contacts, law_differences, reactions
from porocore.report.dimensional import dimensional_metrics, figures_with_units
from porocore.report.metrics import REMNANT, LoadCase, case_metrics, without_settlement
from porocore.report.text import all_warnings
from porocore.report.words.held_out import (
    rms_percent,
    rms_percent_in_body,
    worst_percent,
    worst_percent_in_body,
)
from porocore.report.words.memory import figures_in_units
from porocore.report.words.parameters import family_figures, group_errors
from porocore.report.words.results import solved_shares, visited_shares
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Status
from porocore.study.config.config import RunConfig, with_closure
from porocore.study.run.composition import held_out_states
from porocore.study.run.folder import FinishedRun, RunFolder, timed
from porocore.study.run.results import RunResults, finished, times_of_all_cells
from porocore.study.run.summary import rest_of_body


def report(folder: RunFolder, *, console: Console, processes: CallProcesses | None = None) -> Path:
    """Write metrics.json, histories as tables, files for ParaView, figures and the page; return the page's path.

    The report shows the closure that the run began with, and solutions of other laws beside it. Processes that work
    already draw its figures.
    """
    from porocore.report.html import write_report
    from porocore.report.page import load_elsewhere
    from porocore.study.run.summary import report_context

    stages = folder.config.stages
    samples = Dataset.open(folder.dataset, identity=stages.sampling)
    finished(folder, folder.test_dataset, stages.test, held_out_states(folder.config, samples))
    config = _shown(folder)
    folder = folder.with_config(config)
    with (
        using_units(config.result_units),
        timed(folder.timings, "report"),
        console.task("report", "parts") as task,
    ):

        def show(done: int, detail: str = "") -> None:
            task.update(done, 3, detail=detail, seconds=0.0)  # parts tell nothing about each other's times

        drawing = processes if processes is not None and processes.started else None
        if drawing is not None:
            for _ in range(drawing.count):
                drawing.submit("while it loaded libraries", load_elsewhere)
        show(0, "reading the results")
        results = RunResults.load(folder)
        for solution in results.all_solutions:
            show(0, f"files for ParaView, {solution.law}")
            _write_solution(folder, solution)
        show(1, "figures of merit")
        context = report_context(results)
        metrics = figures_of_merit(results, context)
        write_report(
            folder.report,
            context,
            folder.figures,
            lambda name: show(2, f"figure {name}"),
            drawing,
        )
        show(3)
        warnings = tuple(all_warnings(context))
    for warning in warnings:
        console.warn(warning)
    times = times_of_all_cells(folder)
    metrics["stages"] = {stage: each.seconds for stage, each in times.items()}
    metrics["stage_runs"] = {stage: each.runs for stage, each in times.items()}
    write_json(folder.metrics, metrics, indent=2, allow_nan=False)
    FinishedRun(config.title, context.title, config.resolved_yaml(), warnings).keep(folder.path)
    return folder.report


def _write_solution(folder: RunFolder, solution: MacroSolution) -> None:
    """Write the history of a solution as a table, and its profiles as files for ParaView."""
    from porocore.report.vtk import write_vtu_series

    law, load, units = solution.law, solution.load, folder.config.result_units
    name, quantities = folder.solution(law, load).stem, parameter_quantities(folder.config.cell)
    write_vtu_series(folder.fields, name, solution, units, quantities)
    write_series(folder.history(law, load), solution, units)


def kept_report(folder: RunFolder, *, console: Console) -> bool:
    """Return whether the report is of the present files and settings; a changed title is written into the page."""
    from porocore.report.page import retitled

    found = FinishedRun.find(folder.path)
    shown = _shown(folder)
    if found is None or not folder.report.is_file():
        return False
    if shown.model_copy(update={"title": found.title}).resolved_yaml() != found.configuration:
        return False
    heading, text = shown.title or folder.path.name, shown.resolved_yaml()
    if (heading, text) != (found.heading, found.configuration):
        page = folder.report.read_text(encoding="utf-8")
        page_now = retitled(page, (found.heading, heading), (found.configuration, text))
        if page_now is None:
            return False
        write_text(folder.report, page_now)
        replace(found, title=shown.title, heading=heading, configuration=text).keep(folder.path)
    for warning in found.warnings:
        console.warn(warning)
    return True


def _shown(folder: RunFolder) -> RunConfig:
    """Return the run with the closure that is shown, and what may be otherwise where it continues."""
    shown = with_closure(folder.written, folder.shown_closure)
    return shown.model_copy(
        update={
            name: getattr(folder.config, name) for name in ("title", "scales", "output_units", "scenarios")
        }
    )


#: Sections of the body whose figures have units.
WITH_UNITS = ("macro", "reactions", "contact")


def figures_of_merit(results: RunResults, context: ReportContext) -> dict[str, Any]:
    """Return what ``metrics.json`` holds, apart from the times of the stages."""
    limit = diffusion_time(results.config.macro, rest_of_body(results))
    (first, *others), cells = context.of_each_cell, results.by_cell
    found: dict[str, Any] = {
        "warnings": all_warnings(context),
        **_of_cell(cells[None], first),
        "macro": [
            {
                **_of_case(case, context.loading_mode.settles),
                "mesh_diffusion_time": limit,
                "gaps": law_differences(case),
                "cell_states": visited_shares(part.nonlinear, first.sampling),
                **_memory(case, context),
            }
            for case, part in zip(context.cases, first.cases, strict=True)
        ],
    }
    if context.loading_mode.displaced:
        found["reactions"] = [
            {"law": each.law, "load": each.load, "surfaces": reactions(each)}
            for each in results.all_solutions
        ]
    if results.config.macro.contact:
        found["contact"] = [
            {"law": each.law, "load": each.load, "indenters": contacts(each)}
            for each in results.all_solutions
        ]
    if context.units.given:
        found |= {
            name: figures_with_units(found[name], context.units) for name in WITH_UNITS if name in found
        }
        found["dimensional"] = dimensional_metrics(results.all_solutions, context.units)
    if worked := [each for each in results.all_solutions if each.work]:
        found["linear_systems"] = [work_figures(each) for each in worked]
    if others:
        found["cells"] = {
            each.name: _of_cell(cells[each.name], each)
            | {"cell_states": [visited_shares(case.nonlinear, each.sampling) for case in each.cases]}
            for each in others
        }
    if context.fallbacks:
        found["fallback"] = [asdict(done) for done in context.fallbacks]
    if context.direct:
        found["direct"] = [asdict(cost) | {"speed_up": cost.speed_up} for cost in context.direct]
    return found


def _memory(case: LoadCase, context: ReportContext) -> dict[str, Any]:
    """Return the figures of what the law remembered; nothing of one without a memory."""
    memory = context.memory_of(case.nonlinear)
    found = memory.figures()
    return {"memory": figures_in_units(found, memory, context.units)} if found else {}


def _of_case(case: LoadCase, settles: bool) -> dict[str, Any]:
    """Return the figures of a load; those of the settlement only where it is a result, else why it is none."""
    found = case_metrics(case)
    laws = [law for law in (found["nonlinear"], *found["others"], found["linear"]) if law is not None]
    if settles and any(law["moves_along_y"] for law in laws):
        return found
    left: dict[str, Any] = without_settlement(found)
    reason = f"displacements along y stay below {100 * REMNANT:g} % of the largest displacement"
    return left | {"without_settlement": reason if settles else "the displacement is prescribed"}


def _of_cell(results: RunResults, context: ReportContext) -> dict[str, Any]:
    """Return the figures of one cell, its samples and its surrogates."""
    closure = context.surrogate.closure_error
    found = {
        "cell": figures_with_units(_cell(results), context.units)
        | {"properties": context.cell.properties.in_units(context.units, results.config.cell_length)},
        "sampling": _sampling(results, context),
        "surrogate": _surrogate(context),
        "closure": None if closure is None else closure.for_json(),
    }
    if context.family is not None:
        used = {} if context.body is None else context.body.used()
        errors = group_errors(context.surrogate.outputs)
        found["parameters"] = family_figures(context.family, errors, used)
    if context.other_surrogates:
        found["other_surrogates"] = {each.closure: _errors(each) for each in context.other_surrogates}
    return found


def _cell(results: RunResults) -> dict[str, Any]:
    reference, c = results.reference, results.coefficients
    return {
        "porosity": reference.porosity,
        "conductivity": reference.conductivity.tolist(),
        "permeability": (reference.conductivity * results.config.cell.viscosity).tolist(),
        "M_2222": float(c.mean_grad_grad_u[1, 1, 1, 1]),
        "M_2211": float(c.mean_grad_grad_u[1, 1, 0, 0]),
        "M": (c.mean_grad_grad_u + 0.0).tolist(),
        "Q_11": float(c.mean_grad_p[0, 0]),
        "Q": (c.mean_grad_p + 0.0).tolist(),
        "C_eff_2222": float(c.stiffness[1, 1, 1, 1]),
        "C_eff": c.stiffness.tolist(),
        "biot_coefficient": float(c.biot[1, 1]),
        "biot_tensor": c.biot.tolist(),
        "biot_modulus": c.biot_modulus,
        "consolidation_coefficients": [c.consolidation_coefficient(axis) for axis in range(3)],
    }


def _sampling(results: RunResults, context: ReportContext) -> dict[str, Any]:
    dataset, held_out = results.dataset, results.held_out
    return {
        "states": len(dataset),
        "statuses": _counts(dataset.responses().status),
        "shares": solved_shares(context.sampling),
        "solve_seconds_mean": float(np.mean(dataset.seconds())),
        "held_out_states": len(held_out),
        "held_out_statuses": _counts(held_out.responses().status),
    }


def _surrogate(context: ReportContext) -> dict[str, Any]:
    outputs = context.surrogate.outputs
    return {
        "training_states": context.surrogate.training_states,
        "test_states": int(outputs[0].counted.sum()) if outputs else 0,
        "test_states_beyond_range": bool(outputs) and outputs[0].all_outside,
        **_errors(context.surrogate),
    }


def _errors(summary: SurrogateSummary) -> dict[str, Any]:
    return {
        "rms_error_percent_of_range": {check.plain: rms_percent(check) for check in summary.outputs},
        "largest_error_percent_of_range": {check.plain: worst_percent(check) for check in summary.outputs},
        "rms_error_percent_of_range_in_body": {c.plain: rms_percent_in_body(c) for c in summary.outputs},
        "largest_error_percent_of_range_in_body": {
            c.plain: worst_percent_in_body(c) for c in summary.outputs
        },
    }


def _counts(status: Any) -> dict[str, int]:
    return {s.name: int((status == s).sum()) for s in Status if (status == s).any()}
