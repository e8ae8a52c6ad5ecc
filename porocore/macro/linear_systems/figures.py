"""Work of the linear solver as figures for metrics.json and as words for the log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from porocore.interfaces.solution import MacroSolution, StepWork
from porocore.states import Array


def work_figures(solution: MacroSolution) -> dict[str, Any]:
    """Return what a solve took, ready for JSON; times in seconds.

    ``most_iterations`` are those of one system, ``step_seconds`` the mean over the steps.
    """
    work = solution.work
    total = {name: float(work[name].sum()) for name in work}
    steps = max(len(solution.history.time) - 1, 1)
    return {
        "law": solution.law,
        "load": solution.load,
        "solver": solution.linear_solver,
        "systems": int(total["systems"]),
        "iterations": int(total["iterations"]),
        "most_iterations": int(work["most_iterations"].max()),
        "set_ups": int(total["set_ups"]),
        "set_up_seconds": total["set_up_seconds"],
        "solve_seconds": total["solve_seconds"],
        "step_seconds": total["seconds"] / steps,
    }


def work_in_words(work: Mapping[str, Array]) -> str:
    """Return what a solve took; empty where factors did it."""
    if not work or not work["iterations"].any():
        return ""
    steps = max(len(work["seconds"]) - 1, 1)
    return (
        f"{work['systems'].sum():.0f} linear systems in {work['iterations'].sum():.0f} iterations, at most "
        f"{work['most_iterations'].max():.0f} each; {work['set_ups'].sum():.0f} set-ups in "
        f"{work['set_up_seconds'].sum():.1f} s, iterations in {work['solve_seconds'].sum():.1f} s; "
        f"{work['seconds'].sum() / steps:.1f} s a step"
    )


def step_in_words(work: StepWork | None) -> str:
    """Return what a step took, to follow other words; empty where factors did it."""
    if work is None or not work.iterations:
        return ""
    set_up = f", set-up {work.set_up_seconds:.1f} s" if work.set_ups else ""
    return f", {work.iterations:.0f} iterations for {work.systems:.0f} systems{set_up}, {work.seconds:.1f} s a step"
