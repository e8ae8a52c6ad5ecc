"""Run of the suites of an installed plugin (check_plugin): starts a process, reads the results.

The process runs pytest on the suites that the plugin's offer names and tells each result in a line of a file, so that
a plugin that kills its process, or changes how pytest works, does no harm here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from porocore.core.echo import choices, did_you_mean
from porocore.errors import PluginError
from porocore.plugins.discovery import Offered
from porocore.plugins.kinds import FIRST_PARTY, KINDS, Kind
from porocore.plugins.registry import registry

Result = Literal["passed", "failed", "expected failure", "skipped"]
#: Seconds between two looks at what the process has told.
INTERVAL = 0.1
#: Lines of what a process said before it died that are shown.
LAST = 6


class UnknownLaw(PluginError):
    """The suites of a plugin have no law of a name.

    Attributes
    ----------
    laws
        Those that they have, in words.
    """

    def __init__(self, name: str, laws: Sequence[str]) -> None:
        near = did_you_mean(law_text(name), laws, most=3, cutoff=0.4) or choices(
            laws, "there are", "it has none"
        )
        super().__init__(f"--only: there is no law '{law_text(name)}'; {near}")
        self.laws = laws


def law_text(law: str) -> str:
    """Return the name of a law as a reader reads it."""
    return law.removeprefix("test_").replace("_", " ")


@dataclass(frozen=True)
class LawResult:
    """One law, in one case, and whether the plugin obeys it.

    Attributes
    ----------
    kind, plugin
        Of the plugin.
    suite, law, case
        Class, test and parameters; the case is empty where there is one only.
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
        """The law as a reader reads it."""
        text = law_text(self.law)
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


def check_plugin(
    offered: Offered,
    on_law: Callable[[LawResult, int], None] | None = None,
    *,
    only: str = "",
    on_start: Callable[[str, int], None] | None = None,
) -> list[LawResult]:
    """Run the suites of one offer.

    Parameters
    ----------
    offered
        From :func:`find_offers`.
    on_law
        Called with each result and the number of all.
    only
        The one law to hold it to, by its name or in words; empty: all.
    on_start
        Called with each law in words before it is tested, and the number of all.

    Raises
    ------
    UnknownLaw
        There is no law ``only``.
    PluginError
        pytest is missing, the class or its suites cannot be loaded, or the process died.
    """
    if find_spec("pytest") is None:
        raise PluginError("checking a plugin needs pytest, which is not installed here: pip install pytest")
    kind, name = offered.kind, offered.offer.name
    with TemporaryDirectory(prefix="porocore-check-") as folder:
        here = Path(folder)
        report, log = here / "report", here / "log"
        report.touch()
        environment = {k: v for k, v in os.environ.items() if k != "PYTEST_ADDOPTS"}
        environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        command = [sys.executable, "-m", "porocore.testing.installed.child", kind, name, folder, only]
        with (
            log.open("wb") as said,
            subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT, env=environment) as process,
        ):
            try:
                lines = _follow(process, report, on_law, on_start)
            except BaseException:
                process.terminate()
                raise
        if lines and "fault" in lines[-1]:
            raise PluginError(str(lines[-1]["fault"]))
        if lines and "unknown" in lines[-1]:
            raise UnknownLaw(only, lines[-1]["unknown"])
        laws = [LawResult(**line["law"]) for line in lines if "law" in line]
        if not lines or "end" not in lines[-1] or not laws:
            said_last = " | ".join(log.read_text("utf-8", "replace").split("\n")[-LAST:]).strip(" |")
            raise PluginError(
                f"the check of {kind} '{name}' of {offered.source} ended after {len(laws)} laws with exit status "
                f"{process.returncode}: {said_last or 'it said nothing'}; report this to its authors"
            )
    return laws


def _follow(
    process: subprocess.Popen[bytes],
    report: Path,
    on_law: Callable[[LawResult, int], None] | None,
    on_start: Callable[[str, int], None] | None,
) -> list[dict[str, Any]]:
    """The lines of a growing file, until the process ends."""
    lines: list[dict[str, Any]] = []
    total = 0
    with report.open(encoding="utf-8") as file:
        part = ""
        while True:
            ended = process.poll() is not None
            *whole, part = (part + file.read()).split("\n")
            for text in whole:
                line = json.loads(text)
                lines.append(line)
                total = line.get("total", total)
                if "start" in line and on_start is not None:
                    on_start(line["start"], total)
                if "law" in line and on_law is not None:
                    on_law(LawResult(**line["law"]), total)
            if ended:
                return lines
            time.sleep(INTERVAL)
