"""(n) How good the time left is that the progress shows: the estimate at a fifth of the time, against what was left.

    python benchmarks/clocks.py FOLDER [CASE …] [--clock cpu] [--slower FACTOR]

Twenty coarse variants of the examples, in ``clock_cases.yml``: bodies, laws, samplers and surrogates of all kinds,
ramps, bends and cycles, steps of equal length and steps by their error. What each task told its forecast, and when, is
kept in the folder, and a case that lies there is not run again: the estimates depend on nothing else, so they are those
that the present sources would have shown. With ``--clock cpu`` time is the processor time of all processes of the run,
which a busy machine does not stretch; ``--slower 5`` stretches it as a machine does that is five times slower.

For a task shorter than ``PROMISED`` seconds no estimate is promised, and it is left out.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import yaml
from clock_traces import recorded, replayed
from common import table

from porocore.core.console import duration
from porocore.core.files.yaml_document import YamlDocument
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import validated

HERE = Path(__file__).parent
#: Shortest task [s] for which an estimate is promised at a fifth of its time.
PROMISED = 10.0
SHARE, FACTOR = 0.2, 2.0


def configuration(case: dict[str, Any]) -> RunConfig:
    """Return the configuration of a case; a setting that is null is left out."""
    text = (HERE.parent / "examples" / f"{case['example']}.yaml").read_text(encoding="utf-8")
    settings = yaml.safe_load(text)
    for key, value in case["settings"].items():
        *path, last = key.split("/")
        at = settings
        for part in path:
            at = at.setdefault(part, {})
        at[last] = value
        if value is None:
            del at[last]
    return validated(YamlDocument.of(settings, Path()))


def judged(task: dict[str, Any], config: RunConfig, clock: str, slower: float) -> list[str] | None:
    """Return title, time, estimate, ratio and verdict of a task; None where no estimate is promised."""
    reports, seconds = replayed(task, config, clock, slower)
    if seconds < PROMISED:
        return None
    before = [report for report in reports if report[0] <= SHARE * seconds]
    now, left = before[-1] if before else (0.0, None)
    row = [task["title"], f"{seconds:.0f}"]
    if left is None:
        return [*row, "–", "–", "no"]
    ratio = left / (seconds - now)
    good = 1 / FACTOR <= ratio <= FACTOR
    return [*row, f"{duration(left)} of {duration(seconds - now)}", f"{ratio:.2f}", "yes" if good else "no"]


def main(options: argparse.Namespace) -> None:
    """Run the cases that are not yet in the folder, and print a row for each task that was long enough."""
    cases = yaml.safe_load((HERE / "clock_cases.yml").read_text(encoding="utf-8"))
    options.folder.mkdir(exist_ok=True)
    rows, good = [], 0
    names = options.cases or cases
    for name in names:
        path, config = options.folder / f"{name}.json", configuration(cases[name])
        if not path.exists():
            laws = cases[name].get("laws", ["surrogate", "linear"])
            path.write_text(json.dumps(recorded(config, laws)), encoding="utf-8")
        tasks = json.loads(path.read_text(encoding="utf-8"))
        found = [judged(task, config, options.clock, options.slower) for task in tasks]
        of_case = [[name, *row] for row in found if row is not None]
        good += bool(of_case) and all(row[-1] == "yes" for row in of_case)
        rows += of_case or [[name, f"none of {PROMISED:g} s", "–", "–", "–", "–"]]
    print(table("(n) Clocks", ["run", "task", "s", "left at a fifth", "ratio", "within two"], rows))
    tasks = [row for row in rows if row[2] != "–"]
    yes = sum(row[-1] == "yes" for row in tasks)
    print(f"{yes} of {len(tasks)} tasks within a factor of two; all of them in {good} of {len(names)} runs")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    parser.add_argument("--slower", type=float, default=1.0)
    main(parser.parse_args())
