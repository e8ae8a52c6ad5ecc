"""Running suites of the conformance kit in a pytest of their own, without the settings of this repository."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

#: (class, check) → passed, failure, error or skipped, and the message, of each case of the check. An expected failure
#: is skipped. The class is named with its file.
Outcomes = dict[tuple[str, str], list[tuple[str, str]]]


def run_pytest(folder: Path, root: Path, nodes: Iterable[str]) -> Outcomes:
    """Of the nodes; ``folder`` takes the report, ``root`` is what classes are named from."""
    report = folder / "report.xml"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "--tb=line", "-p", "no:cacheprovider", "-c", os.devnull),
            *("--rootdir", str(root), f"--junitxml={report}", "--import-mode=importlib"),
            *("-o", f"pythonpath={Path(__file__).parents[2]}", *nodes),
        ],
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert report.exists(), done.stdout + done.stderr
    found: Outcomes = {}
    for case in ElementTree.parse(report).iter("testcase"):
        key = ".".join(case.attrib["classname"].rsplit(".", 2)[-2:]), case.attrib["name"].partition("[")[0]
        outcome = (case[0].tag, case[0].attrib.get("message", "")) if len(case) else ("passed", "")
        found.setdefault(key, []).append(outcome)
    return found
