"""Every plugin with its state, as ``porocore plugins`` shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from porocore.discovery import Broken, Offered, Source
from porocore.hookspecs import Kind
from porocore.plugin_kinds import FIRST_PARTY

State = Literal["ready", "missing dependency", "other interface", "broken", "offered twice", "not installed"]


@dataclass(frozen=True)
class PluginRow:
    """One line of ``porocore plugins``.

    Attributes
    ----------
    kind
        Empty for a plugin that broke before offering anything; its ``name`` is then that of the entry point.
    distribution
        Where it comes from, with the version where it is installed.
    state, advice
        Whether it works; else why not, and what to do.
    summary
        What it is.
    source
        The installed distribution in full; None where there is none.
    interface
        Version of the interface that it was made for; None where it offers nothing.
    modules
        What must be importable for it to work.
    """

    kind: Kind | Literal[""]
    name: str
    distribution: str
    state: State
    summary: str
    advice: str
    source: Source | None = None
    interface: int | None = None
    modules: tuple[str, ...] = ()


def plugin_rows(offers: Sequence[Offered], broken: Sequence[Broken]) -> list[PluginRow]:
    """Every plugin with its state and what to do about it."""
    rows = []
    for offered in offers:
        kind, offer = offered.kind, offered.offer
        state: State = "ready"
        advice = ""
        if len([o for o in offers if (o.kind, o.offer.name) == (kind, offer.name)]) > 1:
            state = "offered twice"
            advice = f"uninstall one: pip uninstall {offered.source.distribution}"
        elif offered.missing:
            state, advice = "missing dependency", offered.install
        source, modules = offered.source, tuple(offer.requires)
        rows.append(
            PluginRow(
                kind,
                offer.name,
                str(source),
                state,
                offer.summary,
                advice,
                source,
                offered.interface,
                modules,
            )
        )
    for failed in broken:
        source = failed.source
        state = "other interface" if failed.kind else "broken"
        rows.append(
            PluginRow(
                failed.kind,
                source.entry_point,
                str(source),
                state,
                "",
                failed.reason,
                source,
                failed.interface,
            )
        )
    there = {(offered.kind, offered.offer.name) for offered in offers}
    failing = {(failed.source.distribution, failed.kind) for failed in broken}
    for name, (distribution, kinds) in FIRST_PARTY.items():
        advice = f"pip install {distribution}"
        for kind in kinds:
            if (kind, name) not in there and not failing & {(distribution, ""), (distribution, kind)}:
                rows.append(PluginRow(kind, name, distribution, "not installed", "", advice))
    return rows
