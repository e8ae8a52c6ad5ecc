"""One abstract class for each exchangeable part, without implementations."""

from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.records import RestData
from porocore.interfaces.sampler import (
    Exploration,
    Explore,
    Outlook,
    Request,
    Sampler,
    StudyFacts,
    StudySampler,
)
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet

__all__ = [
    "CellField",
    "CellSolution",
    "CellSolver",
    "Exploration",
    "Explore",
    "MacroSolver",
    "Outlook",
    "Request",
    "RestData",
    "Sampler",
    "StudyFacts",
    "StudySampler",
    "Surrogate",
    "TrainingProgress",
    "TrainingSet",
]
