"""All stages of a run one after another: cell, samples, surrogate, macroscale, report.

Each stage reads the files of the one before it from the run folder, continues where an earlier process stopped, and
adds its wall time to the folder's record.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.plugins.registry import registry
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages.laws import USUAL_LAWS, LawKind, law_names
from porocore.study.stages.reference import solve_cell, solve_reference
from porocore.study.stages.reporting import kept_report, report
from porocore.study.stages.sampling import sample
from porocore.study.stages.solving import solve
from porocore.study.stages.training import train

__all__ = ["report", "run", "sample", "solve", "solve_cell", "solve_reference", "train"]


def run(
    folder: RunFolder,
    config: RunConfig,
    *,
    console: Console,
    laws: Sequence[LawKind] = USUAL_LAWS,
    store: ResultStore | None = None,
) -> Path:
    """Run all stages and return the path of the report.

    What is finished and has not changed since stays, and what ``store`` holds is not computed again.
    """
    solutions = folder.solutions(*law_names(config, laws, config.closure))
    if all(path.exists() for path in solutions) and kept_report(folder, config, console=console):
        console.note(f"the run is finished; to write its report again: porocore report {folder.path}")
        return folder.report

    def begin() -> None:
        if not folder.surrogate_of(config).exists():
            registry().get("surrogate", config.surrogate.backend).load_libraries()

    solve_reference(folder, config, console=console, store=store, begin=begin)
    sample(folder, config, console=console, store=store, begin=begin)
    train(folder, config, console=console, store=store)
    solve(folder, config, console=console, laws=laws, store=store)
    return report(folder, config, console=console)
