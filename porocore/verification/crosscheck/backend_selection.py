"""Backends that take part in a crosscheck."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from porocore.errors import PluginError
from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry
from porocore.verification.crosscheck.comparison import Comparison

FEM: tuple[Kind, ...] = ("cell solver", "macro solver")
KINDS: tuple[Kind, ...] = (*FEM, "surrogate")


@dataclass(frozen=True)
class BackendSelection:
    """Names of the backends of each kind.

    Attributes
    ----------
    cells, bodies, surrogates
        That can be loaded, as far as can be told without loading them.
    broken
        One failure for each plugin that is installed and cannot be used.
    absent
        Installed plugins whose requirements are not, with what installs those.
    """

    cells: tuple[str, ...]
    bodies: tuple[str, ...]
    surrogates: tuple[str, ...]
    broken: tuple[Comparison, ...] = ()
    absent: tuple[str, ...] = ()


def select_backends(fem: Sequence[str] = (), surrogates: Sequence[str] = ()) -> BackendSelection:
    """The installed backends, or those that are named.

    A backend whose requirements are not installed stays out; a plugin that is broken is a failure, unless
    both kinds are named.

    Raises
    ------
    PluginError
        A name is unknown or cannot be used; or there are not two of any kind, so that nothing can be compared.
    """
    ready: dict[Kind, list[str]] = {kind: [] for kind in KINDS}
    advice: dict[str, str] = {}
    broken: list[Comparison] = []
    absent: list[str] = []
    table = registry().table()
    for row in table:
        if row.state == "ready" and row.kind in ready:
            ready[row.kind].append(row.name)
        elif row.state in ("broken", "offered twice") and row.kind != "sampler":
            reason = f"{row.distribution} is {row.state}: {row.advice}"
            broken.append(Comparison.failure("plugin", row.kind, row.name, row.distribution, reason))
        elif row.kind in ready and row.advice:
            advice.setdefault(row.name, f"{row.name} ({row.state}): {row.advice}")
            if row.state == "missing dependency":
                absent.append(advice[row.name])
    chosen = BackendSelection(
        _chosen("cell solver", FEM, fem, ready),
        _chosen("macro solver", FEM, fem, ready),
        _chosen("surrogate", ("surrogate",), surrogates, ready),
        () if fem and surrogates else tuple(dict.fromkeys(broken)),
        () if fem or surrogates else tuple(dict.fromkeys(absent)),
    )
    if not chosen.cells:
        why = [f"{row.name} ({row.state}): {row.advice}" for row in table if row.kind in ("cell solver", "")]
        raise PluginError(
            f"there is nothing to compare: no cell solver takes part; install one: {'; '.join(why)}"
        )
    if not chosen.broken and max(map(len, (chosen.cells, chosen.bodies, chosen.surrogates))) < 2:
        named = [*dict.fromkeys((*chosen.cells, *chosen.bodies)), *chosen.surrogates]
        more = "; ".join(advice.values())
        if fem or surrogates:
            more = "leave out --fem and --surrogate, or repeat them"
        raise PluginError(
            "there is nothing to compare: a crosscheck needs two finite-element backends or two surrogates, and "
            f"there is only {' and '.join(named) or 'none'}; {more or 'install another (docs/plugins.md)'}"
        )
    return chosen


def _chosen(
    kind: Kind, either: Sequence[Kind], wanted: Sequence[str], ready: dict[Kind, list[str]]
) -> tuple[str, ...]:
    """Those of ``wanted`` that are offered as ``kind``, all if none is wanted; each must be one of ``either``."""
    for name in wanted:
        if not any(name in ready[other] for other in either):
            registry().find(either[0], name)
    names = sorted(set(ready[kind]))
    return tuple(name for name in dict.fromkeys(wanted) if name in names) if wanted else tuple(names)
