"""Report page of a run: one self-contained HTML file with its sections and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from porocore.core.files.atomic import write_text
from porocore.core.parallel.calls import CallProcesses
from porocore.core.units import units_now, using_units
from porocore.interfaces.solution import words_of
from porocore.report import figures
from porocore.report.context import (
    COMPARED,
    ReportContext,
    SurrogateSummary,
    contacts,
    end_words,
    law_differences,
    no_relaxation,
    reactions,
)
from porocore.report.dimensional import dimensional_rows
from porocore.report.figures.body import body_fields
from porocore.report.figures.cell import over_parameters
from porocore.report.figures.curves import (
    Panel,
    chosen_times,
    end_of_rise,
    field_of,
    is_column,
    panels,
    profile_at,
)
from porocore.report.figures.memory import course_figure, profile_field
from porocore.report.format import plain, unit
from porocore.report.metrics import LoadCase, case_metrics
from porocore.report.page import Picture, Pictures, environment
from porocore.report.text import (
    FOLLOWER,
    all_warnings,
    benchmark_rows,
    flagged_around,
    force_sentences,
    indenter_sentences,
    status_rows,
    whole_words,
)
from porocore.report.words.cell import cell_rows, conductivity_sentence, linear_rows, mesh_rows
from porocore.report.words.held_out import (
    few_in_body,
    rms_percent,
    rms_percent_in_body,
    worst_percent,
    worst_percent_in_body,
)
from porocore.report.words.memory import memory_sentences, memory_tables
from porocore.report.words.parameters import parameter_rows, region_rows
from porocore.report.words.results import (
    case_sentences,
    settling_or_heaving,
    solved_sentence,
    solved_shares,
    visited_sentence,
    visited_shares,
)

#: Pictures that stand in the page alone.
EMBEDDED = Pictures()
#: Profiles shown for each load, in order.
PROFILES = ("p", "settlement", "H22", "mean_grad_22", "mean_grad_11", "K22", "K11")


def write_report(
    path: Path,
    context: ReportContext,
    figures_folder: Path | None = None,
    tell: Callable[[str], None] = lambda name: None,
    processes: CallProcesses | None = None,
) -> None:
    """Write the page to ``path``, atomically: figures are embedded, nothing is fetched, nothing is executed.

    Parameters
    ----------
    path, context
        Of the page, and what it shows.
    figures_folder, tell, processes
        Where each figure is kept as PNG and SVG, who is given its name, and who draws it; see :class:`Pictures`.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    html = render(context, Pictures(figures_folder, tell, processes))
    write_text(path, html)


def render(context: ReportContext, pictures: Pictures = EMBEDDED) -> str:
    """Return the page as text, in the units of the study; ``pictures`` may keep the figures as files."""
    with using_units(context.units):
        return _rendered(context, pictures)


def _rendered(context: ReportContext, pictures: Pictures) -> str:
    template = environment().get_template("template.html.j2")
    metrics = [case_metrics(case) for case in context.cases]
    published, units, moved = context.published, context.result_units, context.loading_mode.displaced
    K, which = context.cell.linear.conductivity, f" {context.cell.which}".rstrip()
    which += ", rest of the body" if context.parts else ""
    benchmark = next((m for m in metrics if published is not None and m["load"] == published.load), None)
    return template.render(
        context=context,
        warnings=all_warnings(context),
        metrics=metrics,
        linear_shown=any(case.linear is not None for case in context.cases),
        sentences=[
            [
                *flagged_around(
                    [
                        *force_sentences(case, moved),
                        *indenter_sentences(case),
                        *case_sentences(m, context.loading_mode.settles),
                        *memory_sentences(context.memory_of(case.nonlinear)),
                        *((FOLLOWER,) if context.loading_mode.follows else ()),
                    ],
                    m,
                    case.left_out,
                ),
                *(
                    each.said_of_cell(
                        visited_sentence(visited_shares(each.cases[i].nonlinear, each.sampling))
                    )
                    for each in context.of_each_cell
                ),
            ]
            for i, (m, case) in enumerate(zip(metrics, context.cases, strict=True))
        ],
        benchmark=[] if published is None or benchmark is None else benchmark_rows(published, benchmark),
        dimensional=[
            dimensional_rows(m, case.nonlinear, K, units, context.loading_mode, which)
            for m, case in zip(metrics, context.cases, strict=True)
            if units
        ],
        forces=[_forces(case, moved) for case in context.cases if moved or case.nonlinear.contact],
        indenters=[_indenters(case) for case in context.cases],
        **_body_parts(context, pictures),
        cells=[_cell_parts(each, pictures) for each in context.of_each_cell],
        settles=context.loading_mode.settles,
        **settling_or_heaving(metrics, context.loading_mode.settles),
        end_words=end_words,
        no_relaxation=no_relaxation,
        whole=whole_words(context.cases[0].nonlinear.copies),
        force_unit=unit("force"),
        time_unit=unit("time"),
        differences=[law_differences(case) for case in context.cases],
        compared={name: words_of(context.cases[0].nonlinear, words) for name, words in COMPARED.items()},
        cases=[_case_pictures(case, context, pictures) for case in context.cases],
        memories=[_memory(case, context, pictures) for case in context.cases],
        total_seconds=sum(stage.seconds for stage in context.stages),
        saved_seconds=sum(stage.saved for stage in context.stages),
    )


