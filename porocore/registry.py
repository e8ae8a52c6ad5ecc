"""Finding the implementations that installed packages offer, by kind and name.

Nothing heavy is imported until :meth:`Registry.get` is asked for a class: listing plugins works when torch is
slow to load, missing or broken. A plugin that cannot be used is kept with its reason and stops no other.
"""

from __future__ import annotations

import difflib
import importlib.util
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import Any, Literal

import pluggy

from porocore.errors import PluginError
from porocore.hookspecs import DECLARATION, INTERFACES, PROJECT, Hooks, Kind, Offer

__all__ = ["FIRST_PARTY", "HOOKS", "Kind", "Offered", "Registry", "get", "plugins_table", "registry"]

State = Literal["ready", "missing dependency", "other interface", "broken", "offered twice", "not installed"]

#: The hook that offers each kind.
HOOKS: dict[Kind, str] = {
    "cell solver": "porocore_cell_solvers",
    "macro solver": "porocore_macro_solvers",
    "surrogate": "porocore_surrogates",
    "sampler": "porocore_samplers",
}

#: Where a study says which one it takes.
CHOICES: dict[Kind, str] = {
    "cell solver": "fem.backend or --fem",
    "macro solver": "macro.backend or --macro",
    "surrogate": "surrogate.backend or --surrogate",
    "sampler": "sampling.sampler",
}

#: What the project itself publishes: name → (distribution, kinds).
FIRST_PARTY: dict[str, tuple[str, tuple[Kind, ...]]] = {
    "skfem": ("porocore-fem-skfem", ("cell solver", "macro solver")),
    "dolfinx": ("porocore-fem-dolfinx", ("cell solver", "macro solver")),
    "torch": ("porocore-surrogate-torch", ("surrogate",)),
    "jax": ("porocore-surrogate-jax", ("surrogate",)),
}


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


@dataclass(frozen=True)
class Broken:
    """A plugin that cannot be used, and why; of another interface than here, for which ``kind``."""

    source: Source
    reason: str
    kind: Kind | Literal[""] = ""
    interface: int | None = None


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
                manager.check_pending()
            except (Exception, SystemExit) as error:  # noqa: BLE001 - foreign code, kept and shown
                if manager.has_plugin(key):
                    manager.unregister(name=key)
                # What a plugin for another interface does that this one does not know is no fault of its own.
                broken += others or [Broken(source, _reason(error))]
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
                    broken.append(Broken(source, f"{hook}: {_reason(error)}"))
        return cls(offers, broken)

    def names(self, kind: Kind) -> list[str]:
        """Names that are offered for ``kind``."""
        return sorted({offered.offer.name for offered in self.offers if offered.kind == kind})

    def find(self, kind: Kind, name: str) -> Offered:
        """The one offer of that name, with its dependencies present; imports nothing heavy.

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
                f"{kind} '{name}' is offered by {_join(str(offered.source) for offered in found)}; "
                f"uninstall all but one: pip uninstall {found[-1].source.distribution}"
            )
        offered = found[0]
        if offered.missing:
            raise PluginError(
                f"{kind} '{name}' ({offered.source}) needs {_join(offered.missing)}, not installed here; "
                f"install: {_install(offered)}"
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
        try:
            implementation = offered.offer.load()
        except (Exception, SystemExit) as error:  # foreign code; its reason goes into the message
            raise PluginError(
                f"{who} cannot be loaded: {_reason(error)}; reinstall it ({_install(offered)}) "
                "or report this to its authors"
            ) from error
        interface = _interface(kind)
        if not (isinstance(implementation, type) and issubclass(implementation, interface)):
            raise PluginError(
                f"{who}: expected a subclass of porocore.{interface.__name__}, got {implementation!r}; "
                "report this to its authors"
            )
        if inspect.isabstract(implementation):
            missing = _join(sorted(implementation.__abstractmethods__))
            raise PluginError(f"{who} does not implement {missing}; report this to its authors")
        return implementation

    def table(self) -> list[PluginRow]:
        """Every plugin with its state and what to do about it."""
        rows = []
        for offered in self.offers:
            kind, offer = offered.kind, offered.offer
            state: State = "ready"
            advice = ""
            if len([o for o in self.offers if (o.kind, o.offer.name) == (kind, offer.name)]) > 1:
                state = "offered twice"
                advice = f"uninstall one: pip uninstall {offered.source.distribution}"
            elif offered.missing:
                state, advice = "missing dependency", _install(offered)
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
        for failed in self.broken:
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
        broken = {(failed.source.distribution, failed.kind) for failed in self.broken}
        for name, (distribution, kinds) in FIRST_PARTY.items():
            advice = f"pip install {distribution}"
            for kind in kinds:
                if name not in self.names(kind) and not broken & {(distribution, ""), (distribution, kind)}:
                    rows.append(PluginRow(kind, name, distribution, "not installed", "", advice))
        return rows

    def _not_found(self, kind: Kind, name: str) -> str:
        distribution, kinds = FIRST_PARTY.get(name, ("", ()))
        broken = "".join(f"; {_fault(b)}" for b in self.broken)
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
        nearest = difflib.get_close_matches(name, known, n=1)
        advice = f"did you mean '{nearest[0]}'? " if nearest else ""
        installed = _join(
            f"{o.offer.name} ({o.source})"
            for o in sorted(self.offers, key=lambda o: o.offer.name)
            if o.kind == kind
        )
        others = _join(o.kind for o in self.offers if o.offer.name == name)
        also = f", which is a {others}; choose another by {CHOICES[kind]}" if others else ""
        return (
            f"unknown {kind} '{name}'{also}; {advice}installed: {installed or 'none'}; "
            f"'porocore plugins' shows all{broken}"
        )


@cache
def registry() -> Registry:
    """The registry of this process, discovered once."""
    return Registry.discover()


def get(kind: Kind, name: str) -> type[Any]:
    """:meth:`Registry.get` of this process."""
    return registry().get(kind, name)


def plugins_table() -> list[PluginRow]:
    """:meth:`Registry.table` of this process."""
    return registry().table()


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
            f"{DECLARATION}: expected a number for some of {_join(map(repr, INTERFACES))}, got {found!r}"
        )
    return found


def _of_other_interfaces(declared: dict[Kind, int], source: Source) -> list[Broken]:
    complaints = {
        kind: INTERFACES[kind].complaint(kind, version, source.distribution)
        for kind, version in declared.items()
    }
    return [Broken(source, reason, kind, declared[kind]) for kind, reason in complaints.items() if reason]


def _fault(failed: Broken) -> str:
    what = f"was {failed.reason}" if failed.kind else f"is broken: {failed.reason}"
    return f"the plugin of {failed.source} {what}"


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


def _install(offered: Offered) -> str:
    return offered.offer.install or f"pip install {offered.source.distribution}"


def _interface(kind: Kind) -> type[Any]:
    from porocore import interfaces  # numpy, h5py and pydantic: not needed for listing

    classes: dict[Kind, type[Any]] = {
        "cell solver": interfaces.CellSolver,
        "macro solver": interfaces.MacroSolver,
        "surrogate": interfaces.Surrogate,
        "sampler": interfaces.Sampler,
    }
    return classes[kind]


def _reason(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _join(names: Iterable[str]) -> str:
    *head, last = list(names) or [""]
    return f"{', '.join(head)} and {last}" if head else last
