"""Numbers of laws beside those of the cells (relaxation, charges, evolution) as fields of a body.

They are parameters of the law at each point, so they have derivatives as a parameter of the cell has.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from porocore.cell.materials.prony import Relaxation
from porocore.core.units import dimensions
from porocore.macro.composition.evolution import Evolution

#: First parts of the names of such numbers; no parameter of a cell may begin with one and a dot.
RELAXATION, CHARGES, EVOLUTION = "relaxation", "charges", "evolution"
FIRST_PARTS = (RELAXATION, CHARGES, EVOLUTION)


def is_of_the_law(name: str) -> bool:
    """Return whether a parameter of a law is a number of its own, and none of the cell's."""
    return name.partition(".")[0] in FIRST_PARTS and "." in name


def of_the_cell(names: Iterable[str]) -> tuple[str, ...]:
    """Return those parameters of a law that are the cell's."""
    return tuple(name for name in names if not is_of_the_law(name))


def key_of_number(name: str, cell: str | None = None) -> str:
    """Return the key under which a number of a law stands in the configuration; ``cell`` names that of the region."""
    first, *rest = name.split(".")
    if first == RELAXATION:
        branch, what = rest
        whose = "cell" if cell is None else f"cells.{cell}"
        return f"{whose}.material.relaxation.branches.{int(branch) - 1}.{what}"
    if first == EVOLUTION:
        return f"macro.evolution.{'.'.join(rest[:-1])}.constants.{rest[-1]}"
    return f"macro.{name}"


def quantity_of_number(name: str, rates: Mapping[str, Evolution]) -> str:
    """Return the quantity of a number of a law, such as time, with the ``rates`` of a body; '' is a plain number."""
    first, *rest = name.split(".")
    if first == RELAXATION:
        return "time" if rest[-1] == "time" else ""
    if first == CHARGES:
        return "concentration"
    evolution = rates[".".join(rest[:-1])]
    of_constants = {place.path: dimension for place, dimension in dimensions(type(evolution), evolution)}
    dimension = of_constants["constants", rest[-1]]
    return "" if dimension is None else dimension.quantity


def relaxation_numbers(relaxation: Relaxation | None) -> dict[str, float]:
    """Return strengths and times of the branches, from 1, by the names of the law's parameters."""
    branches = () if relaxation is None else relaxation.branches
    return {
        f"{RELAXATION}.{k}.{name}": value
        for k, branch in enumerate(branches, start=1)
        for name, value in branch
    }
