"""Figures of merit of solutions: settlements, times to settle, largest values, drained volumes, flagged shares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.interfaces.solution import History, MacroSolution
from porocore.report.format import number
from porocore.states import Array, Doubt

#: A run whose largest displacement still moves by more than this share of its largest value in the last tenth of the
#: time has not reached the steady state.
STEADY_TOLERANCE = 1e-3
#: A quantity that ends below this share of its largest value has no figures of its final value. A solution counts as
#: steady to 0.1 % of its largest value, so that a hundredth of it is known to a tenth at best.
REMNANT = 1e-2
#: A settlement that exceeds its final value by more than this share leaves the band whose time is that to 99 %.
OVERSHOOT = 1e-2
#: The largest value that a final one is held against; the paper's measure is held against the drained volume.
LARGEST = {
    "final_settlement": "largest_settlement",
    "drained": "largest_drained",
    "drained_paper": "largest_drained",
}


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
    the surrogate is not to be trusted in the nonlinear solution; it is empty where it is, or where no profile shows it.
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


def time_within(time: Array, value: Array, fraction: float) -> float | None:
    """Return the time from which on ``value`` stays as close to its last entry as ``fraction`` of it is.

    A value that grows without going beyond its last one reaches the fraction then; see :func:`time_to_fraction`.

    Returns
    -------
    float or None
        None where the last value is not finite, or a remnant of the largest.
    """
    final = float(value[-1])
    if final == 0 or not np.isfinite(final) or is_remnant(final, largest_value(value)):
        return None
    share = value / final
    away = np.flatnonzero((share < fraction) | (share > 2 - fraction))
    if not len(away):
        return float(time[0])
    i = int(away[-1]) + 1
    edge = fraction if share[i - 1] < fraction else 2 - fraction
    step = (edge - share[i - 1]) / (share[i] - share[i - 1])
    return float(time[i - 1] + step * (time[i] - time[i - 1]))


def largest_value(value: Array) -> float:
    """Return the entry that is largest in size, with its sign."""
    return float(value[int(np.abs(value).argmax())])


def is_remnant(final: float, largest: float) -> bool:
    """Return True if little is left at the end of what once was; a quantity that is zero throughout has no remnant."""
    return abs(final) < REMNANT * abs(largest)


def is_gone(figures: dict[str, Any], key: str) -> bool:
    """Return True if a final value of :func:`solution_metrics` is a remnant; other figures never are."""
    return key in LARGEST and is_remnant(figures[key], figures[LARGEST[key]])


def goes_back(figures: dict[str, Any], key: str) -> bool:
    """Return True if a final value of :func:`solution_metrics` is not the largest, but for :data:`OVERSHOOT`."""
    return bool(abs(figures[LARGEST[key]]) > (1 + OVERSHOOT) * abs(figures[key]))


def time_of_largest(time: Array, value: Array) -> float:
    """Return when ``value`` first comes within 0.1 % of its largest entry, which it may then keep for long."""
    near = np.abs(value - largest_value(value)) <= STEADY_TOLERANCE * np.abs(value).max()
    return float(time[int(np.argmax(near))])


def steady_drift(history: History) -> float | None:
    """Return the change of max |u| over the last tenth of the time, as a share of its largest value."""
    largest = float(history.displacement.max())
    if largest == 0:
        return None
    start, end = history.time[0], history.time[-1]
    before = float(np.interp(end - 0.1 * (end - start), history.time, history.displacement))
    return abs(float(history.displacement[-1]) - before) / largest


def moves_along_y(history: History) -> bool:
    """Return False if the body moves along x or z and hardly along y, so that settlement and heave are no results.

    What is below 1 % of the largest displacement is round-off, or the error of a mesh.
    """
    along = max(abs(largest_value(history.settlement)), float(history.heave.max()))
    return not is_remnant(along, float(history.displacement.max()))


def largest_component(solution: MacroSolution) -> str:
    """Return the largest component of the displacement in the profiles, such as ``u_3``; empty without profiles."""
    moved = [np.abs(profile.u).max(axis=0) for profile in solution.after_rest]
    return f"u_{int(np.max(moved, axis=0).argmax()) + 1}" if moved else ""


#: Figures that say nothing where the settlement is no result, beside those that it names.
OF_SETTLEMENT = ("time_to_95_percent", "time_to_99_percent", "heave")


def solution_metrics(solution: MacroSolution) -> dict[str, Any]:
    """Return figures of merit of one solution, ready for JSON; a figure that is not defined is None.

    Lengths, volumes, times, stresses and pressures are dimensionless as in the solution. ``stress_spread`` is the
    largest deviation of P_E,22 from its mean over the body, over all times, which is zero in a column.
    """
    history = solution.history
    highest, lowest = int(history.heave.argmax()), int(history.pressure_min.argmin())
    return {
        "law": solution.law,
        "pressure": solution.pressure,
        "final_settlement": float(history.settlement[-1]),
        "time_to_95_percent": time_within(history.time, history.settlement, 0.95),
        "time_to_99_percent": time_within(history.time, history.settlement, 0.99),
        "steady_drift": steady_drift(history),
        "largest_settlement": largest_value(history.settlement),
        "time_of_largest_settlement": time_of_largest(history.time, history.settlement),
        "largest_heave": float(history.heave[highest]),
        "time_of_largest_heave": float(history.time[highest]),
        "largest_displacement": float(history.displacement.max()),
        "time_of_largest_displacement": time_of_largest(history.time, history.displacement),
        "final_displacement": float(history.displacement[-1]),
        "largest_component": largest_component(solution),
        "moves_along_y": moves_along_y(history),
        "max_pressure": float(history.pressure_max.max()),
        "time_of_max_pressure": float(history.time[int(history.pressure_max.argmax())]),
        "final_pressure": float(history.pressure_max[-1]),
        "least_pressure": float(history.pressure_min[lowest]),
        "time_of_least_pressure": float(history.time[lowest]),
        "drained": float(history.drained[-1]),
        "drained_paper": float(history.drained_paper[-1]),
        "largest_drained": largest_value(history.drained),
        "time_of_largest_drained": time_of_largest(history.time, history.drained),
        "flagged_end": float(history.flagged[-1]),
        "flagged_largest": float(history.flagged.max()),
        "flagged_time_mean": time_mean(history.time, history.flagged),
        "flagged_reasons": _reasons(history),
        "flagged_first_time": _first_time(history, 0.0),
        "flagged_all_time": _first_time(history, 1 - 1e-9),
        "stress_spread": float(history.stress_spread.max()),
        "steps": len(history.time) - 1,
        "newton_iterations": int(history.iterations.sum()),
        "end_time": float(history.time[-1]),
    }


def _reasons(history: History) -> dict[str, float]:
    """Return the largest share of the body that is flagged for each reason of :class:`~porocore.Doubt`, if any is."""
    found = {each.name or "": float(getattr(history, f"flagged_{each.name}").max()) for each in Doubt}
    return {name: share for name, share in found.items() if share > 0}


def _first_time(history: History, share: float) -> float | None:
    """Return the first time at which more than ``share`` of the body is flagged; None: never."""
    beyond = np.flatnonzero(history.flagged > share)
    return float(history.time[beyond[0]]) if len(beyond) else None


def case_metrics(case: LoadCase) -> dict[str, Any]:
    """Return the figures of one load and the ratios nonlinear over linear, ready for ``macro`` in ``metrics.json``."""
    nonlinear = solution_metrics(case.nonlinear)
    linear = None if case.linear is None else solution_metrics(case.linear)

    def ratio(key: str) -> float | None:
        top, bottom = nonlinear[key], None if linear is None else linear[key]
        gone = linear is not None and (is_gone(nonlinear, key) or is_gone(linear, key))
        return None if top is None or not bottom or gone else top / bottom

    return {
        "load": case.load,
        "nonlinear": nonlinear,
        "linear": linear,
        "others": [solution_metrics(other) for other in case.others],
        "settlement_ratio": ratio("final_settlement"),
        "time_to_95_percent_ratio": ratio("time_to_95_percent"),
        "time_to_99_percent_ratio": ratio("time_to_99_percent"),
        "largest_settlement_ratio": ratio("largest_settlement"),
        "largest_heave_ratio": ratio("largest_heave"),
        "largest_displacement_ratio": ratio("largest_displacement"),
        "drained_ratio": ratio("drained"),
        "drained_paper_ratio": ratio("drained_paper"),
        "largest_drained_ratio": ratio("largest_drained"),
    }


def without_settlement(metrics: Any) -> Any:
    """Return the figures of :func:`case_metrics` without those of the settlement where it is no result."""
    if isinstance(metrics, list):
        return [without_settlement(each) for each in metrics]
    if not isinstance(metrics, dict):
        return metrics
    return {
        name: without_settlement(value)
        for name, value in metrics.items()
        if not any(part in name for part in ("settlement", *OF_SETTLEMENT))
    }
