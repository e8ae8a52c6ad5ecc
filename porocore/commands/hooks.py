"""Offers of the commands that come with porocore, by their names."""

from __future__ import annotations

from functools import partial
from pkgutil import resolve_name
from typing import Any

from porocore.plugins.hookspecs import CommandOffer, hookimpl

#: Name, module and function in :mod:`porocore.commands`, and the first paragraph of the function's docstring.
COMMANDS = (
    (
        "sweep",
        "sweep:sweep",
        "Solve the body for each value of a number of its cell, such as the radius of its pores.",
    ),
    (
        "reproduce",
        "verify:reproduce",
        "Recompute all figures, numbers and statements of a publication's numerical part, and compare them.",
    ),
    (
        "tune",
        "tune:tune",
        "Try networks of several sizes and choose the smallest that is about as good as the best.",
    ),
    (
        "sensitivity",
        "sensitivity:sensitivity",
        "Study the cell under one load at a time, both signs, as far as it can be solved.",
    ),
    (
        "stability",
        "stability:stability",
        "Map where the cell creases and touches itself, and where it becomes unstable.",
    ),
    (
        "crosscheck",
        "crosscheck:crosscheck",
        "Run every pair of finite-element backend and surrogate on one case and compare the results.",
    ),
    ("verify", "verify:verify", "Solve cases with known answers and print the errors of porocore."),
)
#: Those of the group ``cell``.
OF_A_CELL = (
    (
        "rev",
        "representative:rev",
        "Find the size of a representative volume: solve sub-volumes of an image, larger and larger.",
    ),
    ("fields", "fields:fields", "Solve one state, by default H22=-0.1, and write its local fields."),
    ("show", "fields:show", "Mesh the cell and show it; nothing is solved."),
)


def _load(place: str) -> type[Any]:
    """Return a command of porocore, or the command that runs a function of it."""
    from porocore.interfaces.command import Command

    found = resolve_name(f"porocore.commands.{place}")
    return (
        found if isinstance(found, type) else type(found.__name__, (Command,), {"run": staticmethod(found)})
    )


@hookimpl
def porocore_commands() -> list[CommandOffer]:
    """Offer studies upon studies, and the evidence for porocore itself."""
    return [
        CommandOffer(
            "calibrate",
            partial(_load, "calibrate:CalibrateCommand"),
            "Find numbers of a study, such as the radius of its pores, from measured curves.",
            section="calibration",
            file_keys=("unknowns", "experiments"),
            paths=("file", "study"),
        ),
        *(CommandOffer(name, partial(_load, place), said) for name, place, said in COMMANDS),
        *(CommandOffer(name, partial(_load, place), said, group="cell") for name, place, said in OF_A_CELL),
    ]
