"""Cost of the solutions of a run whose law solves cells: direct FE², and surrogates that learn on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from porocore.macro.laws import CLOSURES
from porocore.macro.laws.direct_record import direct_records
from porocore.report.context import AdaptiveSurrogateCost, DirectCost
from porocore.states import Status
from porocore.study.run_folder.files import RunFiles, direct_law, fallback_law
from porocore.study.stages.results import RunResults


def direct_costs(results: RunResults) -> tuple[DirectCost, ...]:
    """Return the cost of every solution by direct FE² whose cost was recorded."""
    timings, found = results.seconds, []
    for closure, law, load, work in _recorded(results, lambda files: files.direct_work, direct_law):
        seconds = timings.get(f"macro, {law}, load {load:g}")
        if seconds is not None:
            failed = sum(work.get(status.name, 0) for status in Status if not status.has_values)
            counts = (int(work["points"]), int(work["solves"]), int(failed))
            of_surrogate = timings.get(f"macro, {closure}, load {load:g}")
            found.append(DirectCost(law, load, *counts, work["seconds"], seconds, of_surrogate))
    return tuple(found)


def fallbacks_done(results: RunResults) -> tuple[AdaptiveSurrogateCost, ...]:
    """Return the work of the fallback in every solution that has one."""
    found = []
    for _, law, load, work in _recorded(results, lambda files: files.fallback_work, fallback_law):
        solves, failed, learned, refits = (
            int(work[name]) for name in ("solves", "failed", "learned", "refits")
        )
        seconds = work["solve_seconds"], work["fit_seconds"]
        found.append(AdaptiveSurrogateCost(law, load, solves, failed, learned, refits, *seconds))
    return tuple(found)


def _recorded(
    results: RunResults, record: Callable[[RunFiles], Path], law_with: Callable[[str], str]
) -> Iterator[tuple[str, str, float, dict[str, float]]]:
    """Yield closure, law, load and work, of all cells together, of every solution with a law that solves cells."""
    records = [direct_records(record(each.folder)) for each in results.by_cell.values()]
    for load, solutions in results.solutions.items():
        for closure in CLOSURES:
            law = law_with(closure)
            stem = results.folder.solution(law, load).stem
            found = [each[stem] for each in records if stem in each]
            if found and law in solutions:
                names = dict.fromkeys(name for each in found for name in each)
                yield closure, law, load, {name: sum(each.get(name, 0) for each in found) for name in names}
