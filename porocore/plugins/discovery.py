"""Offers of the installed packages, read from their entry points; broken ones are kept with the reason.

Nothing heavy is imported: listing plugins works when torch is slow to load, missing or broken.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from email import message_from_string
from email.message import Message
from functools import cache
from importlib import metadata
from typing import Any, Literal

import pluggy

from porocore.core.echo import did_you_mean, joined
from porocore.errors import PluginError
from porocore.plugins import hookspecs
from porocore.plugins.foreign_code import attempt, file_of, place_of, reason_of
from porocore.plugins.hookspecs import DECLARATION, Hooks, Offer, short_repr
from porocore.plugins.kinds import KINDS, OWN_HOOKS, PROJECT, Kind


@dataclass(frozen=True)
class Source:
    """Distribution and module that an offer comes from.

    Attributes
    ----------
    distribution, version, entry_point
        Names, and what the metadata say; the version is empty where they do not.
    requirements
        What the distribution needs, as its metadata says, without those of extras.
    file
        The module that the entry point names; where there is none, the folder of the distribution.
    seconds
        Wall time of importing that module [s].
    printed
        What it wrote to standard output when it was imported.
    """

    distribution: str
    version: str
    entry_point: str
    requirements: tuple[str, ...] = ()
    file: str = ""
    seconds: float = 0.0
    printed: str = ""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".rstrip()

    @property
    def in_full(self) -> str:
        """Text with the file."""
        return f"{self} ({self.file})" if self.file else str(self)


def entry_points() -> Iterator[tuple[Source, metadata.EntryPoint] | Broken]:
    """Yield each entry point once with its source, in the order of ``sys.path``."""
    seen: set[object] = set()
    for distribution in metadata.distributions():
        # Hundreds of distributions have no such group: nothing else of theirs is read.
        if f"[{PROJECT}]" not in _text_of(distribution, "entry_points.txt"):
            continue
        said = _headers(distribution)
        name = said["Name"] or "a distribution without METADATA"
        if name in seen or name == PROJECT:  # hidden by another of its name; own hooks are known
            continue
        seen.add(name)
        yield from _of(distribution, name, said, seen)


def _text_of(distribution: metadata.Distribution, file: str) -> str:
    """Return the text of a file of a distribution; empty where it cannot be read."""
    try:
        return distribution.read_text(file) or ""
    except Exception:  # noqa: BLE001 - faulty metadata of a package that has no part in this
        return ""


def _headers(distribution: metadata.Distribution) -> Message:
    """Return what the metadata say before the description, which is long."""
    text = _text_of(distribution, "METADATA") or _text_of(distribution, "PKG-INFO")
    return message_from_string(text.partition("\n\n")[0])


def _of(
    distribution: metadata.Distribution, name: str, said: Message, seen: set[object]
) -> Iterator[tuple[Source, metadata.EntryPoint] | Broken]:
    where = str(distribution.locate_file(""))
    read = attempt(lambda: distribution.entry_points.select(group=PROJECT))
    if read.error is not None:
        yield Broken(
            Source(name, "", "entry_points.txt", file=where),
            f"its entry_points.txt cannot be read: {reason_of(read.error)} ({where}); reinstall it",
        )
        return
    version, needs = said["Version"] or "", said.get_all("Requires-Dist") or ()
    requirements = tuple(text for text in needs if "extra ==" not in text.replace("'", '"'))
    for entry_point in read.value:
        if (name, entry_point.value) in seen:
            continue
        seen.add((name, entry_point.value))
        source = Source(name, version, entry_point.name, requirements, where)
        module = attempt(getattr, entry_point, "module")
        if module.error is None:
            yield replace(source, file=file_of(module.value) or where), entry_point
        else:
            wanted = f"entry point {entry_point.name}: expected a module, or module:attribute"
            yield Broken(source, f"{wanted}, got {short_repr(entry_point.value)} ({where})")


__all__ = ["Broken", "Offered", "Source", "discover"]


@dataclass(frozen=True)
class Offered:
    """One implementation and who offers it, made for which version of the interface."""

    kind: Kind
    offer: Offer
    source: Source
    interface: int = 1

    @property
    def missing(self) -> list[str]:
        """Required modules that are missing, found without importing them."""
        return [module for module in self.offer.requires if not _importable(module)]

    @property
    def install(self) -> str:
        """The command that installs it with all that it requires."""
        return self.offer.install or f"pip install {self.source.distribution}"


@dataclass(frozen=True)
class Broken:
    """A plugin that cannot be used, and why; of another interface than here, for which ``kind``."""

    source: Source
    reason: str
    kind: Kind | Literal[""] = ""
    interface: int | None = None


@cache
def own_offers() -> tuple[Offered, ...]:
    """Return the offers of porocore itself."""
    offers: list[Offered] = []
    broken: list[Broken] = []
    try:
        version = str(_headers(metadata.distribution(PROJECT))["Version"] or "")
    except metadata.PackageNotFoundError:
        version = ""
    for module in OWN_HOOKS:
        name = module.split(".")[1]
        source = Source(PROJECT, version, name, file=file_of(module))
        _read(source, metadata.EntryPoint(name, module, PROJECT), offers, broken)
    return tuple(offers)


def discover() -> tuple[list[Offered], list[Broken]]:
    """Read own hooks, and the entry points of group ``porocore`` one by one; a fault of one affects no other."""
    offers = list(own_offers())
    broken: list[Broken] = []
    for found in entry_points():
        if isinstance(found, Broken):
            broken.append(found)
        else:
            _read(*found, offers, broken)
    kinds = list(KINDS)
    return sorted(offers, key=lambda offered: kinds.index(offered.kind)), broken


def _read(
    source: Source, entry_point: metadata.EntryPoint, offers: list[Offered], broken: list[Broken]
) -> None:
    """Add what one entry point offers, and its faults."""
    named = entry_point.value.partition(":")[0].strip()

    def faulty(error: BaseException, what: str = "") -> Broken:
        place = (
            place_of(error, named) or f"entry point {entry_point.name} = {entry_point.value} in {source.file}"
        )
        return Broken(source, f"{what}{reason_of(error)} ({place})")

    loaded = attempt(entry_point.load)
    source = replace(source, seconds=loaded.seconds, printed=loaded.printed)
    if loaded.error is not None:
        broken.append(faulty(loaded.error))
        return
    declared = attempt(_declared, loaded.value)
    if declared.error is not None:
        broken.append(faulty(declared.error))
        return
    others = _of_other_interfaces(declared.value, source)
    broken += others
    hooks = attempt(_hooks, loaded.value, entry_point.value)
    if hooks.error is not None:
        # What a plugin for another interface does that this one does not know is no fault of its own.
        broken += [] if others else [faulty(hooks.error)]
        return
    for kind, implementation in hooks.value:
        version = declared.value.get(kind, 1)
        record = KINDS[kind]
        if record.versions.complaint(kind, version, ""):
            continue
        # What an implementation does not name it does not get, so that hooks can gain arguments.
        known = {"interface": record.versions.present}
        arguments = [known[name] for name in implementation.argnames]
        called = attempt(_called, implementation.function, arguments, getattr(hookspecs, record.offer))
        if called.error is not None:
            broken.append(faulty(called.error, f"{record.hook}: "))
            continue
        good, faults = called.value
        offers += [Offered(kind, offer, source, version) for offer in good]
        broken += [Broken(source, f"{record.hook}: {fault} ({source.file})") for fault in faults]


def _declared(module: Any) -> dict[Kind, int]:
    """Return the versions of the interfaces that a plugin says it was made for; empty where it says nothing."""
    near = (name for name in dir(module) if abs(len(name) - len(DECLARATION)) < 8)
    names = [] if hasattr(module, DECLARATION) else near
    if misspelt := [name for name in names if did_you_mean(DECLARATION, [name.upper()], cutoff=0.85)]:
        raise PluginError(f"{misspelt[0]} means nothing; did you mean {DECLARATION}?")
    found = getattr(module, DECLARATION, {})
    if not isinstance(found, dict) or not all(
        kind in KINDS and type(version) is int for kind, version in found.items()
    ):
        raise PluginError(
            f"{DECLARATION}: expected a number for some of {joined(map(repr, KINDS))}, got {short_repr(found)}"
        )
    return found


def _hooks(module: Any, value: str) -> list[tuple[Kind, pluggy.HookImpl]]:
    """Return the hooks of a plugin; refuse one without any, and one with a hook that there is not."""
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(Hooks)
    manager.register(module)
    hooks = [record.hook for record in KINDS.values()]
    callers = manager.get_hookcallers(module) or []
    if not callers:
        raise PluginError(f"no function of {value} is marked @hookimpl; the hooks are {joined(hooks)}")
    taken = {caller.name for caller in callers}
    if unmarked := [hook for hook in hooks if hook not in taken and callable(getattr(module, hook, None))]:
        raise PluginError(f"the function {unmarked[0]} is not marked @hookimpl")
    for caller in callers:
        if caller.name not in hooks and not all(found.optionalhook for found in caller.get_hookimpls()):
            question = did_you_mean(caller.name, hooks) or f"the hooks are {joined(hooks)}"
            raise PluginError(f"there is no hook '{caller.name}'; {question}")
    return [
        (kind, implementation)
        for kind, record in KINDS.items()
        for implementation in getattr(manager.hook, record.hook).get_hookimpls()
    ]


def _of_other_interfaces(declared: dict[Kind, int], source: Source) -> list[Broken]:
    complaints = {
        kind: KINDS[kind].versions.complaint(kind, version, source.distribution)
        for kind, version in declared.items()
    }
    return [Broken(source, reason, kind, declared[kind]) for kind, reason in complaints.items() if reason]


def _called(
    hook: Callable[..., Any], arguments: list[Any], cls: type[Offer]
) -> tuple[list[Offer], list[str]]:
    """Return the good offers among what a hook returns, and what is wrong with the others."""
    returned = hook(*arguments)
    if not isinstance(returned, list | tuple):
        raise PluginError(f"expected a list of porocore.{cls.__name__}, got {short_repr(returned)}")
    good, faults = [], []
    for offer in returned:
        if not isinstance(offer, cls):
            faults.append(f"expected a list of porocore.{cls.__name__}, got {short_repr(offer)} in it")
        elif wrong := offer.faults():  # made by a subclass, or changed since
            faults += wrong
        else:
            good.append(offer)
    return good, faults


def _importable(module: str) -> bool:
    # Only the top level: find_spec of a submodule would import its parents.
    try:
        return importlib.util.find_spec(module.partition(".")[0]) is not None
    except ValueError:  # in sys.modules, but without a spec
        return True
