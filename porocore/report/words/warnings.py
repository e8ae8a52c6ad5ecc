"""Flagged shares of the body in words, and warnings of load cases."""

from __future__ import annotations

from typing import Any

from porocore.core.units.results import spoken
from porocore.report.format import percent
from porocore.report.metrics import STEADY_TOLERANCE, LeftOut

#: A share of the body that is flagged but is 0.0 % in words is none.
LEAST_FLAGGED = 5e-4


def is_flagged(metrics: dict[str, Any]) -> bool:
    """Return True if a share of the body worth a word is flagged at some time."""
    return bool(metrics["flagged_largest"] >= LEAST_FLAGGED)


def flagged_shares(metrics: dict[str, Any]) -> str:
    """Return the flagged share of the body over time in words."""
    largest, mean, end = (percent(metrics[f"flagged_{name}"]) for name in ("largest", "time_mean", "end"))
    words = (
        f"Over time the flagged share is at most {largest} of the body and on average {mean}; at the end of the run "
        f"it is {end}. The first points are flagged at t = {spoken().text(metrics['flagged_first_time'], 'time', 3)}"
    )
    whole = metrics["flagged_all_time"]
    if whole is None:
        return f"{words}."
    return f"{words}, and the whole body is flagged at t = {spoken().text(whole, 'time', 3)}."


def case_warnings(
    metrics: dict[str, Any], where: str = "", *, settles: bool = True, left_out: LeftOut | None = None
) -> list[str]:
    """Return what a reader must know before trusting the case that :func:`case_metrics` describes.

    ``where`` names a flagged element of the body and the component that causes it, if that is known; ``settles`` tells
    that the settlement is a result; ``left_out`` is the shear that alone flags the body.
    """
    load, found = f"{metrics['load']:g}".replace("-", "−"), []
    flagged = metrics["nonlinear"]
    if is_flagged(flagged) and (left_out is None or not left_out.is_small):
        where = where or (
            "No stored profile shows the place. Add the time "
            f"{spoken().text(flagged['flagged_first_time'], 'time', 3)} to macro.time.profiles."
        )
        found.append(
            f"Load {load}: parts of the body are flagged. There the estimated error of the surrogate exceeds "
            f"surrogate.tolerance, or no cell was solved for a similar state. {flagged_shares(flagged)}"
            f" {where}"
            f"{'' if left_out is None else f' {left_out.name} is the only cause. {left_out.estimate}'}"
        )
    for kind in ("nonlinear", "linear") if settles else ():
        drift = metrics[kind] and metrics[kind]["steady_drift"]
        if drift is not None and drift > STEADY_TOLERANCE:
            found.append(
                f"Load {load}: the {kind} settlement still changed by {100 * drift:.1f} % of its largest value "
                "in the last tenth of the time, so the body is not yet in its steady state at the end. Raise the end "
                "time."
            )
    return found
