"""The hooks by which a plugin offers its implementations.

A hook returns light descriptions: importing the module that holds it must not import torch, dolfinx or
another heavy library, so that ``porocore plugins`` stays fast and works when one of them is broken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import pluggy

PROJECT = "porocore"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@dataclass(frozen=True)
class Offer:
    """A light description of one implementation.

    Attributes
    ----------
    name
        What the user writes, such as ``skfem``.
    load
        Imports and returns the class.
    summary
        One line for ``porocore plugins``.
    requires
        Importable modules that it needs.
    install
        The command that installs those.
    """

    name: str
    load: Callable[[], type[Any]]
    summary: str
    requires: Sequence[str] = ()
    install: str = ""


class Hooks:
    """One hook for each abstract interface."""

    @hookspec
    def porocore_cell_solvers(self) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.CellSolver`."""

    @hookspec
    def porocore_macro_solvers(self) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.MacroSolver`."""

    @hookspec
    def porocore_surrogates(self) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.Surrogate`."""

    @hookspec
    def porocore_samplers(self) -> list[Offer]:  # type: ignore[empty-body]
        """Offer classes derived from :class:`porocore.Sampler`."""
