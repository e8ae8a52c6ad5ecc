"""Results in sentences: load cases, flagged shares, forces, warnings; rows beside a publication."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from porocore.report.context import (
    Published,
    ReportContext,
    SamplingSummary,
    SurrogateSummary,
    contacts,
    end_words,
    force_name,
    no_relaxation,
    reactions,
)
from porocore.report.format import difference, measured, number, percent, plain
from porocore.report.metrics import LeftOut, LoadCase, case_metrics
from porocore.report.words.cell import ComparisonRow
from porocore.report.words.results import case_warnings, flagged_shares, is_flagged
from porocore.states import Status

#: From such a flagged share of the body on the results come only after it.
LARGE_SHARE = 0.1
#: Said where a pressure follows the deformed surface.
FOLLOWER = (
    "In the linear law, too, the follower pressure acts on the deformed surface. Therefore the linear solution is not "
    "proportional to the load."
)
#: What each status means, in plain words.
MEANINGS: dict[Status, str] = {
    Status.converged: "in equilibrium; no instability was found",
    Status.contact: "in equilibrium, with the pore wall pressed against itself or its mirror image; no instability "
    "was found",
    Status.unstable: "in equilibrium, but unstable: a small disturbance moves the cell to another state (indefinite "
    "tangent); the values are stored",
    Status.overlap: "the pore wall has passed through itself or its mirror image, or no fluid volume is "
    "left; every point still has J > 0; no valid data",
    Status.inverted: "even the smallest load step leads to J ≤ 0; no data",
    Status.not_converged: "the limit of iterations or steps was reached; no data",
    Status.lost: "two workers died or exceeded the time limit while they solved it, perhaps not because of the cell; "
    "no data",
}


def status_in_words(name: str) -> str:
    """Return the name of a status, with its meaning unless the state converged."""
    known = Status[name]
    return name if known is Status.converged else f"{name} – {MEANINGS[known]}"


def flagged_sentence(metrics: dict[str, Any], left_out: LeftOut | None = None) -> str:
    """Return the flagged share of a load case in words; ``left_out`` is the shear that alone flags the body."""
    nonlinear = metrics["nonlinear"]
    if is_flagged(nonlinear) and left_out is not None and left_out.is_small:
        return (
            f"In up to {percent(nonlinear['flagged_largest'])} of the body, the component {left_out.name} is not zero "
            f"(at most {number(abs(left_out.value), 2)}). It was not sampled, so these parts are flagged. "
            f"{left_out.estimate} To remove the flags, write under 'sampling.inputs:' {left_out.line}."
        )
    if is_flagged(nonlinear):
        return (
            "Parts of the body are flagged: there some quantity of the surrogate (stress, fluid volume or "
            f"conductivity) is not reliable. {flagged_shares(nonlinear)}"
        )
    return "No part of the body is flagged."


def flagged_around(results: list[str], metrics: dict[str, Any], left_out: LeftOut | None = None) -> list[str]:
    """Return the sentences of a load case with that on its flagged share: first where the share is large, else last."""
    flagged = flagged_sentence(metrics, left_out)
    small = left_out is not None and left_out.is_small
    if metrics["nonlinear"]["flagged_largest"] >= LARGE_SHARE and not small:
        return [flagged, *results]
    return [*results, flagged]


def whole_words(copies: float) -> str:
    """Return the body whose forces and volumes are given; ``copies`` computed parts make it up."""
    if copies == 1:
        return "the computed body"
    shares = {2: "a half", 4: "a quarter", 8: "an eighth"}
    part = shares.get(round(copies)) if copies == round(copies) else None
    return f"the whole body, of which {part or f'one part in {copies:.4g}'} is computed"


def force_sentences(case: LoadCase, moved: Sequence[str]) -> list[str]:
    """Return the forces on the surfaces that are moved, in a few sentences."""
    nonlinear, linear = reactions(case.nonlinear), {} if case.linear is None else reactions(case.linear)
    sentences = []
    for name in moved:
        if name in nonlinear:
            force = nonlinear[name]
            sentences.append(
                _force_sentence(f"{force_name(force)} on {name} (load {plain(case.load)})", force)
            )
        if name in nonlinear and name in linear:
            peak, final = (measured(linear[name][key], "force") for key in ("peak", "final"))
            sentences.append(f"With linear poroelasticity, its peak is {peak}, and it is {final} at the end.")
    return sentences


def indenter_sentences(case: LoadCase) -> list[str]:
    """Return the force of each indenter, its contact radius and its largest contact pressure, in a few sentences."""
    linear = {} if case.linear is None else contacts(case.linear)
    sentences = []
    for name, found in contacts(case.nonlinear).items():
        whose = f"force of the indenter {name} (load {plain(case.load)})"
        if found["relaxed_50_percent"] is None:
            sentences.append(f"The {whose} is {measured(found['peak'], 'force')} at most.")
        else:
            sentences.append(_force_sentence(whose, found))
        radius = found.get("largest_radius")
        touched = (
            f"of {measured(found['largest_area'], 'area', 3)}"
            if radius is None
            else f"with the radius {measured(radius, 'displacement', 3)}"
        )
        sentences.append(
            f"It touches an area {touched} at most, under "
            f"a contact pressure of {measured(found['largest_contact_pressure'], 'pressure', 3)} at most; its largest "
            f"displacement is {measured(found['largest_displacement'], 'displacement', 3)}."
        )
        if name in linear:
            peak, final = (measured(linear[name][key], "force") for key in ("peak", "final"))
            sentences.append(f"With linear poroelasticity, its peak force is {peak}, and {final} at the end.")
    return sentences


def _force_sentence(whose: str, force: dict[str, Any]) -> str:
    """Return a summary of :func:`porocore.report.context.relaxation` in words."""
    peak, final = (measured(force[key], "force") for key in ("peak", "final"))
    settled = end_words(force) if force["equilibrium"] is not None else f"at the end, {end_words(force)}"
    begin = f"The {whose} is {peak} at its peak, at t = "
    begin += measured(force["time_of_peak"], "time", 3)
    if force["drift"] is None:
        return f"{begin}. At the end, the force is gone."
    if force["relaxed_50_percent"] is None:
        return f"{begin}, and {final} {settled}: a {no_relaxation(force)}, so no time of relaxation is given."
    half, most = (measured(force[f"relaxed_{n}_percent"], "time", 3) for n in (50, 95))
    ratio = "" if force["peak_over_final"] is None else f", a ratio of {number(force['peak_over_final'], 3)}"
    relaxed = f"It has relaxed by 50 % {half} after the peak and by 95 % {most} after it."
    return f"{begin}, and {final} {settled}{ratio}. {relaxed}"


def force_warnings(case: LoadCase, moved: Sequence[str]) -> list[str]:
    """Return warnings of forces on moved surfaces and of indenters that still change at the end."""
    forces = [
        (f"{force_name(force)} on {name}", force)
        for name, force in reactions(case.nonlinear).items()
        if name in moved
    ]
    forces += [(f"force of the indenter {name}", force) for name, force in contacts(case.nonlinear).items()]
    return [
        f"Load {plain(case.load)}: the {whose} still changed by {100 * force['drift']:.1f} % of its final value in the "
        "last tenth of the time, so the final value is not that of the equilibrium. Raise the end time."
        for whose, force in forces
        if force["drift"] is not None and force["equilibrium"] is None
    ]


def _time(value: float | None) -> str:
    return measured(value, "time", 3)


def benchmark_rows(published: Published, metrics: dict[str, Any]) -> list[ComparisonRow]:
    """Return the statements of the publication on one load beside the figures of that load."""
    nonlinear, linear = metrics["nonlinear"], metrics["linear"]
    steady = ComparisonRow(
        "time to the steady state, nonlinear",
        f"at t = {plain(published.steady_time)} (no criterion stated)",
        f"95 % at t = {_time(nonlinear['time_to_95_percent'])}, "
        f"99 % at t = {_time(nonlinear['time_to_99_percent'])}",
    )
    if linear is None:
        return [steady]
    return [
        ComparisonRow(
            "final settlement, nonlinear compared with linear",
            published.settlement,
            difference(metrics["settlement_ratio"]),
        ),
        steady,
        ComparisonRow(
            "time to the steady state, nonlinear compared with linear",
            published.duration,
            f"to 95 %: {difference(metrics['time_to_95_percent_ratio'], 'shorter', 'longer')} (linear: t = "
            f"{_time(linear['time_to_95_percent'])}); to 99 %: "
            f"{difference(metrics['time_to_99_percent_ratio'], 'shorter', 'longer')} (linear: t = "
            f"{_time(linear['time_to_99_percent'])})",
        ),
    ]


def _unjudged(surrogate: SurrogateSummary) -> list[str]:
    """Return a warning where no held-out state lies within the sampled range."""
    outputs = surrogate.outputs
    if not outputs or not all(check.all_outside for check in outputs):
        return []
    return [
        f"None of the {len(outputs[0].solved)} held-out states lies within the range that the surrogate was trained "
        "on. The errors of the surrogate are measured outside this range only; the errors inside are unknown. Sample "
        "more states, so that they fill the ranges, or use more held-out states (sampling.test.count)."
    ]


def all_warnings(context: ReportContext) -> list[str]:
    """Return the given warnings, then those of the results."""
    found = list(context.warnings)
    for each in context.of_each_cell:
        found += [each.said_of_cell(warning) for warning in _unjudged(each.surrogate)]
    for case in context.cases:
        moved = context.loading_mode.displaced
        settles = context.loading_mode.settles
        found += case_warnings(case_metrics(case), case.flagged, settles=settles, left_out=case.left_out)
        found += force_warnings(case, moved)
    return found


def status_rows(sampling: SamplingSummary) -> list[tuple[str, int, str]]:
    """Return name, count and meaning of each status that occurred, converged always."""
    counts = {status: int((sampling.status == status).sum()) for status in Status}
    return [
        (status.name.replace("_", " "), count, MEANINGS[status])
        for status, count in counts.items()
        if count or status is Status.converged
    ]
