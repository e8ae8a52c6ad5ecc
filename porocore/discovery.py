"""What installed packages offer, read from their entry points; a plugin that fails is kept with its reason.

Nothing heavy is imported: listing plugins works when torch is slow to load, missing or broken.
"""

from __future__ import annotations

import difflib
import importlib.util
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Literal

import pluggy

from porocore.hookspecs import DECLARATION, INTERFACES, PROJECT, Hooks, Kind, Offer
from porocore.plugin_kinds import HOOKS


@dataclass(frozen=True)
class Source:
    """Where an offer comes from.

    Attributes
    ----------
    requirements
        What the distribution needs, as its metadata says, without those of extras.
    """

    distribution: str
    version: str
    entry_point: str
    requirements: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".rstrip()


@dataclass(frozen=True)
class Offered:
    """One implementation and who offers it, made for which version of the interface."""

    kind: Kind
    offer: Offer
    source: Source
    interface: int = 1

    @property
    def missing(self) -> list[str]:
        """Required modules that are not there; found without importing them."""
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


def discover() -> tuple[list[Offered], list[Broken]]:
    """Read the entry points of group ``porocore``, one by one."""
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(Hooks)
    sources: dict[str, Source] = {}
    made_for: dict[str, dict[Kind, int]] = {}
    broken: list[Broken] = []
    for entry_point in metadata.entry_points(group=PROJECT):
        source = _source(entry_point)
        # pluggy registers a name only once, so the distribution belongs to the name.
        key = f"{source.distribution}:{entry_point.name}"
        others: list[Broken] = []
        try:
            module = entry_point.load()
            made_for[key] = _declared(module)
            others = _of_other_interfaces(made_for[key], source)
            manager.register(module, name=key)
            _check_hooks(manager, module)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - foreign code, kept and shown
            if manager.has_plugin(key):
                manager.unregister(name=key)
            # What a plugin for another interface does that this one does not know is no fault of its own.
            broken += others or [Broken(source, reason_of(error))]
        else:
            sources[key] = source
            broken += others
    offers: list[Offered] = []
    for kind, hook in HOOKS.items():
        for implementation in getattr(manager.hook, hook).get_hookimpls():
            source = sources[implementation.plugin_name]
            version = made_for[implementation.plugin_name].get(kind, 1)
            if INTERFACES[kind].complaint(kind, version, ""):
                continue
            # What an implementation does not name it does not get, so that hooks can gain arguments.
            known = {"interface": INTERFACES[kind].present}
            arguments = [known[name] for name in implementation.argnames]
            try:
                found = _checked(implementation.function(*arguments))
                offers += [Offered(kind, offer, source, version) for offer in found]
            except (Exception, SystemExit) as error:  # noqa: BLE001 - foreign code, kept and shown
                broken.append(Broken(source, f"{hook}: {reason_of(error)}"))
    return offers, broken


def _source(entry_point: metadata.EntryPoint) -> Source:
    distribution = entry_point.dist
    if distribution is None:
        return Source(entry_point.module, "", entry_point.name)
    needs = tuple(text for text in distribution.requires or () if "extra ==" not in text.replace("'", '"'))
    return Source(distribution.name, distribution.version, entry_point.name, needs)


def _declared(module: Any) -> dict[Kind, int]:
    """Versions of the interfaces that a plugin says it was made for; the first where it says nothing."""
    found = getattr(module, DECLARATION, {})
    if not isinstance(found, dict) or not all(
        kind in INTERFACES and isinstance(version, int) for kind, version in found.items()
    ):
        raise TypeError(
            f"{DECLARATION}: expected a number for some of {joined(map(repr, INTERFACES))}, got {found!r}"
        )
    return found


def _check_hooks(manager: pluggy.PluginManager, module: Any) -> None:
    """Refuse a plugin without hooks, and one with a hook that there is not."""
    hooks = list(HOOKS.values())
    callers = manager.get_hookcallers(module)
    if not callers:
        raise pluggy.PluginValidationError(
            module, f"no function of {module.__name__} is marked @hookimpl; the hooks are {joined(hooks)}"
        )
    for caller in callers:
        optional = all(found.optionalhook for found in caller.get_hookimpls() if found.plugin is module)
        if caller.name not in hooks and not optional:
            close = difflib.get_close_matches(caller.name, hooks, n=1)
            question = f"did you mean '{close[0]}'?" if close else f"the hooks are {joined(hooks)}"
            raise pluggy.PluginValidationError(module, f"there is no hook '{caller.name}'; {question}")


def _of_other_interfaces(declared: dict[Kind, int], source: Source) -> list[Broken]:
    complaints = {
        kind: INTERFACES[kind].complaint(kind, version, source.distribution)
        for kind, version in declared.items()
    }
    return [Broken(source, reason, kind, declared[kind]) for kind, reason in complaints.items() if reason]


def _checked(offers: Any) -> list[Offer]:
    if not isinstance(offers, list | tuple) or not all(isinstance(offer, Offer) for offer in offers):
        raise TypeError(f"expected a list of porocore.Offer, got {offers!r}")
    return list(offers)


def _importable(module: str) -> bool:
    # Only the top level: find_spec of a submodule would import its parents.
    try:
        return importlib.util.find_spec(module.partition(".")[0]) is not None
    except ValueError:  # in sys.modules, but without a spec
        return True


def reason_of(error: BaseException) -> str:
    """A failure in foreign code in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def joined(names: Iterable[str]) -> str:
    """As in "a, b and c"."""
    *head, last = list(names) or [""]
    return f"{', '.join(head)} and {last}" if head else last
