"""Two-scale finite-strain poroelasticity with surrogate models of the cell problem and exchangeable solvers.

This is the public interface: ``Study`` and ``CellProblem`` for whoever computes, ``Law`` for solvers of one's own, and
what a plugin needs, besides ``porocore.testing``. ``dir(porocore)`` shows all names, docs/reference/names.md has them
in groups. Names are imported when they are first used, so that ``import porocore`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from porocore.calibration.calibrate import calibrate as calibrate
    from porocore.calibration.results import Calibration as Calibration
    from porocore.cell.cell import Cell as Cell
    from porocore.cell.materials.hyperelastic import NeoHookean as NeoHookean
    from porocore.core.files.atomic import atomic_path as atomic_path
    from porocore.core.files.claim import WorkFolder as WorkFolder
    from porocore.core.inputs import InputSpace as InputSpace
    from porocore.core.inputs import SampledRange as SampledRange
    from porocore.core.models.strict import StrictModel as StrictModel
    from porocore.core.units import ResultUnits as ResultUnits
    from porocore.errors import ConfigurationError as ConfigurationError
    from porocore.errors import DataError as DataError
    from porocore.errors import MemberError as MemberError
    from porocore.errors import PluginError as PluginError
    from porocore.errors import PorocoreError as PorocoreError
    from porocore.errors import RunFolderError as RunFolderError
    from porocore.errors import SolveError as SolveError
    from porocore.errors import UnexpectedError as UnexpectedError
    from porocore.interfaces.cell import CellField as CellField
    from porocore.interfaces.cell import CellSolution as CellSolution
    from porocore.interfaces.cell import CellSolver as CellSolver
    from porocore.interfaces.cell import ElementCells as ElementCells
    from porocore.interfaces.command import Command as Command
    from porocore.interfaces.command import FileCheck as FileCheck
    from porocore.interfaces.law import LawMemory as LawMemory
    from porocore.interfaces.law import MacroLaw as MacroLaw
    from porocore.interfaces.law import MacroResponse as MacroResponse
    from porocore.interfaces.law import MacroTangent as MacroTangent
    from porocore.interfaces.law import MemoryChanges as MemoryChanges
    from porocore.interfaces.law import PointChanges as PointChanges
    from porocore.interfaces.law import ResponseChanges as ResponseChanges
    from porocore.interfaces.macro import MacroSolver as MacroSolver
    from porocore.interfaces.records import RestData as RestData
    from porocore.interfaces.records import failed_response as failed_response
    from porocore.interfaces.sampler import Exploration as Exploration
    from porocore.interfaces.sampler import Request as Request
    from porocore.interfaces.sampler import Sampler as Sampler
    from porocore.interfaces.sampler import StudyFacts as StudyFacts
    from porocore.interfaces.sampler import StudySampler as StudySampler
    from porocore.interfaces.sensitivities import BoundaryChange as BoundaryChange
    from porocore.interfaces.sensitivities import CellParameterChange as CellParameterChange
    from porocore.interfaces.sensitivities import HatFunction as HatFunction
    from porocore.interfaces.sensitivities import HistoryWeights as HistoryWeights
    from porocore.interfaces.sensitivities import InitialPressureChange as InitialPressureChange
    from porocore.interfaces.sensitivities import LoadChange as LoadChange
    from porocore.interfaces.sensitivities import MacroSensitivities as MacroSensitivities
    from porocore.interfaces.sensitivities import ModulusChange as ModulusChange
    from porocore.interfaces.sensitivities import ViscosityChange as ViscosityChange
    from porocore.interfaces.solution import History as History
    from porocore.interfaces.solution import MacroSolution as MacroSolution
    from porocore.interfaces.solution import Profile as Profile
    from porocore.interfaces.solution import StepReport as StepReport
    from porocore.interfaces.solution import StepWork as StepWork
    from porocore.interfaces.surrogate import Surrogate as Surrogate
    from porocore.interfaces.surrogate import TrainingProgress as TrainingProgress
    from porocore.interfaces.surrogate import TrainingSet as TrainingSet
    from porocore.macro.laws.macro_law import Law as Law
    from porocore.macro.laws.macro_law import LawResponse as LawResponse
    from porocore.macro.laws.macro_law import LawTangent as LawTangent
    from porocore.macro.problem import MacroProblem as MacroProblem
    from porocore.plugins.hookspecs import CommandOffer as CommandOffer
    from porocore.plugins.hookspecs import Offer as Offer
    from porocore.plugins.hookspecs import hookimpl as hookimpl
    from porocore.states import CellExtrema as CellExtrema
    from porocore.states import CellResponse as CellResponse
    from porocore.states import CellSlopes as CellSlopes
    from porocore.states import CellTangent as CellTangent
    from porocore.states import MacroState as MacroState
    from porocore.states import Status as Status
    from porocore.study.api.solved import CellProblem as CellProblem
    from porocore.study.api.solved import LawsSolved as LawsSolved
    from porocore.study.api.solved import Samples as Samples
    from porocore.study.api.solved import Solutions as Solutions
    from porocore.study.api.solved import Solved as Solved
    from porocore.study.api.study import Study as Study
    from porocore.study.config.config import RunConfig as RunConfig
    from porocore.study.config.loading import load_config as load_config
    from porocore.study.sweep.results import ParameterSweep as ParameterSweep
    from porocore.verification.local_fields.solve import write_local_fields as write_local_fields
    from porocore.verification.representative.study import (
        study_representative_volume as study_representative_volume,
    )
    from porocore.verification.reproduce import reproduce as reproduce
    from porocore.verification.sensitivity.study import study_sensitivity as study_sensitivity
    from porocore.verification.stability import map_stability as map_stability

_HOMES = {
    "porocore.calibration.calibrate": ("calibrate",),
    "porocore.calibration.results": ("Calibration",),
    "porocore.study.api.solved": (
        "CellProblem",
        "LawsSolved",
        "Samples",
        "Solutions",
        "Solved",
    ),
    "porocore.study.api.study": ("Study",),
    "porocore.study.sweep.results": ("ParameterSweep",),
    "porocore.cell.cell": ("Cell",),
    "porocore.study.config.config": ("RunConfig",),
    "porocore.study.config.loading": ("load_config",),
    "porocore.errors": (
        "ConfigurationError",
        "DataError",
        "MemberError",
        "PluginError",
        "PorocoreError",
        "RunFolderError",
        "SolveError",
        "UnexpectedError",
    ),
    "porocore.plugins.hookspecs": (
        "CommandOffer",
        "Offer",
        "hookimpl",
    ),
    "porocore.core.files.atomic": ("atomic_path",),
    "porocore.core.files.claim": ("WorkFolder",),
    "porocore.core.models.strict": ("StrictModel",),
    "porocore.core.inputs": (
        "InputSpace",
        "SampledRange",
    ),
    "porocore.core.units": ("ResultUnits",),
    "porocore.interfaces.cell": (
        "CellField",
        "CellSolution",
        "CellSolver",
        "ElementCells",
    ),
    "porocore.interfaces.command": (
        "Command",
        "FileCheck",
    ),
    "porocore.interfaces.macro": ("MacroSolver",),
    "porocore.interfaces.sampler": (
        "Exploration",
        "Request",
        "Sampler",
        "StudyFacts",
        "StudySampler",
    ),
    "porocore.interfaces.records": (
        "RestData",
        "failed_response",
    ),
    "porocore.interfaces.surrogate": (
        "Surrogate",
        "TrainingProgress",
        "TrainingSet",
    ),
    "porocore.interfaces.law": (
        "LawMemory",
        "MacroLaw",
        "MacroResponse",
        "MacroTangent",
        "MemoryChanges",
        "PointChanges",
        "ResponseChanges",
    ),
    "porocore.interfaces.sensitivities": (
        "BoundaryChange",
        "CellParameterChange",
        "HatFunction",
        "HistoryWeights",
        "InitialPressureChange",
        "LoadChange",
        "MacroSensitivities",
        "ModulusChange",
        "ViscosityChange",
    ),
    "porocore.cell.materials.hyperelastic": ("NeoHookean",),
    "porocore.macro.laws.macro_law": (
        "Law",
        "LawResponse",
        "LawTangent",
    ),
    "porocore.macro.problem": ("MacroProblem",),
    "porocore.interfaces.solution": (
        "History",
        "MacroSolution",
        "Profile",
        "StepReport",
        "StepWork",
    ),
    "porocore.states": (
        "CellExtrema",
        "CellResponse",
        "CellSlopes",
        "CellTangent",
        "MacroState",
        "Status",
    ),
    "porocore.verification.local_fields.solve": ("write_local_fields",),
    "porocore.verification.representative.study": ("study_representative_volume",),
    "porocore.verification.reproduce": ("reproduce",),
    "porocore.verification.sensitivity.study": ("study_sensitivity",),
    "porocore.verification.stability": ("map_stability",),
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("porocore")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'porocore' has no attribute '{name}'")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
