"""The report stage: figures of merit, histories, the files for ParaView and the page.

Nothing is resumed; every report writes all of them.
"""

from __future__ import annotations

from pathlib import Path

from porocore.core.console import Console
from porocore.core.files.plain_data import write_json
from porocore.study.backends import with_closure
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages.stage_files import finished, held_out_states
from porocore.study.stages.stage_times import stage_times, timed


def report(folder: RunFolder, config: RunConfig, *, console: Console) -> Path:
    """Write metrics.json, histories as tables, the files for ParaView and the page; return the page's path.

    The report shows the closure that the run began with, and solutions of other laws beside it.
    """
    from porocore.macro.series import write_series
    from porocore.report.html import write_report
    from porocore.report.text import all_warnings
    from porocore.report.vtk import write_vtu_series
    from porocore.study.stages.figures_of_merit import figures_of_merit
    from porocore.study.stages.results import RunResults
    from porocore.study.stages.summary import report_context

    finished(folder, folder.test_dataset, config.stages.test, held_out_states(config))
    shown = with_closure(folder.written, folder.shown_closure)
    config = shown.model_copy(
        update={name: getattr(config, name) for name in ("title", "scales", "output_units", "scenarios")}
    )
    with timed(folder.timings, "report"):
        results = RunResults.load(folder, config)
        for solution in results.all_solutions:
            law, load = solution.law, solution.load
            write_vtu_series(folder.fields, folder.solution(law, load).stem, solution)
            write_series(folder.history(law, load), solution, config.result_units)
        context = report_context(results)
        metrics = figures_of_merit(results, context)
        write_report(folder.report, context)
    for warning in all_warnings(context):
        console.warn(warning)
    times = stage_times(folder.timings)
    metrics["stages"] = {stage: each.seconds for stage, each in times.items()}
    metrics["stage_runs"] = {stage: each.runs for stage, each in times.items()}
    write_json(folder.metrics, metrics, indent=2, allow_nan=False)
    return folder.report
