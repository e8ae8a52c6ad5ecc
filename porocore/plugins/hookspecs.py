"""Hooks of plugins, and the description of one implementation (Offer).

A hook returns light descriptions: importing the module that holds it must not import torch, dolfinx or
another heavy library, so that ``porocore plugins`` stays fast and works when one of them is broken.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pluggy

from porocore.core.echo import shortened
from porocore.errors import PluginError
from porocore.plugins.kinds import KINDS, PROJECT, PluginKind

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)

#: Attribute of the module that an entry point names: version of the interface of each kind that it offers.
DECLARATION = "POROCORE_INTERFACES"
#: Names of implementations: what is written in YAML and on a command line without quotes.
NAME = re.compile(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*")
LONGEST_NAME = 40


@dataclass(frozen=True)
class Offer:
    """A light description of one implementation.

    Attributes
    ----------
    name
        What the user writes, such as ``skfem``: small letters and digits, parted by single hyphens or underscores.
    load
        Imports and returns the class.
    summary
        One line for ``porocore plugins``.
    requires
        Importable modules that it needs.
    install
        The command that installs those.
    suites
        Imports and returns the subclasses of the suites of ``porocore.testing`` that it passes, for ``porocore plugin
        check``; None: the suite of its kind, with default options.

    Raises
    ------
    PluginError
        A field is not what it should be; the message has all that are wrong.
    """

    name: str
    load: Callable[[], type[Any]]
    summary: str
    requires: Sequence[str] = ()
    install: str = ""
    suites: Callable[[], Sequence[type[Any]]] | None = None

    def __post_init__(self) -> None:
        if wrong := self.faults():
            raise PluginError("; ".join(wrong))

    def faults(self) -> list[str]:
        """Return what is wrong with the fields, each as field, expected and got; none for a good offer."""
        name = self.name
        rules = (
            (
                "name",
                isinstance(name, str) and NAME.fullmatch(name) is not None and len(name) <= LONGEST_NAME,
                "small letters and digits, parted by single hyphens or underscores, beginning with a letter, "
                f"at most {LONGEST_NAME}, such as 'my-grid'",
            ),
            ("load", callable(self.load), "a function that imports and returns the class"),
            ("summary", isinstance(self.summary, str), "a text"),
            (
                "requires",
                isinstance(self.requires, list | tuple) and all(map(_is_module, self.requires)),
                "a list or tuple of modules, such as ('numpy',)",
            ),
            ("install", isinstance(self.install, str), "a text, the command that installs what is required"),
            (
                "suites",
                self.suites is None or callable(self.suites),
                "a function that imports and returns the suites, or None",
            ),
        )
        return self._told(rules)

    def _told(self, rules: Iterable[tuple[str, bool, str]]) -> list[str]:
        return [
            f"{type(self).__name__}.{field}: expected {expected}, got {short_repr(getattr(self, field))}"
            for field, good, expected in rules
            if not good
        ]


@dataclass(frozen=True)
class CommandOffer(Offer):
    """A light description of one command; ``summary`` is the first paragraph of its help page.

    Attributes
    ----------
    section
        Top-level key of a study that belongs to the command; empty: none.
    file_keys
        Top-level keys by which a file of the command's own is known, which is no study.
    paths
        Keys of the section, at any depth, that name files; a run folder has their absolute paths.
    group
        Group of commands that it is in, such as ``cell``; empty: none.
    """

    section: str = ""
    file_keys: Sequence[str] = ()
    paths: Sequence[str] = ()
    group: str = ""

    @property
    def key(self) -> str:
        """Name as Python has it, with underscores."""
        return self.name.replace("-", "_")

    def faults(self) -> list[str]:
        """Return what is wrong with the fields, as those of :class:`Offer`."""
        several = "a list or tuple of keys"
        rules = (
            ("section", _is_key(self.section, empty=True), "the key of a section, such as 'my_study', or ''"),
            ("file_keys", _are_keys(self.file_keys), several),
            ("paths", _are_keys(self.paths), several),
            ("group", isinstance(self.group, str), "the name of a group of commands, or ''"),
        )
        return [*super().faults(), *self._told(rules)]


def _hook(record: PluginKind) -> Any:
    def offers(self: Any, interface: int) -> list[Offer]:  # type: ignore[empty-body]
        pass

    offers.__name__, offers.__qualname__ = record.hook, f"Hooks.{record.hook}"
    offers.__doc__ = (
        f"Return a :class:`porocore.{record.offer}` for each class derived from ``{record.interface}``."
    )
    return hookspec(offers)


class Hooks:
    """One hook for each kind of plugin.

    An implementation names those of the arguments that it wants, so that a hook can gain further ones.

    Parameters
    ----------
    interface
        Version of the interface that this porocore has.
    """


for _record in KINDS.values():
    setattr(Hooks, _record.hook, _hook(_record))


def short_repr(value: Any) -> str:
    """Return a value as code has it, cut after 80 characters; its type where it cannot even be written."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - foreign code
        text = f"an instance of {type(value).__name__}"
    return shortened(text, 80)


def _is_key(name: Any, empty: bool = False) -> bool:
    return isinstance(name, str) and (name.isidentifier() or (empty and not name))


def _are_keys(names: Any) -> bool:
    return isinstance(names, list | tuple) and all(map(_is_key, names))


def _is_module(name: Any) -> bool:
    return isinstance(name, str) and all(part.isidentifier() for part in name.split("."))
