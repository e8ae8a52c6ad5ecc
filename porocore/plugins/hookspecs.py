"""The hooks by which a plugin offers its implementations.

A hook returns light descriptions: importing the module that holds it must not import torch, dolfinx or
another heavy library, so that ``porocore plugins`` stays fast and works when one of them is broken.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import pluggy

from porocore.errors import PluginError

PROJECT = "porocore"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)

Kind = Literal["cell solver", "macro solver", "surrogate", "sampler"]


@dataclass(frozen=True)
class Versions:
    """Of an interface: the one that this porocore has, and the oldest whose implementations still work."""

    present: int
    oldest: int

    def complaint(self, kind: Kind, made_for: int, distribution: str) -> str:
        """Why a plugin for version ``made_for`` cannot be used, and what to do; empty if it can."""
        if self.oldest <= made_for <= self.present:
            return ""
        old = made_for < self.oldest
        works = (
            f"version {self.present}"
            if self.oldest == self.present
            else f"versions {self.oldest} to {self.present}"
        )
        return (
            f"made for version {made_for} of the {kind} interface, {'older' if old else 'newer'} than this porocore, "
            f"which takes {works}; upgrade {'it' if old else 'porocore'}: "
            f"pip install --upgrade {distribution if old else PROJECT}"
        )


#: Raised by one when implementations of a kind must change; what changed is told in docs/plugins.md.
INTERFACES: dict[Kind, Versions] = {
    "cell solver": Versions(1, 1),
    "macro solver": Versions(1, 1),
    "surrogate": Versions(1, 1),
    "sampler": Versions(1, 1),
}
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
        A field is not what it should be; the message tells all that are wrong.
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
        return [
            f"Offer.{field}: expected {expected}, got {short_repr(getattr(self, field))}"
            for field, good, expected in rules
            if not good
        ]


class Hooks:
    """One hook for each abstract interface.

    An implementation names those of the arguments that it wants, so that a hook can gain further ones.

    Parameters
    ----------
    interface
        Version of the interface that this porocore has.
    """

    @hookspec
    def porocore_cell_solvers(self, interface: int) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.CellSolver`."""

    @hookspec
    def porocore_macro_solvers(self, interface: int) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.MacroSolver`."""

    @hookspec
    def porocore_surrogates(self, interface: int) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.Surrogate`."""

    @hookspec
    def porocore_samplers(self, interface: int) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.Sampler`."""


def short_repr(value: Any) -> str:
    """Return a value as code has it, cut after 80 characters; its type where it cannot even be written."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - foreign code
        text = f"an instance of {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:79]}…"


def _is_module(name: Any) -> bool:
    return isinstance(name, str) and all(part.isidentifier() for part in name.split("."))
