"""Figures of merit of solutions: settlements, times to settle, drained volumes, flagged shares, warnings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.units.results import spoken
from porocore.interfaces.solution import History, MacroSolution
from porocore.report.format import number, percent
from porocore.states import Array

#: A run whose settlement still moves by more than this share of its final value in the last tenth of the time
#: has not reached the steady state.
STEADY_TOLERANCE = 1e-3
#: A share of the body that is flagged but is 0.0 % in words is none.
LEAST_FLAGGED = 5e-4


@dataclass(frozen=True)
class LeftOut:
    """Shear that was not sampled and moves a little in a body, where that alone flags it at the kept times.

    Attributes
    ----------
    name, value
        Component of H, and the farthest that it reaches.
    change
        By which share results change if it is left out, at most, about.
    tolerance
        The largest estimated error, as a share, that is not flagged.
    line
        Of the configuration that samples it.
    """

    name: str
    value: float
    change: float
    tolerance: float
    line: str

    @property
    def is_small(self) -> bool:
        """True if it changes results by less than an error that would not be flagged."""
        return self.change <= self.tolerance

    @property
    def estimate(self) -> str:
        """Change of the results in words."""
        return f"Leaving {self.name} out changes the results by no more than about {number(100 * self.change, 2)} %."


@dataclass(frozen=True, eq=False)
class LoadCase:
    """One load, solved with the cell's law and with linear poroelasticity on the same mesh and time plan.

    ``linear`` is None where the linear law was left out.
    ``others`` are solutions with other closures, or with the cell itself (direct FE²). ``flagged`` says where and why
    the surrogate is not to be trusted in the nonlinear solution; it is empty where it is, or where no profile tells.
    ``left_out`` is the shear that alone is the reason, if that is so.
    """

    nonlinear: MacroSolution
    linear: MacroSolution | None
    others: tuple[MacroSolution, ...] = ()
    flagged: str = ""
    left_out: LeftOut | None = None

    def __post_init__(self) -> None:
        for solution in self.compared:
            if self.nonlinear.load != solution.load:
                raise ValueError(
                    f"expected two solutions of one load, got {self.nonlinear.load:g} and {solution.load:g}"
                )

    @property
    def compared(self) -> tuple[MacroSolution, ...]:
        """The other solutions, the linear one last."""
        return self.others if self.linear is None else (*self.others, self.linear)

    @property
    def both(self) -> tuple[MacroSolution, MacroSolution]:
        """The nonlinear and the linear solution.

        Raises
        ------
        ValueError
            The linear law was left out.
        """
        if self.linear is None:
            raise ValueError(f"load {self.load:g} was not solved with the linear law")
        return self.nonlinear, self.linear

    @property
    def load(self) -> float:
        """Factor of the prescribed values."""
        return self.nonlinear.load


def time_to_fraction(time: Array, value: Array, fraction: float) -> float | None:
    """Return the first time at which ``value`` reaches ``fraction`` of its last entry, linear between the steps.

    Parameters
    ----------
    time, value : (steps,)
        A history; ``value`` may have either sign.
    fraction
        Of the last value, in (0, 1].

    Returns
    -------
    float or None
        None where the last value is zero or not finite.
    """
    final = float(value[-1])
    if final == 0 or not np.isfinite(final):
        return None
    share = value / final
    i = int(np.argmax(share >= fraction))
    if i == 0:
        return float(time[0])
    step = (fraction - share[i - 1]) / (share[i] - share[i - 1])
    return float(time[i - 1] + step * (time[i] - time[i - 1]))


def time_mean(time: Array, value: Array) -> float:
    """Return the mean over time of values (steps,) at the ends of backward Euler steps."""
    return float(np.sum(value[1:] * np.diff(time)) / (time[-1] - time[0]))


def steady_drift(history: History) -> float | None:
    """Return the change of the settlement over the last tenth of the time, as a share of its final value."""
    final = float(history.settlement[-1])
    if final == 0:
        return None
    start, end = history.time[0], history.time[-1]
    before = float(np.interp(end - 0.1 * (end - start), history.time, history.settlement))
    return abs(final - before) / abs(final)


#: Figures that say nothing where the settlement is prescribed.
OF_SETTLEMENT = frozenset({"final_settlement", "time_to_95_percent", "time_to_99_percent", "steady_drift"})


def solution_metrics(solution: MacroSolution) -> dict[str, Any]:
    """Return figures of merit of one solution, ready for JSON; a figure that is not defined is None.

    Lengths, volumes, times and pressures are dimensionless as in the solution. ``stress_spread`` is the
    largest deviation of P_E,22 from its mean over the body, over all times, over the load factor: zero in a column, a
    share of the load where stresses are prescribed, a stress for each unit of the factor where displacements are.
    """
    history = solution.history
    load = abs(solution.load)
    return {
        "law": solution.law,
        "final_settlement": float(history.settlement[-1]),
        "time_to_95_percent": time_to_fraction(history.time, history.settlement, 0.95),
        "time_to_99_percent": time_to_fraction(history.time, history.settlement, 0.99),
        "steady_drift": steady_drift(history),
        "max_pressure": float(history.pressure_max.max()),
        "time_of_max_pressure": float(history.time[int(history.pressure_max.argmax())]),
        "final_pressure": float(history.pressure_max[-1]),
        "drained": float(history.drained[-1]),
        "drained_paper": float(history.drained_paper[-1]),
        "flagged_end": float(history.outside_training_range[-1]),
        "flagged_largest": float(history.outside_training_range.max()),
        "flagged_time_mean": time_mean(history.time, history.outside_training_range),
        "flagged_first_time": _first_time(history, 0.0),
        "flagged_all_time": _first_time(history, 1 - 1e-9),
        "stress_spread": float(history.stress_spread.max()) / load if load > 0 else None,
        "steps": len(history.time) - 1,
        "newton_iterations": int(history.iterations.sum()),
        "end_time": float(history.time[-1]),
    }


def _first_time(history: History, share: float) -> float | None:
    """Return the first time at which more than ``share`` of the body is flagged; None: never."""
    beyond = np.flatnonzero(history.outside_training_range > share)
    return float(history.time[beyond[0]]) if len(beyond) else None


def case_metrics(case: LoadCase) -> dict[str, Any]:
    """Return the figures of one load and the ratios nonlinear over linear, ready for ``macro`` in ``metrics.json``."""
    nonlinear = solution_metrics(case.nonlinear)
    linear = None if case.linear is None else solution_metrics(case.linear)

    def ratio(key: str) -> float | None:
        top, bottom = nonlinear[key], None if linear is None else linear[key]
        return None if top is None or not bottom else top / bottom

    return {
        "load": case.load,
        "nonlinear": nonlinear,
        "linear": linear,
        "others": [solution_metrics(other) for other in case.others],
        "settlement_ratio": ratio("final_settlement"),
        "time_to_95_percent_ratio": ratio("time_to_95_percent"),
        "time_to_99_percent_ratio": ratio("time_to_99_percent"),
        "drained_ratio": ratio("drained"),
        "drained_paper_ratio": ratio("drained_paper"),
    }


def without_settlement(metrics: Any) -> Any:
    """Return the figures of :func:`case_metrics` of a body whose settlement is prescribed: without those of it."""
    if isinstance(metrics, list):
        return [without_settlement(each) for each in metrics]
    if not isinstance(metrics, dict):
        return metrics
    left_out = {*OF_SETTLEMENT, "settlement_ratio", *(f"{name}_ratio" for name in OF_SETTLEMENT)}
    return {name: without_settlement(value) for name, value in metrics.items() if name not in left_out}


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
                f"Load {load}: the {kind} settlement still changed by {100 * drift:.1f} % of its final value "
                "in the last tenth of the time, so the final value is not the steady state. Raise the end time."
            )
    return found
