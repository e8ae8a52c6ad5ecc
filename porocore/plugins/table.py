"""Rows of ``porocore plugins``: every plugin with its state and advice; version of the conformance kit.

The first number is raised when a check is added or sharpened, so that a plugin that passed may fail; the second when
suites gain something that no passing plugin can notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from porocore.plugins.discovery import Broken, Offered, Source
from porocore.plugins.hookspecs import short_repr
from porocore.plugins.kinds import FIRST_PARTY, Kind

State = Literal["ready", "missing dependency", "other interface", "broken", "offered twice", "not installed"]
#: Seconds of importing the module of an entry point beyond which it is reported; every command waits for it.
SLOW = 1.0


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
    notes
        What its authors should mend although it works.
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
    notes: tuple[str, ...] = ()


def plugin_rows(offers: Sequence[Offered], broken: Sequence[Broken]) -> list[PluginRow]:
    """Return every plugin with its state and what to do about it."""
    rows = []
    for offered in offers:
        kind, offer = offered.kind, offered.offer
        state: State = "ready"
        advice = ""
        same = [o for o in offers if (o.kind, o.offer.name) == (kind, offer.name)]
        if len(same) > 1:
            state = "offered twice"
            advice = repeated(same) or f"uninstall one: pip uninstall {offered.source.distribution}"
        elif offered.missing:
            state, advice = "missing dependency", offered.install
        source, modules = offered.source, tuple(offer.requires)
        row = PluginRow(
            kind, offer.name, str(source), state, offer.summary, advice, source, offered.interface, modules
        )
        rows.append(replace(row, notes=notes_on(source)))
    for failed in broken:
        source, state = failed.source, "other interface" if failed.kind else "broken"
        row = PluginRow(
            failed.kind, source.entry_point, str(source), state, "", failed.reason, source, failed.interface
        )
        rows.append(replace(row, notes=notes_on(source)))
    there = {(offered.kind, offered.offer.name) for offered in offers}
    failing = {(failed.source.distribution, failed.kind) for failed in broken}
    for name, (distribution, kinds) in FIRST_PARTY.items():
        advice = f"pip install {distribution}"
        for kind in kinds:
            if (kind, name) not in there and not failing & {(distribution, ""), (distribution, kind)}:
                rows.append(PluginRow(kind, name, distribution, "not installed", "", advice))
    return rows


def repeated(found: Sequence[Offered]) -> str:
    """Return the complaint about a distribution that offers one name several times; empty where several do."""
    source = found[0].source
    if len({offered.source.distribution for offered in found}) > 1:
        return ""
    return f"{source.in_full} offers it {len(found)} times; report this to its authors"


def notes_on(source: Source) -> tuple[str, ...]:
    """Return what the authors of a plugin should mend although it works."""
    notes = []
    if source.seconds > SLOW:
        notes.append(
            f"importing {source.file} took {source.seconds:.1f} s, for which every command waits; import what is "
            "heavy in Offer.load"
        )
    if printed := " ".join(source.printed.split()):
        notes.append(f"{source.file} prints when it is imported: {short_repr(printed)}")
    return tuple(notes)


KIT_VERSION = "5.0"


def complaint(pinned: str) -> str:
    """Return why a suite that pins ``pinned`` does not fit this kit, and what to do; empty if it fits."""
    major = KIT_VERSION.partition(".")[0]
    if not pinned:
        return f'pins no version of the kit; write kit_version = "{major}" in the class'
    wanted, _, minor = pinned.partition(".") if isinstance(pinned, str) else ("", "", "")
    numbers = (wanted, minor or "0")
    if not all(number.isdecimal() for number in numbers):
        return f'kit_version: expected a text such as "{major}" or "{KIT_VERSION}", got {pinned!r}'
    here = tuple(map(int, KIT_VERSION.split(".")))
    asked = tuple(map(int, numbers))
    if asked[0] < here[0]:
        return (
            f"was made for version {pinned} of the kit, and this porocore has {KIT_VERSION}, with sharper checks; "
            f'see which of them fail below, mend them, and write kit_version = "{major}"'
        )
    if asked > here:
        return (
            f"was made for version {pinned} of the kit, and this porocore has {KIT_VERSION}; "
            "install a newer one: pip install --upgrade porocore"
        )
    return ""
