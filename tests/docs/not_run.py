"""Shown commands that no test can run, and why; every other one is executed."""

from __future__ import annotations

import re

#: By a pattern that the whole command matches.
REASONS: dict[str, str] = {
    r"make [a-z-]+( .*)?": "sets the environment up or runs all tests; that the target exists is tested",
    r"(sudo )?apt-get install .*": "needs root and a network",
    r"/usr/bin/python3 -m venv .*": "makes the environment in which the tests run",
    r"\S*pip install -c constraints/.*": "needs a network; the tests run in its outcome",
    r"pip install '?porocore\[.*": "needs the distributions of a release; that the extras exist is tested",
    r"pip install \. \./plugins/.*": "needs an index with torch; that the folders are distributions is tested",
    r"pip install distributed": "needs an index; the tests have it",
    r"podman .*": "needs a container engine; that the Containerfile names what exists is tested",
    r"sudo (NEWEST=1 )?sh tools/debian\.sh \w+": "needs root and a network",
    r"\.venv/bin/python benchmarks/\w+\.py( .*)?": "takes an hour; that the script takes these arguments is tested",
}


def reason(command: str) -> str | None:
    """Why it is not run; None: it is."""
    for pattern, why in REASONS.items():
        if re.fullmatch(pattern, command.split(" #")[0].strip()):
            return why
    return None