def _body_parts(context: ReportContext, pictures: Pictures) -> dict[str, Any]:
    """Return what the page shows of the cells of the body."""
    body = context.body
    return {
        "conductivity": [conductivity_sentence(case, context.cell, body) for case in context.cases],
        "region_table": None if body is None else region_rows(body),
        "body_fields": [] if body is None else body_fields(context.cases[0].nonlinear, body, pictures),
    }


def _cell_parts(context: ReportContext, pictures: Pictures) -> dict[str, Any]:
    """Return what the page shows of one cell: undeformed, over its parameters, its samples and its surrogates."""
    cell, family, sampling = context.cell, context.family, context.sampling
    used = {} if context.body is None else context.body.used()
    if context.name:
        pictures = replace(pictures, suffix=f"_{context.name}")
    return {
        "context": context,
        "at": f"-{context.name}" if context.name else "",
        "of": f", {context.of}" if context.of else "",
        "rows": cell_rows(cell, context.published),
        "linear_rows": linear_rows(cell.properties),
        "mesh_rows": mesh_rows(cell.mesh),
        "picture": _cell_picture(context, pictures),
        "histogram": _histogram(context, pictures),
        "parameter_rows": [] if family is None else parameter_rows(family, used),
        "over_parameters": [] if family is None else over_parameters(context, family, pictures),
        "spent_on_body": bool(sampling.inputs.used),
        "statuses": status_rows(sampling),
        "solved": solved_sentence(solved_shares(sampling)),
        "training_states": int(sampling.training.sum()),
        "samples": pictures.svg(
            "samples", figures.samples_of(context), "Sampled states by how their solution ended"
        ),
        "surrogates": [
            _surrogate_parts(surrogate, pictures)
            for surrogate in (context.surrogate, *context.other_surrogates)
        ],
    }


def _forces(case: LoadCase, moved: Sequence[str]) -> list[tuple[str, str, dict[str, Any]]]:
    """Return law, surface and its :func:`reactions`, surface by surface, those that are moved first."""
    solutions = (case.nonlinear, *case.compared)
    names = [each.law for each in solutions] if case.others else ["nonlinear", "linear"]
    by_law = {law: reactions(each) for law, each in zip(names, solutions, strict=False)}
    surfaces = dict.fromkeys((*moved, *(name for found in by_law.values() for name in found)))
    return [(law, name, found[name]) for name in surfaces for law, found in by_law.items() if name in found]


def _indenters(case: LoadCase) -> list[tuple[str, str, dict[str, Any]]]:
    """Return law, name and :func:`contacts` of each indenter."""
    solutions = (case.nonlinear, *case.compared)
    names = [each.law for each in solutions] if case.others else ["nonlinear", "linear"]
    return [
        (law, name, found)
        for law, each in zip(names, solutions, strict=False)
        for name, found in contacts(each).items()
    ]


def _cell_picture(context: ReportContext, pictures: Pictures) -> Picture | None:
    """Return the picture of the cell, as a PNG image, which is smaller than SVG with so many triangles."""
    if context.cell.surface is None:
        return None
    return pictures.png("cell", figures.cell_picture(*context.cell.surface), "The solid of the cell")


def _histogram(context: ReportContext, pictures: Pictures) -> Picture | None:
    """Return the picture of the grey values of an image."""
    if context.cell.parting is None:
        return None
    return pictures.svg(
        "grey-values",
        figures.histogram_figure(context.cell.parting),
        "Voxels of the whole file by their grey value, with the threshold",
    )


def _surrogate_parts(surrogate: SurrogateSummary, pictures: Pictures) -> dict[str, Any]:
    """Return a surrogate's accuracy and its pictures."""
    closure = surrogate.closure
    return {
        "summary": surrogate,
        "outputs": [
            {
                "check": check,
                "counted": int(check.counted.sum()),
                "rms": rms_percent(check),
                "worst": worst_percent(check),
                "rms_in_body": rms_percent_in_body(check),
                "worst_in_body": worst_percent_in_body(check),
            }
            for check in surrogate.outputs
        ],
        "few_in_body": few_in_body(surrogate.outputs),
        "parity": [
            pictures.svg(
                f"{closure}_predicted_{check.plain.replace('⟨∇u¹⟩', 'mean_grad_')}",
                figures.parity_figure([check]),
                f"Predicted against solved {check.plain}",
            )
            for check in surrogate.outputs
        ],
        "training": (
            pictures.svg(
                f"{closure}_training",
                figures.training_figure(surrogate.curve),
                "Training and validation loss" if surrogate.curve.validated else "Training loss",
            )
            if surrogate.curve is not None
            else None
        ),
    }


