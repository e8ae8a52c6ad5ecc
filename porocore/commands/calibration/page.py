"""Report page of a calibration (write_report): one self-contained HTML file, its rows and sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from porocore.commands.calibration.clouds import FilmComponent
from porocore.commands.calibration.figures import (
    correlation_figure,
    field_figure,
    film_figure,
    fit_figure,
    plane_figure,
    posterior_figure,
    profile_figure,
)
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.profiles import ConfidenceInterval
from porocore.commands.calibration.results import Calibration
from porocore.commands.calibration.suggestions import Suggestion
from porocore.core.console import duration
from porocore.core.echo import joined
from porocore.core.files.atomic import write_text
from porocore.core.units import pretty
from porocore.report.format import NONE, number, percent
from porocore.report.page import Pictures, environment
from porocore.study.run.folder import versions

#: Suggestions that are shown.
MOST_SUGGESTIONS = 5


def underived_sentence(done: Calibration) -> str:
    """Return why some experiments have no derived results; empty where all have some."""
    names = [each.name for each in done.plan.experiments]
    missing = [name for name in names if not any(name in cell.experiments for cell in done.derived)]
    if not missing:
        return ""
    of = f" of {joined(filter(None, missing))}" if any(missing) else ""
    return (
        f"There are no derived results{of}, such as the aggregate modulus H_A and the permeability: they are those of "
        "one undeformed cell, and in this body cells differ from place to place, by several cells, by regions, or by "
        "fields that are not the fitted ones."
    )


def search_rows(plan: CalibrationPlan) -> Iterator[tuple[str, ...]]:
    """Yield name, number of the study, unit, bounds, first value, scale and prior of each unknown."""
    for each in plan.unknowns:
        one = each.unknown
        numbers = ", ".join(dict.fromkeys(number.name for number in each.numbers.values()))
        bounds = f"{number(one.lower)} … {number(one.upper)}"
        scale = "ln x" if one.scale == "log" else "x"
        yield one.name, numbers, pretty(one.unit) or NONE, bounds, number(one.start), scale, _prior(one)


def _prior(one: Unknown) -> str:
    found = []
    if one.prior is not None and one.scale == "log":
        found.append(
            f"median {number(one.value(one.prior.mean))}, deviation {number(one.prior.deviation)} of ln x"
        )
    elif one.prior is not None:
        found.append(f"{number(one.prior.mean)} ± {number(one.prior.deviation)}")
    if one.smoothing is not None:
        found.append(f"difference from its neighbours: deviation {number(one.smoothing)}")
    return "; ".join(found) or NONE


def data_rows(plan: CalibrationPlan) -> Iterator[tuple[str, ...]]:
    """Yield curve, what was measured, file, rows that count, standard deviations, size and SHA-256 of each curve."""
    for curve in plan.curves:
        file, low, high = curve.file, float(curve.deviations.min()), float(curve.deviations.max())
        spread = number(low) if high - low <= 1e-9 * high else f"{number(low)} … {number(high)}"
        if curve.spread is None and curve.share is not None:
            spread += f" ({percent(curve.share)} of the largest)"
        unit = f" {pretty(curve.unit)}" if curve.unit else ""
        rows = f"{len(curve)} of {file.rows}" if file else f"{len(curve)}"
        size, sha = (f"{file.size:,} bytes", file.sha256) if file else (NONE, NONE)
        yield (
            curve.name,
            curve.series.words,
            file.name if file else "synthetic",
            rows,
            spread + unit,
            size,
            sha,
        )


def provenance_rows(plan: CalibrationPlan) -> Iterator[tuple[str, str]]:
    """Yield backends, cells and settings of the fit, and versions of porocore, its plugins and packages."""
    for experiment in plan.experiments:
        config, of = experiment.config, f", {experiment.name}" if experiment.name else ""
        backends = (
            f"cell {config.fem.backend}, surrogate {config.surrogate.backend}, body {config.macro_backend}"
        )
        yield f"backends{of}", f"{backends}; closure {config.closure}; load {number(experiment.load)}"
        yield f"identity of the cells{of}", config.stages.training
    yield "fit", ", ".join(f"{name} {value}" for name, value in plan.fit.model_dump().items())
    yield from versions().items()


def fact_rows(done: Calibration) -> Iterator[tuple[str, str]]:
    """Yield numbers of values, solves and runs, the quality of the fit, the error of the steps, and the time."""
    yield "Values of all curves", str(len(done.data.values))
    yield "Reduced chi-square", f"{done.quality.reduced:.3g}"
    for name, camera in done.cameras.items():
        offset, turn = (
            ", ".join(f"{value:.4g}" for value in each) for each in (camera.offset, camera.rotation)
        )
        yield (
            f"Place of the camera of {name}, known and fitted parts together",
            f"offset ({offset}) {pretty(camera.unit)}".rstrip() + f", rotation vector ({turn})°",
        )
    error, text = done.inference.systematic, "not known"
    if error is not None:
        text = f"moves the unknowns by {error.size:.2g} standard deviations"
        text += ", which the intervals hold" if error.counted else ""
    yield "Error of the steps in time", text
    yield "Cell solves", str(done.cell_solves)
    yield "Runs of the experiments", str(done.runs)
    yield "Time of the last call", duration(done.seconds)


def ends_text(ends: tuple[float | None, float | None]) -> str:
    """Return both ends, such as ``1.2 … 1.4``; a dash for one that is none."""
    return " … ".join(number(value) for value in ends)


def open_text(interval: ConfidenceInterval) -> str:
    """Return why ends of an interval are none."""
    names, found = {"low": "lower", "high": "upper"}, interval.open_ends
    if len(found) == len(names) and len(set(found.values())) == 1:
        return f"no ends: {interval.low.reason}"
    return "; ".join(f"no {names[side]} end: {reason}" for side, reason in found.items())


def directions_sentence(inference: Inference) -> str:
    """Return how many combinations of the unknowns are identifiable, in words."""
    count, all_ = len(inference.directions), len(inference.unknowns)
    if not count:
        return (
            "All combinations of the unknowns are identifiable: one standard deviation along any direction moves no "
            "unknown beyond its limit of identifiability."
        )
    if count == all_:
        return "No combination of the unknowns is identifiable:"
    are = "combination of the unknowns is" if count == 1 else "combinations of the unknowns are"
    return f"{_counted(count)} {are} non-identifiable, {all_ - count} of {all_} are identifiable:"


def _counted(count: int) -> str:
    return {1: "One", 2: "Two", 3: "Three", 4: "Four"}.get(count, str(count))


def helpful(inference: Inference) -> list[Suggestion]:
    """Return the further data that are worth a row."""
    return [each for each in inference.suggestions if each.helps][:MOST_SUGGESTIONS]


def gain_text(suggestion: Suggestion) -> str:
    """Return the gain of further data in words."""
    gain, before = suggestion.gain, suggestion.non_identifiable_before
    if suggestion.separates:
        if not suggestion.non_identifiable:
            return "makes all combinations identifiable"
        return f"makes {before - suggestion.non_identifiable} of {before} non-identifiable combinations identifiable"
    text = f"{gain:.3g} times as precise along the least identifiable direction"
    return f"{text}, which stays non-identifiable" if before else text


#: Of the page, and of the folder of its figures, in the folder of a calibration.
PAGE, FIGURES = "report.html", "figures"


def write_report(done: Calibration, tell: Callable[[str], None] = lambda name: None) -> Path:
    """Write ``report.html`` into the folder of a calibration and its figures into ``figures``; return the page's path.

    Parameters
    ----------
    done
        What is shown.
    tell
        Called with the name of each figure before it is drawn.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    (done.path / FIGURES).mkdir(exist_ok=True)
    html = render(done, Pictures(done.path / FIGURES, tell))
    write_text(done.path / PAGE, html)
    return done.path / PAGE


