"""Offers of the commands that come with porocore, by their names."""

from __future__ import annotations

from functools import partial
from pkgutil import resolve_name
from typing import Any

from porocore.plugins.hookspecs import CommandOffer, hookimpl

#: First paragraph of the docstring of each command, a function of its name.
SUMMARIES = {
    "sweep": "Solve the body for each value of a number of its cell, such as the radius of its pores.",
    "reproduce": "Recompute all figures, numbers and statements of a publication's numerical part, and compare them.",
    "tune": "Try networks of several sizes and choose the smallest that is about as good as the best.",
    "sensitivity": "Study the cell under one load at a time, both signs, as far as it can be solved.",
    "stability": "Map where the cell creases and touches itself, and where it becomes unstable.",
    "crosscheck": "Run every pair of finite-element backend and surrogate on one case and compare the results.",
    "verify": "Solve cases with known answers and print the errors of porocore.",
}
#: Those of the group ``cell``.
OF_A_CELL = {
    "rev": "Find the size of a representative volume: solve sub-volumes of an image, larger and larger.",
    "fields": "Solve one state, by default H22=-0.1, and write its local fields.",
    "show": "Mesh the cell and show it; nothing is solved.",
}
#: Modules in :mod:`porocore.commands` that are not ``command`` in the room of the command's name.
MODULES = {"sweep": "sweep", "tune": "tune", "rev": "representative.command", "show": "fields.command"}


def _load(name: str) -> type[Any]:
    """Return the command that runs the function of a name."""
    from porocore.interfaces.command import Command

    run = resolve_name(f"porocore.commands.{MODULES.get(name, f'{name}.command')}:{name}")
    return type(f"{name.capitalize()}Command", (Command,), {"run": staticmethod(run)})


@hookimpl
def porocore_commands() -> list[CommandOffer]:
    """Offer studies upon studies, and the evidence for porocore itself."""
    return [
        CommandOffer(
            "calibrate",
            partial(resolve_name, "porocore.commands.calibration.command:CalibrateCommand"),
            "Find numbers of a study, such as the radius of its pores, from measured curves.",
            section="calibration",
            file_keys=("unknowns", "experiments"),
            paths=("file", "study"),
        ),
        *(CommandOffer(name, partial(_load, name), said) for name, said in SUMMARIES.items()),
        *(CommandOffer(name, partial(_load, name), said, group="cell") for name, said in OF_A_CELL.items()),
    ]
