"""How long it takes until something is there: the import, and the commands that compute nothing."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

from common import table

RUNS = 15
POROCORE = str(Path(sys.executable).with_name("porocore"))
NOTHING = "a Python that does nothing"
COMMANDS = {
    NOTHING: [sys.executable, "-c", "pass"],
    "`import porocore`": [sys.executable, "-c", "import porocore"],
    "`import porocore`, and everything that it offers": [
        *(sys.executable, "-c"),
        "import porocore; [getattr(porocore, name) for name in porocore.__all__]",
    ],
    "`porocore --help`": [POROCORE, "--help"],
    "`porocore run --help`": [POROCORE, "run", "--help"],
    "`porocore plugins`": [POROCORE, "plugins"],
    "`porocore units time=38`": [POROCORE, "units", "time=38"],
}


def seconds(command: list[str]) -> float:
    """Wall time of a process."""
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


def main() -> None:
    # All in turn, so that what else the machine does meets each; the first round fills the cache.
    rounds = [{name: seconds(command) for name, command in COMMANDS.items()} for _ in range(RUNS + 1)]
    found = {name: statistics.median(one[name] for one in rounds[1:]) for name in COMMANDS}
    rows = [
        [name, f"{1e3 * took:.0f}", "" if name == NOTHING else f"{1e3 * (took - found[NOTHING]):.0f}"]
        for name, took in found.items()
    ]
    print(table("Start", ["", "median, ms", "beyond Python's own, ms"], rows))


if __name__ == "__main__":
    main()