def render(done: Calibration, pictures: Pictures | None = None) -> str:
    """Return the page as text; ``pictures`` may keep the figures as files."""
    draw, plan, inference, truth = (pictures or Pictures()).svg, done.plan, done.inference, done.truth
    made = environment("porocore.commands.calibration")
    films = [c for c, curve in enumerate(plan.curves) if isinstance(curve.series, FilmComponent)]
    made.filters |= {"pretty": pretty, "ends": ends_text, "open": open_text}
    profiles = draw("profiles", profile_figure(inference, truth), "Profile likelihood of each unknown")
    return made.get_template("calibration.html.j2").render(
        done=done,
        inference=inference,
        seen=directions_sentence(inference),
        suggestions=[(each.name, gain_text(each)) for each in helpful(inference)],
        separable=any(each.separates for each in inference.suggestions)
        or all(each.exact for each in inference.directions),
        underived=underived_sentence(done),
        facts=list(fact_rows(done)),
        searched=list(search_rows(plan)),
        data=list(data_rows(plan)),
        provenance=list(provenance_rows(plan)),
        fits=[
            (name, draw(f"fit_{name}", fit_figure(done, c), f"Fit of {name}"))
            for c, name in enumerate(done.data.names)
            if c not in films
        ],
        films=[
            (done.data.names[c], draw(f"fit_{done.data.names[c]}", film_figure(done, c), "Fit of a field"))
            for c in films
        ],
        fields=[
            draw(f"field_{each.name}", field_figure(done, each), f"Field of {each.name}")
            for each in plan.fields
        ],
        posterior_picture=None
        if done.posterior is None
        else draw(
            "posterior",
            posterior_figure(done.posterior, inference.values, truth),
            "Posterior distribution of the unknowns",
        ),
        profiles=profiles,
        plane=None
        if inference.plane is None
        else draw("plane", plane_figure(inference, truth), "Plane of two unknowns"),
        correlations=draw("correlations", correlation_figure(inference), "Correlations")
        if len(inference.unknowns) > 1
        else None,
    )
