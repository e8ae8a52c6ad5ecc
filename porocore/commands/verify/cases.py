"""List of all verification cases, their selection, their solution by every backend, and the JSON file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from porocore.commands.backends import FEM, Backends, advice, attempt, find_backends
from porocore.commands.verify import cell_cases, linear_cases, memory_cases, relaxation_cases, xie_leo
from porocore.commands.verify.case import Check, VerificationCase
from porocore.core.echo import echo
from porocore.core.files.plain_data import json_ready
from porocore.errors import ConfigurationError, PluginError
from porocore.plugins.registry import registry

CASES: dict[str, VerificationCase] = {
    case.name: case
    for case in (
        cell_cases.CHANNEL,
        cell_cases.SPHERE_ARRAY,
        cell_cases.CYLINDER_ARRAY,
        cell_cases.HOMOGENEOUS,
        cell_cases.IDENTITIES,
        relaxation_cases.RELAXATION,
        linear_cases.TERZAGHI_CASE,
        linear_cases.MANDEL_CASE,
        linear_cases.UNCONFINED,
        xie_leo.CASE,
        linear_cases.SMALL_STRAIN,
        memory_cases.RELAXING_LAYER,
        memory_cases.CHARGES,
    )
}


@dataclass(frozen=True)
class CaseResult:
    """One line of the table: a check, or the reason why there is none, which is a failure.

    Attributes
    ----------
    case, item, backend
        By name; a plugin that cannot be used has neither case nor item.
    check
        None where the backend raised an exception.
    reason
        What it said; else empty.
    seconds
        Wall time of the item.
    """

    case: str
    item: str
    backend: str
    check: Check | None
    reason: str = ""
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """True if the backend gave a result within the allowed error."""
        return self.check is not None and self.check.passed

    def as_data(self) -> dict[str, Any]:
        """Return the line as plain data."""
        found: dict[str, Any] = {
            "case": self.case,
            "item": self.item,
            "backend": self.backend,
            "passed": self.passed,
            "seconds": round(self.seconds, 3),
            "source": CASES[self.case].source if self.case else "",
        }
        if self.check is None:
            return found | {"reason": self.reason}
        names = ("quantity", "reference", "ours", "error", "allowed", "order", "note")
        return found | {name: getattr(self.check, name) for name in names}

    def describe(self) -> str:
        """Return the line as text."""
        where = ", ".join(part for part in (self.case, self.item, self.backend) if part)
        if self.check is None:
            return f"{where}: {self.reason}"
        return (
            f"{where}: {self.check.quantity}: error {self.check.error:.2e}, allowed {self.check.allowed:.2g}"
        )


def select_solvers(fem: Sequence[str] = ()) -> Backends:
    """Return the installed finite-element backends, or the named ones.

    Raises
    ------
    PluginError
        A name is unknown or cannot be used, or there is none.
    """
    found = find_backends({FEM: fem})
    if fem:
        return Backends(found.names)
    if not any(found.names.values()):
        why = advice((*found.broken, *found.missing))
        raise PluginError(
            f"there is no finite-element backend; install one: {'; '.join(why) or 'see docs/plugins.md'}"
        )
    return found


def select_cases(names: Sequence[str] = ()) -> list[VerificationCase]:
    """Return the named cases, all by default, in the order of :data:`CASES`.

    Raises
    ------
    ConfigurationError
        There is no case of that name.
    """
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise ConfigurationError(f"--case: unknown case {echo(unknown[0])}; the cases are {', '.join(CASES)}")
    return [case for name, case in CASES.items() if not names or name in names]


def run_cases(
    cases: Sequence[VerificationCase],
    backends: Backends,
    *,
    long: bool = False,
    on_item: Callable[[str, int, int], None] | None = None,
) -> list[CaseResult]:
    """Solve every item of every case with every backend; an exception becomes a failed row.

    ``on_item`` receives the next item, the number of finished items and the number of all.
    """
    todo = [
        (case, item, backend)
        for case in cases
        for item in case.items
        for backend in backends.names[case.kind]
    ]
    rows = list(
        dict.fromkeys(
            CaseResult("", "", row.distribution, None, f"{row.state}: {row.advice}")
            for row in backends.broken
        )
    )
    for done, (case, item, backend) in enumerate(todo):
        if on_item is not None:
            on_item(f"{case.name}, {item}, {backend}", done, len(todo))
        rows += solve_item(case, item, backend, long=long)
    if on_item is not None:
        on_item("", len(todo), len(todo))
    return rows


def solve_item(case: VerificationCase, item: str, backend: str, *, long: bool = False) -> list[CaseResult]:
    """Return the results of one item with one backend."""
    outcome = attempt(lambda: case.items[item](registry().get(case.kind, backend)(), long))
    if outcome.value is None:
        return [CaseResult(case.name, item, backend, None, outcome.reason, outcome.seconds)]
    return [CaseResult(case.name, item, backend, check, "", outcome.seconds) for check in outcome.value]


FORMAT, VERSION = "porocore-verification", 1


def document(rows: Sequence[CaseResult], *, long: bool) -> dict[str, Any]:
    """Return all results as plain data; a number that is not finite is null."""
    found = {
        "format": FORMAT,
        "version": VERSION,
        "form": "long" if long else "short",
        "passed": all(row.passed for row in rows),
        "rows": [row.as_data() for row in rows],
    }
    ready: dict[str, Any] = json_ready(found)
    return ready
