"""One abstract class for each exchangeable part, without implementations; names are imported when first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from porocore.interfaces.cell import CellField as CellField
    from porocore.interfaces.cell import CellSolution as CellSolution
    from porocore.interfaces.cell import CellSolver as CellSolver
    from porocore.interfaces.command import Command as Command
    from porocore.interfaces.command import FileCheck as FileCheck
    from porocore.interfaces.macro import MacroSolver as MacroSolver
    from porocore.interfaces.records import RestData as RestData
    from porocore.interfaces.sampler import Exploration as Exploration
    from porocore.interfaces.sampler import Explore as Explore
    from porocore.interfaces.sampler import Outlook as Outlook
    from porocore.interfaces.sampler import Request as Request
    from porocore.interfaces.sampler import Sampler as Sampler
    from porocore.interfaces.sampler import StudyFacts as StudyFacts
    from porocore.interfaces.sampler import StudySampler as StudySampler
    from porocore.interfaces.surrogate import Surrogate as Surrogate
    from porocore.interfaces.surrogate import TrainingProgress as TrainingProgress
    from porocore.interfaces.surrogate import TrainingSet as TrainingSet

_NAMES = {
    "cell": ("CellField", "CellSolution", "CellSolver"),
    "command": ("Command", "FileCheck"),
    "macro": ("MacroSolver",),
    "records": ("RestData",),
    "sampler": ("Exploration", "Explore", "Outlook", "Request", "Sampler", "StudyFacts", "StudySampler"),
    "surrogate": ("Surrogate", "TrainingProgress", "TrainingSet"),
}
_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)
