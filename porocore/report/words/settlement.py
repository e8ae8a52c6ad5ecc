"""Settlement of a load case in sentences: final or largest, with its times; heave and suction."""

from __future__ import annotations

from typing import Any

from porocore.report.format import difference, measured, plain
from porocore.report.metrics import REMNANT, goes_back, is_gone

#: A settlement below this share of the heave, or a pressure below this share of the suction, is round-off.
ROUND_OFF = 1e-6
#: A heave below this share of the settlement is not told beside it.
LEAST_HEAVE = 0.05
#: A suction is told where it is more than this share of the largest pressure. The undershoot of a front is less.
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
    """Return by the names ``settling`` and ``heaving`` whether the table has columns of settlement and of heave.

    ``settles`` says whether the settlement is a result.
    """
    laws = [law for m in cases for law in (m["nonlinear"], *m["others"], m["linear"]) if law is not None]
    heaving = settles and any(map(rises, laws))
    return {"heaving": heaving, "settling": settles and not (heaving and all(map(nothing_settles, laws)))}


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
    keys, rows = ("final_settlement", "drained") if settles else ("drained",), []
    for case in cases:
        nonlinear, linear, others = case["nonlinear"], case["linear"], case["others"]
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


def _heave(laws: list[dict[str, Any]]) -> str:
    return _by_law(laws, "largest_heave", "time_of_largest_heave")


def _suction_sentence(laws: list[dict[str, Any]]) -> list[str]:
    if not any(has_suction(law) for law in laws):
        return []
    suction = _by_law(laws, "least_pressure", "time_of_least_pressure", "pressure")
    return [f"The least pore pressure is {suction}."]


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
