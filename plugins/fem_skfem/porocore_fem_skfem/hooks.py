"""Offers of this plugin: its cell and macro solver by name; importing this module loads nothing heavy."""

from __future__ import annotations

from functools import partial
from typing import Any

from porocore.plugins.hookspecs import Offer, hookimpl


def _cell_solver() -> type[Any]:
    from porocore_fem_skfem.cell_solver import SkfemCellSolver

    return SkfemCellSolver


def _macro_solver() -> type[Any]:
    from porocore_fem_skfem.macro import SkfemMacroSolver

    return SkfemMacroSolver


def _cell_suites() -> list[type[Any]]:
    from porocore_fem_skfem.conformance import TestSkfemCellContact, TestSkfemCellSolver

    return [TestSkfemCellSolver, TestSkfemCellContact]


def _macro_suites() -> list[type[Any]]:
    from porocore_fem_skfem.conformance import TestSkfemMacroSolver

    return [TestSkfemMacroSolver]


_offer = partial(Offer, "skfem", requires=("skfem",), install="pip install porocore-fem-skfem")


@hookimpl
def porocore_cell_solvers() -> list[Offer]:
    summary = "scikit-fem elements, batched assembly, kept sparse factor"
    return [_offer(_cell_solver, summary, suites=_cell_suites)]


@hookimpl
def porocore_macro_solvers() -> list[Offer]:
    return [_offer(_macro_solver, "scikit-fem hexahedra, quadratic u and linear p", suites=_macro_suites)]
