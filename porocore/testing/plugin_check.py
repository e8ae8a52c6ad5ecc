"""Run of the suites of an installed plugin (check_plugin): starts a process, reads the results.

The process (:mod:`porocore.testing.plugin_process`) runs pytest on the suites that the plugin's offer names and prints
each result as a line, so that a plugin that kills its process, or changes how pytest works, does no harm here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from porocore.core.console import Task
from porocore.core.echo import choices, did_you_mean
from porocore.errors import PluginError
from porocore.plugins.discovery import Offered
from porocore.plugins.kinds import FIRST_PARTY, KINDS, Kind
from porocore.plugins.registry import registry

Result = Literal["passed", "failed", "expected failure", "skipped"]
#: Lines of what a process said before it died that are shown.
LAST = 6


class UnknownCheck(PluginError):
    """The suites of a plugin have no check of a name, but the ``checks``, in words."""

    def __init__(self, name: str, checks: Sequence[str]) -> None:
        near = did_you_mean(check_text(name), checks, most=3, cutoff=0.4) or choices(
            checks, "there are", "it has none"
        )
        super().__init__(f"--only: there is no check '{check_text(name)}'; {near}")


def check_text(check: str) -> str:
    """Return the name of a check as a reader reads it."""
    return check.removeprefix("test_").replace("_", " ")


@dataclass(frozen=True)
class CheckResult:
    """One check, in one case, and whether the plugin passes it.

    Attributes
    ----------
    kind, plugin
        Of the plugin.
    suite, law, case
        Class, test (the check) and parameters; the case is empty where there is one only.
    result, reason
        Why it failed, was expected to, or was left out; empty where it passed.
    details
        pytest's account of a failure.
    seconds
        How long it took.
    """

    kind: Kind
    plugin: str
    suite: str
    law: str
    case: str
    result: Result
    reason: str
    details: str
    seconds: float

    @property
    def text(self) -> str:
        """The check as a reader reads it."""
        text = check_text(self.law)
        return f"{text} [{self.case}]" if self.case else text


def find_offers(name: str, kind: Kind | None = None) -> list[Offered]:
    """Return the offers under a name, of every kind or of one.

    Raises
    ------
    PluginError
        Nothing is, or it is offered twice or lacks a module.
    """
    known = registry()
    kinds = [k for k in KINDS if name in known.names(k)]
    if kind is not None:
        return [known.find(kind, name)]
    if not kinds and name in FIRST_PARTY:
        return [known.find(FIRST_PARTY[name][1][0], name)]
    if not kinds:
        everything = sorted({offered.offer.name for offered in known.offers})
        faults = "".join(f"; the plugin of {b.source}: {b.reason}" for b in known.broken)
        raise PluginError(
            f"expected the name of an installed plugin, got '{name}'; {choices(everything, 'there are')}{faults}"
        )
    return [known.find(k, name) for k in kinds]


def check_plugin(offered: Offered, task: Task, only: str = "") -> list[CheckResult]:
    """Run the suites of one offer.

    Parameters
    ----------
    offered
        From :func:`find_offers`.
    task
        Its work is the checks.
    only
        The one check to hold it to, by its name or in words; empty: all.

    Raises
    ------
    UnknownCheck
        There is no check ``only``.
    PluginError
        pytest is missing, the class or its suites cannot be loaded, or the process died.
    """
    if find_spec("pytest") is None:
        raise PluginError("checking a plugin needs pytest, which is not installed here: pip install pytest")
    kind, name = offered.kind, offered.offer.name
    environment = {k: v for k, v in os.environ.items() if k != "PYTEST_ADDOPTS"}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    with TemporaryDirectory(prefix="porocore-check-") as folder:
        log = Path(folder) / "log"
        command = [sys.executable, "-m", "porocore.testing.plugin_process", kind, name, folder, only]
        with (
            log.open("wb") as said,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, env=environment) as process,
        ):
            try:
                results, last = _follow(process, task)
            except BaseException:
                process.terminate()
                raise
        if "fault" in last:
            raise PluginError(str(last["fault"]))
        if "unknown" in last:
            raise UnknownCheck(only, last["unknown"])
        if "end" not in last or not results:
            said_last = " | ".join(log.read_text("utf-8", "replace").split("\n")[-LAST:]).strip(" |")
            raise PluginError(
                f"the check of {kind} '{name}' of {offered.source} ended after {len(results)} checks with exit status "
                f"{process.returncode}: {said_last or 'it said nothing'}; report this to its authors"
            )
    return results


def _follow(process: subprocess.Popen[bytes], task: Task) -> tuple[list[CheckResult], dict[str, Any]]:
    """Return the results that a process writes, and its last line."""
    results: list[CheckResult] = []
    line: dict[str, Any] = {}
    total = 0
    for text in process.stdout or ():
        line = json.loads(text)
        total = line.get("total", total)
        if "check" in line:
            results.append(CheckResult(**line["check"]))
        failed = sum(result.result == "failed" for result in results)
        task.update(len(results), total, failed=failed, detail=line.get("start", ""))
    return results, line
