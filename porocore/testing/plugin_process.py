"""Process of a plugin check: the suites of one offer, pytest on them, each result a line of standard output."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import pytest

from porocore import testing
from porocore.errors import PluginError
from porocore.plugins.hookspecs import CommandOffer, Offer
from porocore.plugins.kinds import KINDS, Kind
from porocore.plugins.registry import registry
from porocore.plugins.table import KIT_VERSION
from porocore.testing.plugin_check import CheckResult, Result, check_text
from porocore.testing.suite import Suite


def find_suites(kind: Kind, offer: Offer, implementation: type[Any]) -> list[type[Suite]]:
    """Return the suites that an offer names; where it names none, that of its kind with default options.

    Raises
    ------
    PluginError
        They cannot be loaded, are no suites, or are suites of another kind only.
    """
    if offer.suites is None:
        return [_default(kind, offer, implementation)]
    try:
        found = list(offer.suites())
    except Exception as error:  # foreign code; its reason goes into the message
        raise PluginError(
            f"the suites of {kind} '{offer.name}' cannot be loaded: {type(error).__name__}: {error}; "
            "report this to its authors"
        ) from error
    for suite in found:
        if not (isinstance(suite, type) and issubclass(suite, Suite)):
            raise PluginError(
                f"the suites of {kind} '{offer.name}': expected suites of porocore.testing, got {suite!r}; "
                "report this to its authors"
            )
    if not any(issubclass(suite, _suite(kind)) for suite in found):
        raise PluginError(
            f"the suites of {kind} '{offer.name}': expected a subclass of porocore.testing.{KINDS[kind].suite}, "
            f"got {', '.join(suite.__name__ for suite in found) or 'none'}; report this to its authors"
        )
    return found


def _default(kind: Kind, offer: Offer, implementation: type[Any]) -> type[Suite]:
    """Return the suite of a plugin without suites of its own: with default options, of the present version."""

    def make(cls: Any, *inputs: Any, **options: Any) -> Any:
        return implementation(*inputs, **options)

    members: dict[str, Any] = {KINDS[kind].factory: classmethod(make), "kit_version": KIT_VERSION}
    if kind == "surrogate":
        members["resumable"] = members["random"] = None
    if isinstance(offer, CommandOffer):
        members["name"] = f"{offer.group} {offer.name}".strip()
    words = "".join(word.capitalize() for word in offer.name.replace("-", "_").split("_"))
    return type(f"Test{words}", (_suite(kind),), members)


def _suite(kind: Kind) -> type[Suite]:
    found: type[Suite] = getattr(testing, KINDS[kind].suite)
    return found


def collect_suites(kind: Kind, name: str) -> dict[str, type[Any]]:
    """Return the suites of a plugin, by names that pytest collects."""
    offered = registry().find(kind, name)
    suites = find_suites(kind, offered.offer, registry().get(kind, name))
    if offered.offer.suites is None:
        suites[0].recipe = ("porocore.testing.plugin_process:default_suite", kind, name)
    return {s.__name__ if s.__name__.startswith("Test") else f"Test{s.__name__}": s for s in suites}


def default_suite(kind: Kind, name: str) -> type[Any]:
    """Return the suite of a plugin that has none of its own."""
    (suite,) = collect_suites(kind, name).values()
    return suite


class _Reporter:
    """A pytest plugin that writes a line for each check."""

    def __init__(self, kind: Kind, name: str, only: str) -> None:
        self.kind, self.name, self.only = kind, name, check_text(only)
        self._unknown: list[str] = []
        # Standard output is for these lines; whatever pytest and the plugin print goes to standard error.
        self._file = os.fdopen(os.dup(1), "w", encoding="utf-8")
        os.dup2(2, 1)
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
        checks = {check_text(item.originalname): None for item in items}
        if self.only not in checks and not self._fault:
            self._unknown = list(checks)
        items[:] = [item for item in items if check_text(item.originalname) == self.only]

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        check, _, case = nodeid.rpartition("::")[2].partition("[")
        self.write(start=check_text(check) + (f" [{case}" if case else ""))

    def pytest_collection_finish(self, session: Any) -> None:
        self.write(total=len(session.items))

    def pytest_runtest_logreport(self, report: Any) -> None:
        # A check is reported when it was called, or when its set-up did not let it be called.
        if report.when != "call" and not (report.when == "setup" and not report.passed) and not report.failed:
            return
        _, suite, check = report.nodeid.split("::")
        check, _, case = check.partition("[")
        result, reason, details = _outcome(report)
        tested = CheckResult(
            self.kind,
            self.name,
            suite,
            check,
            case.removesuffix("]"),
            result,
            reason,
            details,
            report.duration,
        )
        self.write(check=asdict(tested))

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
    """Run pytest on the suites of an offer in a folder; the results go to standard output."""
    kind, name, folder, only = cast(Kind, arguments[0]), *arguments[1:]
    here = Path(folder)
    module = here / "test_checks.py"
    module.write_text(
        "from porocore.testing.plugin_process import collect_suites\n\n"
        f"globals().update(collect_suites({kind!r}, {name!r}))\n",
        encoding="utf-8",
    )
    (here / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    reporter = _Reporter(kind, name, only)
    options = ["-p", "no:cacheprovider", "--import-mode=importlib", f"--rootdir={folder}"]
    options += ["-c", str(here / "pytest.ini"), f"--basetemp={here / 'files'}", str(module)]
    status = int(pytest.main(options, plugins=[reporter]))
    reporter.close(status)
    return status


if __name__ == "__main__":
    raise SystemExit(_main(sys.argv[1:]))
