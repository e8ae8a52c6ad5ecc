"""Installed backends that take part in a comparison, why others do not, and calls of them that may fail."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, ParamSpec, TypeVar

from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry
from porocore.plugins.table import PluginRow

FEM: tuple[Kind, ...] = ("cell solver", "macro solver")


@dataclass(frozen=True)
class Backends:
    """Backends of some kinds.

    Attributes
    ----------
    names
        By kind, those that take part: they can be loaded, as far as can be told without loading them.
    broken
        Plugins that are installed and cannot be used.
    missing
        Plugins, known or installed, that lack something.
    """

    names: dict[Kind, tuple[str, ...]]
    broken: tuple[PluginRow, ...] = ()
    missing: tuple[PluginRow, ...] = ()

    @property
    def absent(self) -> tuple[str, ...]:
        """Installed plugins whose requirements are not, with what installs those."""
        return advice(row for row in self.missing if row.state == "missing dependency")


def advice(rows: Iterable[PluginRow]) -> tuple[str, ...]:
    """Return the state of each plugin and what to do about it."""
    return tuple(dict.fromkeys(f"{row.name} ({row.state}): {row.advice}" for row in rows))


def find_backends(wanted: Mapping[tuple[Kind, ...], Sequence[str]]) -> Backends:
    """Return the installed backends of some kinds, or those that are named; ``wanted`` has names by groups of kinds.

    Raises
    ------
    PluginError
        A name is unknown to all kinds of its group, or cannot be used.
    """
    table = registry().table()
    names: dict[Kind, tuple[str, ...]] = {}
    for kinds, asked in wanted.items():
        for kind in kinds:
            names[kind] = tuple(
                sorted({row.name for row in table if (row.kind, row.state) == (kind, "ready")})
            )
        for name in asked:
            if not any(name in names[kind] for kind in kinds):
                registry().find(kinds[0], name)
        if asked:
            for kind in kinds:
                names[kind] = tuple(name for name in dict.fromkeys(asked) if name in names[kind])
    useless = ("broken", "offered twice")
    return Backends(
        names,
        tuple(row for row in table if row.state in useless and row.kind in (*names, "")),
        tuple(row for row in table if row.state not in (*useless, "ready") and row.kind in names),
    )


T = TypeVar("T")
P = ParamSpec("P")


@dataclass(frozen=True)
class TimedOutcome(Generic[T]):
    """Value of a call, or the reason of its failure, and the wall time [s]."""

    value: T | None
    reason: str
    seconds: float


def attempt(what: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> TimedOutcome[T]:
    """Call foreign code; whatever it raises is the reason."""
    began = time.perf_counter()
    try:
        value = what(*args, **kwargs)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - foreign code, kept and shown
        text = " ".join(str(error).split()) or "no message"
        return TimedOutcome(None, f"{type(error).__name__}: {text}", time.perf_counter() - began)
    return TimedOutcome(value, "", time.perf_counter() - began)
