"""The report stage: writes metrics.json, histories, ParaView files and the page; keeps a present one.

Every report writes all of them. A run that is resumed keeps them while the files of its folder are the same.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from porocore.cell.family.parameters import parameter_quantities
from porocore.core.console import Console
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_json
from porocore.core.parallel.calls import CallProcesses
from porocore.core.units.results import speaking
from porocore.interfaces.solution import MacroSolution
from porocore.sampling.datasets.dataset import Dataset
from porocore.study.backends import with_closure
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.finished import FinishedRun
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.stage_times import timed
from porocore.study.stages.stage_files import finished, held_out_states


def report(
    folder: RunFolder, config: RunConfig, *, console: Console, processes: CallProcesses | None = None
) -> Path:
    """Write metrics.json, histories as tables, files for ParaView, figures and the page; return the page's path.

    The report shows the closure that the run began with, and solutions of other laws beside it. Processes that work
    already draw its figures.
    """
    from porocore.report.html import write_report
    from porocore.report.page import load_elsewhere
    from porocore.report.text import all_warnings
    from porocore.study.stages.figures_of_merit import figures_of_merit
    from porocore.study.stages.results import RunResults, times_of_all_cells
    from porocore.study.stages.summary import report_context

    samples = Dataset.open(folder.dataset, identity=config.stages.sampling)
    finished(folder, folder.test_dataset, config.stages.test, held_out_states(config, samples))
    config = _shown(folder, config)
    with (
        speaking(config.result_units),
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
        results = RunResults.load(folder, config)
        for solution in results.all_solutions:
            show(0, f"files for ParaView, {solution.law}")
            _write_solution(folder, config, solution)
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
    times = times_of_all_cells(folder, config)
    metrics["stages"] = {stage: each.seconds for stage, each in times.items()}
    metrics["stage_runs"] = {stage: each.runs for stage, each in times.items()}
    write_json(folder.metrics, metrics, indent=2, allow_nan=False)
    FinishedRun(config.title, context.title, config.resolved_yaml(), warnings).keep(folder.path)
    return folder.report


def _write_solution(folder: RunFolder, config: RunConfig, solution: MacroSolution) -> None:
    """Write the history of a solution as a table, and its profiles as files for ParaView."""
    from porocore.macro.series import write_series
    from porocore.report.vtk import write_vtu_series

    law, load, units = solution.law, solution.load, config.result_units
    name, quantities = folder.solution(law, load).stem, parameter_quantities(config.cell)
    write_vtu_series(folder.fields, name, solution, units, quantities)
    write_series(folder.history(law, load), solution, units)


def kept_report(folder: RunFolder, config: RunConfig, *, console: Console) -> bool:
    """Return whether the report is of the present files and settings; a changed title is written into the page."""
    from porocore.report.page import retitled

    found = FinishedRun.find(folder.path)
    shown = _shown(folder, config)
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
        with atomic_path(folder.report) as part:
            part.write_text(page_now, encoding="utf-8")
        replace(found, title=shown.title, heading=heading, configuration=text).keep(folder.path)
    for warning in found.warnings:
        console.warn(warning)
    return True


def _shown(folder: RunFolder, config: RunConfig) -> RunConfig:
    """Return the run with the closure that is shown, and what ``config`` may say otherwise of a run that continues."""
    shown = with_closure(folder.written, folder.shown_closure)
    return shown.model_copy(
        update={name: getattr(config, name) for name in ("title", "scales", "output_units", "scenarios")}
    )
