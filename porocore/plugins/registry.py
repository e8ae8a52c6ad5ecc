"""Registry: the class of an implementation by kind and name; errors of missing or misfit ones.

Nothing heavy is imported until :meth:`Registry.get` is asked for a class: listing plugins works when torch is
slow to load, missing or broken. A plugin that cannot be used is kept with its reason and stops no other.
"""

from __future__ import annotations

import sys
from abc import ABCMeta
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from porocore.core.echo import did_you_mean, echo, joined
from porocore.errors import PluginError
from porocore.plugins.discovery import Broken, Offered, discover, own_offers
from porocore.plugins.foreign_code import attempt, note_origin, place_of, reason_of
from porocore.plugins.hookspecs import CommandOffer, short_repr
from porocore.plugins.kinds import FIRST_PARTY, KINDS, Kind
from porocore.plugins.table import PluginRow, plugin_rows, repeated


class Registry:
    """The offers of all installed plugins.

    Attributes
    ----------
    offers
        In the order of discovery.
    broken
        Plugins that failed, each with its reason.
    """

    def __init__(self, offers: Iterable[Offered], broken: Iterable[Broken]) -> None:
        self.offers = tuple(offers)
        self.broken = tuple(broken)

    @classmethod
    def discover(cls) -> Registry:
        """Return the registry of the installed packages."""
        return cls(*discover())

    def names(self, kind: Kind) -> list[str]:
        """Return the names that are offered for ``kind``."""
        return sorted({offered.offer.name for offered in self.offers if offered.kind == kind})

    def find(self, kind: Kind, name: str) -> Offered:
        """Return the one offer of that name, with its dependencies present; nothing heavy is imported.

        Raises
        ------
        PluginError
            The name is unknown, not installed or offered twice, or a module that it needs is missing.
        """
        found = [offered for offered in self.offers if offered.kind == kind and offered.offer.name == name]
        if not found:
            raise PluginError(self._not_found(kind, name))
        if len(found) > 1:
            raise PluginError(
                f"{kind} '{name}': {complaint}"
                if (complaint := repeated(found))
                else f"{kind} '{name}' is offered by {joined(str(offered.source) for offered in found)}; "
                f"uninstall all but one: pip uninstall {found[-1].source.distribution}"
            )
        offered = found[0]
        if offered.missing:
            raise PluginError(
                f"{kind} '{name}' ({offered.source}) needs {joined(offered.missing)}, not installed here; "
                f"install: {offered.install}"
            )
        return offered

    def get(self, kind: Kind, name: str) -> type[Any]:
        """Import and return the class of that name, a concrete subclass of the kind's interface.

        Raises
        ------
        PluginError
            As :meth:`find`; or the class cannot be imported or does not implement the interface.
        """
        offered = self.find(kind, name)
        who = f"{kind} '{name}' of {offered.source}"
        loaded = attempt(offered.offer.load)
        if loaded.printed:
            sys.stderr.write(loaded.printed)  # standard output belongs to the command
        module = getattr(offered.offer.load, "__module__", None) or ""
        if loaded.error is not None:
            place = place_of(loaded.error, module) or offered.source.file
            raise PluginError(
                f"{who} cannot be loaded: {reason_of(loaded.error)} ({place}); reinstall it ({offered.install}) "
                "or report this to its authors"
            ) from loaded.error
        implementation: type[Any] = loaded.value
        if misfit := _misfit(implementation, _interface(kind)):
            raise PluginError(f"{who} {misfit} ({offered.source.file}); report this to its authors")
        note_origin(implementation, who)
        return implementation

    def table(self) -> list[PluginRow]:
        """Return every plugin with its state and what to do about it."""
        return plugin_rows(self.offers, self.broken)

    def _not_found(self, kind: Kind, name: str) -> str:
        distribution, kinds = FIRST_PARTY.get(name, ("", ()))
        # Of another interface of another kind is none of this name.
        faulty = [b for b in self.broken if b.kind in ("", kind)]
        # Where one of them bears the name, the others are none of the matter.
        faulty = [b for b in faulty if name in str(b.source)] or faulty
        broken = "".join(f"; {_fault(b)}" for b in faulty)
        if kind in kinds:
            for failed in self.broken:
                if failed.source.distribution == distribution and failed.kind in ("", kind):
                    return (
                        f"{kind} '{name}': {failed.source} is installed but {failed.reason}"
                        if failed.kind
                        else f"{kind} '{name}': {failed.source} is installed but broken: {failed.reason}; "
                        f"reinstall it: pip install --force-reinstall {distribution}"
                    )
            return f"{kind} '{name}' is not installed; install it: pip install {distribution}{broken}"
        names = self.names(kind)
        known = sorted({*names, *(n for n, (_, k) in FIRST_PARTY.items() if kind in k)})
        advice = did_you_mean(name, known)
        installed = joined(
            f"{o.offer.name} ({o.source})"
            for o in sorted(self.offers, key=lambda o: o.offer.name)
            if o.kind == kind
        )
        others = [o.kind for o in self.offers if o.offer.name == name]
        also = f", which is a {joined(others)}; choose another by {KINDS[kind].choice}" if others else ""
        return (
            f"unknown {kind} {echo(name)}{also}; {advice and f'{advice} '}installed: {installed}; "
            f"'porocore plugins' shows all{broken}"
        )


@cache
def registry() -> Registry:
    """Return the registry of this process, discovered once."""
    return Registry.discover()


def get(kind: Kind, name: str) -> type[Any]:
    """Return a class by :meth:`Registry.get` of this process."""
    return registry().get(kind, name)


@cache
def own() -> Registry:
    """Return the registry of what comes with porocore, for which no metadata are read."""
    return Registry(own_offers(), ())


def find_command(wanted: Callable[[CommandOffer], bool]) -> Offered | None:
    """Return the first command that is wanted: one of porocore itself, else of an installed package; None without."""
    for known in (own, registry):
        for offered in known().offers:
            if isinstance(offered.offer, CommandOffer) and wanted(offered.offer):
                return offered
    return None


def make_command(offered: Offered) -> Any:
    """Return the :class:`~porocore.interfaces.command.Command` of an offer; errors as :meth:`Registry.get`."""
    known = own() if offered in own().offers else registry()
    return known.get("command", offered.offer.name)()


def plugins_table() -> list[PluginRow]:
    """Return :meth:`Registry.table` of this process."""
    return registry().table()


def _fault(failed: Broken) -> str:
    what = f"was {failed.reason}" if failed.kind else f"is broken: {failed.reason}"
    return f"the plugin of {failed.source} {what}"


def _misfit(implementation: Any, interface: type[Any]) -> str:
    """Return why a class is no implementation of an interface; empty if it is one."""
    if not (isinstance(implementation, ABCMeta) and issubclass(implementation, interface)):
        return f"is no subclass of porocore.{interface.__name__}: {short_repr(implementation)}"
    missing = sorted(implementation.__abstractmethods__)
    return f"does not implement {joined(missing)}" if missing else ""


def _interface(kind: Kind) -> type[Any]:
    from porocore import interfaces  # most need numpy, h5py and pydantic: not needed for listing

    found: type[Any] = getattr(interfaces, KINDS[kind].interface)
    return found
