"""Rows and sentences of the report page of a calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from porocore.calibration.inference.infer import Inference
from porocore.calibration.inference.intervals import ConfidenceInterval
from porocore.calibration.inference.suggestions import Suggestion
from porocore.calibration.posterior.posterior import Posterior
from porocore.core.units.quantities import pretty
from porocore.report.format import NONE, number

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
            tuple(_reasons(alone)),
        )


def posterior_rows(posterior: Posterior) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, unit, median and 95 % credible interval of each unknown."""
    for one, median, ends in zip(posterior.unknowns, posterior.medians, posterior.intervals, strict=True):
        interval = " … ".join(number(end) for end in ends)
        yield one.name, pretty(one.unit) or NONE, number(float(median)), interval


def interval_text(interval: ConfidenceInterval) -> str:
    """Return an interval such as ``1.2 … 1.4``; a dash for an end that is none."""
    return " … ".join(number(value) for value in interval.values)


def _reasons(interval: ConfidenceInterval) -> Iterator[str]:
    low, high = interval.low, interval.high
    if low.value is None and high.value is None and low.reason == high.reason:
        yield f"no ends: {low.reason}"
        return
    for name, end in (("lower", low), ("upper", high)):
        if end.value is None:
            yield f"no {name} end: {end.reason}"


def seen_sentence(inference: Inference) -> str:
    """Return how many directions the data see, in words."""
    unseen, all_ = len(inference.directions), len(inference.unknowns)
    if not unseen:
        return (
            "The data see every combination of the unknowns: one standard deviation along any direction moves no "
            "unknown beyond its limit of identifiability."
        )
    if unseen == all_:
        return "The data see no combination of the unknowns well enough:"
    are = "combination of the unknowns is" if unseen == 1 else "combinations of the unknowns are"
    return f"{_counted(unseen)} {are} not seen, {all_ - unseen} of {all_} are seen:"


def _counted(count: int) -> str:
    return {1: "One", 2: "Two", 3: "Three", 4: "Four"}.get(count, str(count))


def helpful(inference: Inference) -> list[Suggestion]:
    """Return the further data that are worth a row."""
    return [each for each in inference.suggestions if each.helps][:MOST_SUGGESTIONS]


def gain_text(suggestion: Suggestion) -> str:
    """Return the gain of further data in words."""
    gain, before = suggestion.gain, suggestion.unseen_before
    if suggestion.separates:
        left = f"; {suggestion.unseen} of {before} stay unseen" if suggestion.unseen else ""
        return f"makes seen what is not seen{left}"
    text = f"{gain:.3g} times as precise along the least seen direction"
    return f"{text}, which stays unseen" if before else text
