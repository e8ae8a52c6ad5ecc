"""Report page of a calibration (write_report): one self-contained HTML file, its rows and sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from porocore.commands.calibration.contents import CalibrationContents
from porocore.commands.calibration.derived import DerivedCell
from porocore.commands.calibration.figures import (
    correlation_figure,
    field_figure,
    fit_figure,
    plane_figure,
    posterior_figure,
    profile_figure,
)
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.posterior import Posterior
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.profiles import ConfidenceInterval, IntervalEnd
from porocore.commands.calibration.suggestions import Suggestion
from porocore.core.echo import joined
from porocore.core.files.atomic import atomic_path
from porocore.core.units import pretty
from porocore.report.format import NONE, number, percent
from porocore.report.page import Picture, Pictures, environment

#: Suggestions that are shown.
MOST_SUGGESTIONS = 5


@dataclass(frozen=True)
class UnknownRow:
    """Row of an unknown in the table of results.

    Attributes
    ----------
    name, unit, value, truth
        As text.
    interval, prior_interval
        95 % intervals without and with priors.
    identifiable
        By the rule.
    reasons
        Why ends are none.
    """

    name: str
    unit: str
    value: str
    truth: str
    interval: str
    prior_interval: str
    identifiable: bool
    reasons: tuple[str, ...]


def unknown_rows(inference: Inference, truth: list[float] | None) -> Iterator[UnknownRow]:
    """Yield a row for each unknown."""
    for i, one in enumerate(inference.unknowns):
        alone, both = inference.data_intervals[i], inference.intervals[i]
        yield UnknownRow(
            one.name,
            pretty(one.unit) or NONE,
            number(float(inference.values[i])),
            "" if truth is None else number(truth[i]),
            interval_text(alone),
            "" if both is alone else interval_text(both),
            inference.identifiable[i],
            tuple(end_reasons(alone.low, alone.high)),
        )


def derived_rows(cell: DerivedCell) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield name, unit, value, 95 % interval and why ends of it are none, of each derived number."""
    for each in cell.numbers:
        reasons = "; ".join(end_reasons(each.low, each.high))
        yield each.words, each.unit or NONE, number(each.value), ends_text(each.interval), reasons


def underived_sentence(contents: CalibrationContents) -> str:
    """Return why some experiments have no derived results; empty where all have some, or the plan is not known."""
    names = [] if contents.plan is None else [each.name for each in contents.plan.experiments]
    missing = [name for name in names if not any(name in cell.experiments for cell in contents.derived)]
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
    told = []
    if one.prior is not None and one.scale == "log":
        told.append(
            f"median {number(one.value(one.prior.mean))}, deviation {number(one.prior.deviation)} of ln x"
        )
    elif one.prior is not None:
        told.append(f"{number(one.prior.mean)} ± {number(one.prior.deviation)}")
    if one.smoothing is not None:
        told.append(f"difference from the value before: deviation {number(one.smoothing)}")
    return "; ".join(told) or NONE


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


def provenance_rows(contents: CalibrationContents) -> Iterator[tuple[str, str]]:
    """Yield backends, cells and settings of the fit, and versions."""
    plan = contents.plan
    if plan is not None:
        for experiment in plan.experiments:
            config, of = experiment.config, f", {experiment.name}" if experiment.name else ""
            backends = f"cell {config.fem.backend}, surrogate {config.surrogate.backend}, body {config.macro_backend}"
            yield f"backends{of}", f"{backends}; closure {config.closure}; load {number(experiment.load)}"
            yield f"identity of the cells{of}", config.stages.training
        yield "fit", ", ".join(f"{name} {value}" for name, value in plan.fit.model_dump().items())
    yield from contents.versions.items()


