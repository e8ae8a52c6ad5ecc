"""Choice between a factor and a preconditioned iteration, by size or as the user says."""

from __future__ import annotations

from typing import Literal, get_args

from porocore.core.echo import echo
from porocore.errors import ConfigurationError

#: Option ``macro.options.solver``; ``auto`` goes by the number of unknowns.
Solver = Literal["auto", "direct", "iterative"]
KEY = "macro.options.solver"


def checked_solver(solver: object) -> Solver:
    """Return the option.

    Raises
    ------
    ConfigurationError
        It is none of the three.
    """
    for known in get_args(Solver):
        if solver == known:
            return known  # type: ignore[no-any-return]
    raise ConfigurationError(f"{KEY}: expected auto, direct or iterative, got {echo(solver)}")


def choose_solver(solver: Solver, unknowns: int, threshold: int, why: str = "") -> tuple[bool, str]:
    """Return whether to iterate, and the line that says so.

    Parameters
    ----------
    threshold
        Number of unknowns above which an iteration is the faster one.
    why
        Reason for this threshold beside the size, such as that a library is missing.
    """
    iterates = unknowns > threshold if solver == "auto" else solver == "iterative"
    name = "a preconditioned iteration" if iterates else "a direct factor"
    reason = f"{KEY} = {solver}"
    if solver == "auto":
        reason = f"{'more than' if iterates else 'up to'} {threshold:,}{f', {why}' if why else ''}"
    return iterates, f"{unknowns:,} unknowns are solved for by {name} ({reason})"
