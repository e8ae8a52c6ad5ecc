"""(n) How good the time left is that the progress shows: the estimate at a fifth of the time, against what was left.

    python benchmarks/clocks.py FOLDER [CASE …]

Twenty coarse variants of the examples, in ``clock_cases.yml``: bodies, laws, samplers and surrogates of all kinds,
ramps, bends and cycles, steps of equal length and steps by their error. What each task reported is kept in the folder,
and a case that lies there is not run again. A task counts if it takes at least ``SHORTEST`` seconds.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from common import table

from porocore.core.console import Console, Task
from porocore.core.files.yaml_document import YamlDocument
from porocore.study.config.loading import validated
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages import pipeline

HERE = Path(__file__).parent
#: Tasks that take less need no clock [s].
SHORTEST = 4.0
SHARE = 0.2


class Recorder(Console):
    """Console that keeps time and estimate of every report."""

    def __init__(self) -> None:
        super().__init__(io.StringIO())
        self.tasks: list[dict[str, Any]] = []

    @contextmanager
    def task(self, title: str, unit: str, begins: str = "") -> Iterator[Task]:
        """Record each report of a task, in seconds since it began."""
        begun = time.monotonic()
        record: dict[str, Any] = {"title": title, "reports": []}
        with super().task(title, unit, begins) as task:
            update = task.update

            def recorded(*args: Any, **named: Any) -> None:
                update(*args, **named)
                record["reports"].append((time.monotonic() - begun, task.left))

            task.update = recorded  # type: ignore[method-assign]
            yield task
        self.tasks.append(record | {"seconds": time.monotonic() - begun})


def run(case: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a case and return what its tasks reported."""
    text = (HERE.parent / "examples" / f"{case['example']}.yaml").read_text(encoding="utf-8")
    settings, console = yaml.safe_load(text), Recorder()
    for key, value in case["settings"].items():
        *path, last = key.split("/")
        at = settings
        for part in path:
            at = at.setdefault(part, {})
        at[last] = value
    config = validated(YamlDocument.of(settings, Path()))
    with tempfile.TemporaryDirectory() as folder, RunFolder.claim(Path(folder) / "run", config) as claimed:
        pipeline.solve_reference(claimed, config, console=console)
        pipeline.sample(claimed, config, console=console)
        pipeline.train(claimed, config, console=console)
        pipeline.solve(claimed, config, console=console, laws=case.get("laws", ["surrogate", "linear"]))
    return console.tasks


def main(folder: Path, names: list[str]) -> None:
    """Run the cases, and print a row for each task that was long enough."""
    cases = yaml.safe_load((HERE / "clock_cases.yml").read_text(encoding="utf-8"))
    folder.mkdir(exist_ok=True)
    rows, factors = [], []
    for name in names or cases:
        path = folder / f"{name}.json"
        if not path.exists():
            path.write_text(json.dumps(run(cases[name])), encoding="utf-8")
        for task in json.loads(path.read_text(encoding="utf-8")):
            seconds = task["seconds"]
            if seconds < SHORTEST:
                continue
            now, left = [(0.0, None), *(r for r in task["reports"] if r[0] <= SHARE * seconds)][-1]
            factor = None if left is None else left / (seconds - now)
            factors.append(factor)
            shown = next((at / seconds for at, left in task["reports"] if left is not None), None)
            said = ["–" if value is None else f"{value:.2f}" for value in (factor, shown)]
            rows.append([name, task["title"], f"{seconds:.1f}", *said])
    header = ["run", "task", "s", "left at a fifth, of what was left", "first shown at, of the time"]
    print(table("(n) Clocks", header, rows))
    given = [factor for factor in factors if factor is not None]
    good = sum(0.5 <= factor <= 2 for factor in given)
    print(
        f"{len(rows)} tasks; {len(given)} showed an estimate at a fifth, {good} of them within a factor of two"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
