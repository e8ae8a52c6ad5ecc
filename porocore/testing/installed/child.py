"""Process of a plugin check: pytest on the suites of one offer, each result a line of a file."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry
from porocore.testing.installed.check import LawResult, Result, law_text


def collect_suites(kind: Kind, name: str) -> dict[str, type[Any]]:
    """The suites of a plugin, by names that pytest collects."""
    from porocore.testing.installed.suites import find_suites

    offered = registry().find(kind, name)
    suites = find_suites(kind, offered.offer, registry().get(kind, name))
    if offered.offer.suites is None:
        suites[0].recipe = ("porocore.testing.installed.child:default_suite", kind, name)
    return {s.__name__ if s.__name__.startswith("Test") else f"Test{s.__name__}": s for s in suites}


def default_suite(kind: Kind, name: str) -> type[Any]:
    """Return the suite of a plugin that has none of its own."""
    (suite,) = collect_suites(kind, name).values()
    return suite


class _Reporter:
    """A pytest plugin that writes a line for each law."""

    def __init__(self, kind: Kind, name: str, path: Path, only: str) -> None:
        self.kind, self.name, self.only = kind, name, law_text(only)
        self._unknown: list[str] = []
        self._file = path.open("a", encoding="utf-8")
        self._fault = ""

    def write(self, **line: Any) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            text = str(getattr(getattr(report.longrepr, "reprcrash", None), "message", report.longrepr))
            text = next((part for part in reversed(text.splitlines()) if part.strip()), text)
            self._fault = text.removeprefix("E").strip().removeprefix("porocore.errors.PluginError: ")

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if not self.only:
            return
        laws = {law_text(item.originalname): None for item in items}
        if self.only not in laws and not self._fault:
            self._unknown = list(laws)
        items[:] = [item for item in items if law_text(item.originalname) == self.only]

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        law, _, case = nodeid.rpartition("::")[2].partition("[")
        self.write(start=law_text(law) + (f" [{case}" if case else ""))

    def pytest_collection_finish(self, session: Any) -> None:
        self.write(total=len(session.items))

    def pytest_runtest_logreport(self, report: Any) -> None:
        # A law is reported when it was called, or when its set-up did not let it be called.
        if report.when != "call" and not (report.when == "setup" and not report.passed) and not report.failed:
            return
        _, suite, law = report.nodeid.split("::")
        law, _, case = law.partition("[")
        result, reason, details = _outcome(report)
        tested = LawResult(
            self.kind, self.name, suite, law, case.removesuffix("]"), result, reason, details, report.duration
        )
        self.write(law=asdict(tested))

    def close(self, status: int) -> None:
        if self._fault:
            self.write(fault=self._fault)
        elif self._unknown:
            self.write(unknown=self._unknown)
        else:
            self.write(end=status)
        self._file.close()


def _outcome(report: Any) -> tuple[Result, str, str]:
    if report.passed:
        return "passed", "", ""
    if report.skipped:
        if hasattr(report, "wasxfail"):
            return "expected failure", str(report.wasxfail).removeprefix("reason: "), ""
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        return "skipped", reason.removeprefix("Skipped: "), ""
    crash = getattr(report.longrepr, "reprcrash", None)
    message = str(crash.message if crash else report.longrepr)
    first = " ".join(message.splitlines()[0].split()) if message.strip() else "failed without a message"
    return "failed", first.removeprefix("Failed: ").removeprefix("AssertionError: "), report.longreprtext


def _main(arguments: Sequence[str]) -> int:
    """Run pytest; the results go into the folder's ``report``."""
    import pytest

    kind, name, folder, only = cast(Kind, arguments[0]), *arguments[1:]
    here = Path(folder)
    module = here / "test_laws.py"
    module.write_text(
        "from porocore.testing.installed.child import collect_suites\n\n"
        f"globals().update(collect_suites({kind!r}, {name!r}))\n",
        encoding="utf-8",
    )
    (here / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    reporter = _Reporter(kind, name, here / "report", only)
    options = ["-p", "no:cacheprovider", "--import-mode=importlib", f"--rootdir={folder}"]
    options += ["-c", str(here / "pytest.ini"), f"--basetemp={here / 'files'}", str(module)]
    status = int(pytest.main(options, plugins=[reporter]))
    reporter.close(status)
    return status


if __name__ == "__main__":
    raise SystemExit(_main(sys.argv[1:]))