def _case_pictures(case: LoadCase, context: ReportContext, pictures: Pictures) -> dict[str, list[Picture]]:
    """Return profiles along the axis of a column, pictures of any other body."""
    mode = context.loading_mode
    load, under, settles = plain(case.load), f"load{case.load!r}", mode.settles
    histories = [
        pictures.svg(
            f"history{'_log' if log_time else ''}_{under}",
            figures.history_figure(
                case.nonlinear,
                case.linear,
                *case.others,
                log_time=log_time,
                settles=settles,
                published=context.published is not None,
            ),
            f"{'Settlement or heave, pressure' if settles else 'Pressure'} and drained volume against "
            f"{'logarithmic ' if log_time else ''}time, load {load}",
        )
        for log_time in (False, True)
    ]
    column = is_column(case.nonlinear)
    shown = list(panels(case.nonlinear)) if case.nonlinear.probes or mode.moves or not column else []
    if not settles:
        shown.sort(key=lambda panel: panel.quantity != "force")  # what a testing machine shows comes first
    series = [each for panel in shown for each in _series(panel, case, pictures)]
    if case.nonlinear.contact:
        drawn = figures.indentation_figure(case.nonlinear, case.linear)
        text = f"force of indenters against their displacement, load {load}"
        series.insert(0, pictures.svg(f"force-and-displacement_{under}", drawn, text))
    found: dict[str, list[Picture]] = {"histories": histories, "series": series, "bodies": [], "profiles": []}
    if case.nonlinear.profiles:
        found["profiles" if column else "bodies"] = (
            _column_pictures(case, pictures) if column else _body_pictures(case, context, pictures)
        )
    return found


def _memory(case: LoadCase, context: ReportContext, pictures: Pictures) -> dict[str, Any]:
    """Return tables of what the law remembered, and its fields over time and along a column."""
    memory, under, load = context.memory_of(case.nonlinear), f"load{case.load!r}", plain(case.load)
    tables = memory_tables(memory)
    if not tables:
        return {"tables": {}, "pictures": []}
    drawn = []
    for name, course in memory.courses().items():
        drawn.append(
            pictures.svg(
                f"{name}_{under}", course_figure(memory, course), f"{course.plain} against time, load {load}"
            )
        )
        if is_column(case.nonlinear):
            what = profile_field(case.nonlinear, course)
            drawn.append(
                pictures.svg(
                    f"profile_{name}_{under}",
                    figures.profile_figure(case.nonlinear, None, what),
                    f"{course.plain} along the column, load {load}",
                )
            )
    return {"tables": tables, "pictures": drawn}


def _series(panel: Panel, case: LoadCase, pictures: Pictures) -> Iterator[Picture]:
    """Yield the picture of a panel against time, and of forces that relax against the time from their peak."""
    load, under = plain(case.load), f"load{case.load!r}"
    drawn = (case.nonlinear, case.linear, panel.plain)
    yield pictures.svg(f"{panel.plain}_{under}", figures.series_figure(*drawn), f"{panel.plain}, load {load}")
    if panel.quantity == "force" and end_of_rise(case.nonlinear, panel) is not None:
        yield pictures.svg(
            f"{panel.plain}-from-the-peak_{under}",
            figures.relaxation_figure(*drawn),
            f"{panel.plain} from their peak, time logarithmic, load {load}",
        )


def _body_pictures(case: LoadCase, context: ReportContext, pictures: Pictures) -> list[Picture]:
    found, pressure = [], case.nonlinear.pressure
    for time in chosen_times(case.nonlinear):
        when, profile = units_now().text(time, "time", 6), profile_at(case.nonlinear, time)
        if case.nonlinear.revolved:
            found.append(
                pictures.png(
                    f"meridian_t={when}_load{case.load!r}",
                    figures.plane_figure(case.nonlinear, profile, context.indenters),
                    f"The deformed meridian at t = {when}, coloured by its {pressure}, load {plain(case.load)}",
                )
            )
        found.append(
            pictures.png(
                f"body_t={when}_load{case.load!r}",
                figures.body_figure(case.nonlinear, profile, context.indenters),
                f"The deformed body at t = {when}, coloured by its {pressure}, load {plain(case.load)}",
            )
        )
    return found


def _column_pictures(case: LoadCase, pictures: Pictures) -> list[Picture]:
    times = ", ".join(units_now().text(time, "time", 6) for time in chosen_times(case.nonlinear))
    return [
        pictures.svg(
            f"profile_{quantity}_load{case.load!r}",
            figures.profile_figure(case.nonlinear, case.linear, quantity),
            f"{field_of(case.nonlinear, quantity).plain} along the column at t = {times}, load {plain(case.load)}",
        )
        for quantity in PROFILES
    ]