def posterior_rows(posterior: Posterior) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, unit, median and 95 % credible interval of each unknown."""
    for one, median, ends in zip(posterior.unknowns, posterior.medians, posterior.intervals, strict=True):
        interval = " … ".join(number(end) for end in ends)
        yield one.name, pretty(one.unit) or NONE, number(float(median)), interval


def interval_text(interval: ConfidenceInterval) -> str:
    """Return an interval such as ``1.2 … 1.4``; a dash for an end that is none."""
    return ends_text(interval.values)


def ends_text(ends: tuple[float | None, float | None]) -> str:
    """Return both ends; a dash for one that is none."""
    return " … ".join(number(value) for value in ends)


def end_reasons(low: IntervalEnd, high: IntervalEnd) -> Iterator[str]:
    """Yield why ends of an interval are none."""
    if low.value is None and high.value is None and low.reason == high.reason:
        yield f"no ends: {low.reason}"
        return
    for name, end in (("lower", low), ("upper", high)):
        if end.value is None:
            yield f"no {name} end: {end.reason}"


def seen_sentence(inference: Inference) -> str:
    """Return how many combinations of the unknowns are identifiable, in words."""
    unseen, all_ = len(inference.directions), len(inference.unknowns)
    if not unseen:
        return (
            "All combinations of the unknowns are identifiable: one standard deviation along any direction moves no "
            "unknown beyond its limit of identifiability."
        )
    if unseen == all_:
        return "No combination of the unknowns is identifiable:"
    are = "combination of the unknowns is" if unseen == 1 else "combinations of the unknowns are"
    return f"{_counted(unseen)} {are} non-identifiable, {all_ - unseen} of {all_} are identifiable:"


def _counted(count: int) -> str:
    return {1: "One", 2: "Two", 3: "Three", 4: "Four"}.get(count, str(count))


def helpful(inference: Inference) -> list[Suggestion]:
    """Return the further data that are worth a row."""
    return [each for each in inference.suggestions if each.helps][:MOST_SUGGESTIONS]


def gain_text(suggestion: Suggestion) -> str:
    """Return the gain of further data in words."""
    gain, before = suggestion.gain, suggestion.unseen_before
    if suggestion.separates:
        if not suggestion.unseen:
            return "makes all combinations identifiable"
        return f"makes {before - suggestion.unseen} of {before} non-identifiable combinations identifiable"
    text = f"{gain:.3g} times as precise along the least identifiable direction"
    return f"{text}, which stays non-identifiable" if before else text


#: Of the page, and of the folder of its figures, in the folder of a calibration.
PAGE, FIGURES = "report.html", "figures"


def write_report(
    folder: Path, contents: CalibrationContents, tell: Callable[[str], None] = lambda name: None
) -> Path:
    """Write ``report.html`` into a folder and its figures into ``figures``, and return the page's path.

    Parameters
    ----------
    folder
        Of the calibration; it exists.
    contents
        What is shown.
    tell
        Called with the name of each figure before it is drawn.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    (folder / FIGURES).mkdir(exist_ok=True)
    html = render(contents, Pictures(folder / FIGURES, tell))
    with atomic_path(folder / PAGE) as part:
        part.write_text(html, encoding="utf-8")
    return folder / PAGE


def render(contents: CalibrationContents, pictures: Pictures | None = None) -> str:
    """Return the page as text; ``pictures`` may keep the figures as files."""
    pictures = pictures or Pictures()
    inference, truth = contents.inference, contents.truth
    several = len(inference.unknowns) > 1
    profiles = pictures.svg(
        "profiles", profile_figure(inference, truth), "Profile likelihood of each unknown"
    )
    return (
        environment("porocore.commands.calibration")
        .get_template("calibration.html.j2")
        .render(
            contents=contents,
            inference=inference,
            rows=list(unknown_rows(inference, None if truth is None else truth.tolist())),
            seen=seen_sentence(inference),
            suggestions=[(each.name, gain_text(each)) for each in helpful(inference)],
            separable=any(each.separates for each in inference.suggestions)
            or all(each.exact for each in inference.directions),
            derived=[(each.title, list(derived_rows(each))) for each in contents.derived],
            underived=underived_sentence(contents),
            searched=[] if contents.plan is None else list(search_rows(contents.plan)),
            data=[] if contents.plan is None else list(data_rows(contents.plan)),
            provenance=list(provenance_rows(contents)),
            fits=_fits(contents, pictures),
            fields=_fields(contents, pictures),
            posterior_rows=[] if contents.posterior is None else list(posterior_rows(contents.posterior)),
            posterior_picture=_posterior(contents, pictures),
            profiles=profiles,
            plane=None
            if inference.plane is None
            else pictures.svg("plane", plane_figure(inference, truth), "Plane of two unknowns"),
            correlations=pictures.svg("correlations", correlation_figure(inference), "Correlations")
            if several
            else None,
        )
    )


def _posterior(contents: CalibrationContents, pictures: Pictures) -> Picture | None:
    if contents.posterior is None:
        return None
    figure = posterior_figure(contents.posterior, contents.inference.values, contents.truth)
    return pictures.svg("posterior", figure, "Posterior distribution of the unknowns")


def _fields(contents: CalibrationContents, pictures: Pictures) -> list[Picture]:
    return [
        pictures.svg(f"field_{each.name}", field_figure(contents, each), f"Field of {each.name}")
        for each in contents.fields
    ]


def _fits(contents: CalibrationContents, pictures: Pictures) -> list[tuple[str, Picture]]:
    names = contents.data.names
    return [
        (name, pictures.svg(f"fit_{name}", fit_figure(contents, c), f"Fit of {name}"))
        for c, name in enumerate(names)
    ]
