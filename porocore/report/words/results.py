"""Results in words: settlement, heave, statuses of states, flagged shares, warnings of load cases."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from porocore.core.units import units_now
from porocore.interfaces.solution import DOUBTS, MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.report.context import SamplingSummary
from porocore.report.format import difference, measured, number, percent, plain
from porocore.report.metrics import REMNANT, STEADY_TOLERANCE, LeftOut, goes_back, is_gone
from porocore.states import Array, IntArray, Status

#: A settlement below this share of the heave, or a pressure below this share of the suction, is round-off.
ROUND_OFF = 1e-6
#: A heave below this share of the settlement is not told beside it.
LEAST_HEAVE = 0.05
#: A suction is reported where it is more than this share of the largest pressure. The undershoot of a front is less.
LEAST_SUCTION = 0.05


def case_sentences(metrics: dict[str, Any], settles: bool = True) -> list[str]:
    """Return a load case, given its :func:`porocore.report.metrics.case_metrics`, in a few sentences.

    Parameters
    ----------
    settles
        Whether the settlement is a result.
    """
    laws = [each for each in (metrics["nonlinear"], metrics["linear"]) if each is not None]
    if not settles:
        told = []
    elif not any(law["moves_along_y"] for law in laws):
        told = [_moved_sentence(metrics, laws)]
        return [*told, *_suction_sentence(laws)]
    elif all(nothing_settles(law) for law in laws):
        told = [_heave_sentence(metrics, laws)]
    elif any(goes_back(law, "final_settlement") for law in laws):
        told = _peak_sentences(metrics, laws)
    else:
        told = _final_sentences(metrics)
    if told and any(heaves(law) for law in laws) and not all(nothing_settles(law) for law in laws):
        heave = f"The largest heave, in the direction +y, is {_heave(laws)}.{_compared(metrics['largest_heave_ratio'])}"
        told = [heave, *told] if rises(laws[0]) else [*told, heave]
    return [*told, *_suction_sentence(laws)]


def nothing_settles(law: dict[str, Any]) -> bool:
    """Return True if no point of the body moves in the direction −y."""
    return bool(abs(law["largest_settlement"]) <= ROUND_OFF * abs(law["largest_heave"]))


def heaves(law: dict[str, Any]) -> bool:
    """Return True if the largest displacement in the direction +y is not small beside the largest settlement."""
    return bool(law["largest_heave"] > LEAST_HEAVE * abs(law["largest_settlement"]))


def rises(law: dict[str, Any]) -> bool:
    """Return True if the body moves further in the direction +y than in the direction −y."""
    return bool(law["largest_heave"] > abs(law["largest_settlement"]))


def settling_or_heaving(cases: list[dict[str, Any]], settles: bool) -> dict[str, bool]:
    """Return by the names ``settling``, ``heaving`` and ``moving`` what the table has columns of.

    They are the settlement, the heave, and the largest displacement of a body that hardly moves along y.

    ``settles`` says whether the settlement is a result.
    """
    laws = [law for m in cases for law in (m["nonlinear"], *m["others"], m["linear"]) if law is not None]
    upright = any(law["moves_along_y"] for law in laws)
    heaving = settles and upright and any(map(rises, laws))
    settling = settles and upright and not (heaving and all(map(nothing_settles, laws)))
    return {"moving": settles and not upright, "heaving": heaving, "settling": settling}


def only_suction(law: dict[str, Any]) -> bool:
    """Return True if the pore pressure is negative, and nowhere positive but for round-off."""
    least = law["least_pressure"]
    return bool(least < 0 and abs(law["max_pressure"]) <= -ROUND_OFF * least)


def has_suction(law: dict[str, Any]) -> bool:
    """Return True if the least pore pressure is negative and not small."""
    least = law["least_pressure"]
    return bool(-least > LEAST_SUCTION * abs(law["max_pressure"]))


def largest_rows(cases: list[dict[str, Any]], settles: bool) -> list[tuple[float, str, dict[str, Any]]]:
    """Return load, law and figures of the loads whose settlement or drained volume ends below its largest value.

    The last row of a load has the ratios nonlinear over linear as figures, if there is a linear law.
    """
    rows = []
    for case in cases:
        nonlinear, linear, others = case["nonlinear"], case["linear"], case["others"]
        keys = ("final_settlement", "drained") if settles and nonlinear["moves_along_y"] else ("drained",)
        named = [(law["law"] if others else "nonlinear", law) for law in (nonlinear, *others)]
        named += [] if linear is None else [("linear", linear)]
        if any(goes_back(law, key) for _, law in named for key in keys):
            rows += [(case["load"], name, law) for name, law in named]
            rows += (
                []
                if linear is None
                else [(case["load"], f"{named[0][0]} / linear" if others else "ratio", case)]
            )
    return rows


def _final_sentences(metrics: dict[str, Any]) -> list[str]:
    nonlinear, linear = metrics["nonlinear"], metrics["linear"]
    begin = (
        f"Under the load {plain(metrics['load'])} the final settlement is "
        f"{measured(nonlinear['final_settlement'], 'displacement')} with the nonlinear law of the cell"
    )
    reached = (
        f"It reaches 95 % of its final value at t = {_time(nonlinear['time_to_95_percent'])} and 99 % at "
        f"t = {_time(nonlinear['time_to_99_percent'])}."
    )
    if linear is None:
        return [f"{begin}.", *([] if nonlinear["time_to_99_percent"] is None else [reached])]
    sentences = [
        f"{begin} and {measured(linear['final_settlement'], 'displacement')} with linear poroelasticity. "
        f"The nonlinear settlement is {difference(metrics['settlement_ratio'])}."
    ]
    if nonlinear["time_to_99_percent"] is not None and linear["time_to_99_percent"] is not None:
        sentences.append(
            f"{reached} The linear settlement reaches 95 % at t = {_time(linear['time_to_95_percent'])} and 99 % at "
            f"t = {_time(linear['time_to_99_percent'])}. The nonlinear time to 99 % is "
            f"{difference(metrics['time_to_99_percent_ratio'], 'shorter', 'longer')}."
        )
    return sentences


def _peak_sentences(metrics: dict[str, Any], laws: list[dict[str, Any]]) -> list[str]:
    """Return the largest settlement, and what is left of it at the end."""
    sentences = [
        f"Under the load {plain(metrics['load'])} the largest settlement is "
        f"{_by_law(laws, 'largest_settlement', 'time_of_largest_settlement')}."
        f"{_compared(metrics['largest_settlement_ratio'])}"
    ]
    if any(is_gone(law, "final_settlement") for law in laws):
        return [*sentences, f"At the end, less than {100 * REMNANT:g} % of it is left."]
    final = " and ".join(measured(law["final_settlement"], "displacement") for law in laws)
    sentences.append(f"At the end, it is {final}.{_compared(metrics['settlement_ratio'])}")
    for name, law in zip(("nonlinear", "linear"), laws, strict=False):
        sentences.append(
            f"The {name} settlement stays within 5 % of its final value from t = {_time(law['time_to_95_percent'])} "
            f"on, and within 1 % from t = {_time(law['time_to_99_percent'])} on."
        )
    return sentences


def _heave_sentence(metrics: dict[str, Any], laws: list[dict[str, Any]]) -> str:
    begin = f"Under the load {plain(metrics['load'])} no point of the body moves in the direction −y."
    if not laws[0]["largest_heave"]:
        return begin
    return f"{begin} The largest displacement in the direction +y is {_heave(laws)}."


def _moved_sentence(metrics: dict[str, Any], laws: list[dict[str, Any]]) -> str:
    """Return the largest displacement of a body that hardly moves along y."""
    component = laws[0]["largest_component"]
    along = f" along {'xyz'[int(component[-1]) - 1]}" if component else ""
    largest = _by_law(laws, "largest_displacement", "time_of_largest_displacement")
    probe = f" A probe (macro.probes) has {component} of a point." if component else ""
    return (
        f"Under the load {plain(metrics['load'])} the body moves{along}, and by less than {100 * REMNANT:g} % of that "
        f"along y, so there is no settlement or heave, which are along y. The largest displacement is {largest}.{probe}"
    )


def _heave(laws: list[dict[str, Any]]) -> str:
    return _by_law(laws, "largest_heave", "time_of_largest_heave")


def _suction_sentence(laws: list[dict[str, Any]]) -> list[str]:
    if not any(has_suction(law) for law in laws):
        return []
    suction = _by_law(laws, "least_pressure", "time_of_least_pressure", "pressure")
    return [f"The least {laws[0]['pressure']} is {suction}."]


def _by_law(laws: list[dict[str, Any]], value: str, time: str, quantity: str = "displacement") -> str:
    """Return a value with its time by each law."""
    names = ("with the nonlinear law of the cell", "with linear poroelasticity")
    return " and ".join(
        f"{measured(law[value], quantity)} at t = {_time(law[time])} {name}"
        for law, name in zip(laws, names, strict=False)
    )


def _compared(ratio: float | None) -> str:
    return "" if ratio is None else f" The nonlinear one is {difference(ratio)}."


def _time(value: float | None) -> str:
    return measured(value, "time", 3)


#: What a reader must know of a state that is not plainly converged.
SHARES: dict[str, tuple[Status, ...]] = {
    "contact": (Status.contact,),
    "unstable": (Status.unstable,),
    "without_values": tuple(status for status in Status if not status.has_values),
}


def solved_shares(sampling: SamplingSummary) -> dict[str, float]:
    """Return the shares of the solved states in contact, unstable, and without values, ready for JSON."""
    count = max(len(sampling.status), 1)
    shares = {name: int(np.isin(sampling.status, kinds).sum()) / count for name, kinds in SHARES.items()}
    return shares | _wall(sampling, np.arange(len(sampling.status)))


def visited_shares(solution: MacroSolution, sampling: SamplingSummary) -> list[dict[str, float]]:
    """Return the same shares of the body's volume at each kept time, ready for JSON.

    A macroscopic law does not know how a cell would end. Each element counts as the solved state that lies nearest to
    its own, in inputs divided by their ranges. What lies beyond the sampled range is flagged elsewhere, and counts here
    as what the sampling found at its edge.
    """
    if not len(sampling.status):
        return []
    span = np.subtract(sampling.inputs.upper, sampling.inputs.lower)
    tree = cKDTree(sampling.x / span)
    volume = BodyMesh.of(solution).weights.sum(axis=1)
    return [_at(solution, i, sampling, tree, span, volume) for i in range(len(solution.profiles))]


def _at(
    solution: MacroSolution, i: int, sampling: SamplingSummary, tree: Any, span: Array, volume: Array
) -> dict[str, float]:
    inputs = sampling.inputs
    x = inputs.gather(inputs.without_rotation(solution.cell_states(i)))
    nearest = tree.query(x / span)[1]
    status = sampling.status[nearest]
    shares = {
        name: float(volume[np.isin(status, kinds)].sum() / volume.sum()) for name, kinds in SHARES.items()
    }
    return {"time": solution.profiles[i].time, **shares, **_wall(sampling, nearest)}


def _wall(sampling: SamplingSummary, rows: IntArray) -> dict[str, float]:
    """Return the largest share of the pore wall in contact, of states in contact; nothing where it is not known."""
    if sampling.contact_share is None:
        return {}
    touching = sampling.contact_share[rows][np.isin(sampling.status[rows], SHARES["contact"])]
    return {"wall_in_contact": float(np.nanmax(touching, initial=0.0))}


def _of_the_wall(shares: dict[str, float], where: str) -> str:
    """Return a sentence on how much of the wall touches; empty where it is not known or nothing touches."""
    wall = shares.get("wall_in_contact", 0.0)
    if not wall:
        return ""
    most = "less than 0.01" if wall < 1e-4 else f"at most {number(100 * wall, 2)}"
    return f" In {where}, {most} % of the wall is in contact."


def solved_sentence(shares: dict[str, float]) -> str:
    """Return :func:`solved_shares` in words."""
    contact, unstable, without = (percent(shares[name], 0) for name in SHARES)
    return (
        f"Of the solved states, {contact} are in contact: the pore wall is pressed against itself."
        f"{_of_the_wall(shares, 'each state')} {unstable} of the states are unstable, and {without} have no valid data."
    )


def visited_sentence(visited: list[dict[str, float]]) -> str:
    """Return :func:`visited_shares` in words; empty where no profile was kept."""
    if not visited:
        return ""
    end = visited[-1]
    largest = {name: max(at[name] for at in visited) for name in SHARES}
    if not any(largest.values()):
        return (
            "For each element of the body, the nearest solved state of the cell is stable and has no contact."
        )
    at_end, at_most = ([percent(shares[name], 0) for name in SHARES] for shares in (end, largest))
    return (
        "For the next numbers, each element of the body is given the status of the nearest solved state of the cell. "
        f"At the end of the run, the pore wall touches itself in the cells of {at_end[0]} of the body."
        f"{_of_the_wall(end, 'each cell')} {at_end[1]} of the body is unstable, and {at_end[2]} has no valid data. "
        "Over all times at which profiles are stored, the largest values of these shares are "
        f"{at_most[0]} in contact, {at_most[1]} unstable and {at_most[2]} without valid data."
    )


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
        f"it is {end}. The first points are flagged at t = {units_now().text(metrics['flagged_first_time'], 'time', 3)}"
    )
    whole = metrics["flagged_all_time"]
    words += (
        "."
        if whole is None
        else f", and the whole body is flagged at t = {units_now().text(whole, 'time', 3)}."
    )
    reasons = sorted(metrics["flagged_reasons"].items(), key=lambda each: -each[1])
    if not reasons:
        return words
    parts = ", ".join(f"{DOUBTS[name]} ({percent(share)} of the body)" for name, share in reasons)
    return f"{words} {'The reason is' if len(reasons) == 1 else 'The reasons are'}: {parts}."


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
            f"{units_now().text(flagged['flagged_first_time'], 'time', 3)} to macro.time.profiles."
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
                f"Load {load}: the largest displacement by the {kind} law still changed by {100 * drift:.1f} % of its "
                "largest value in the last tenth of the time, so the body is not yet in its steady state at the end. "
                "Raise the end time."
            )
    return found
