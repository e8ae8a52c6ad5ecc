"""Offers of this plugin: its cell and macro solver by name; importing this module loads nothing heavy."""

from __future__ import annotations

from functools import partial
from typing import Any

from porocore.plugins.hookspecs import Offer, hookimpl


def _cell_solver() -> type[Any]:
    from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver

    return DolfinxCellSolver


def _macro_solver() -> type[Any]:
    from porocore_fem_dolfinx.macro import DolfinxMacroSolver

    return DolfinxMacroSolver


def _cell_suites() -> list[type[Any]]:
    from porocore_fem_dolfinx.conformance import TestDolfinxCellContact, TestDolfinxCellSolver

    return [TestDolfinxCellSolver, TestDolfinxCellContact]


def _macro_suites() -> list[type[Any]]:
    from porocore_fem_dolfinx.conformance import TestDolfinxMacroSolver

    return [TestDolfinxMacroSolver]


_offer = partial(
    Offer,
    "dolfinx",
    requires=("dolfinx", "petsc4py"),
    install="apt-get install python3-dolfinx-real (Debian, in a virtual environment made with "
    "--system-site-packages), or conda install -c conda-forge fenics-dolfinx",
)


@hookimpl
def porocore_cell_solvers() -> list[Offer]:
    return [_offer(_cell_solver, "UFL forms, PETSc's sparse direct solvers", suites=_cell_suites)]


@hookimpl
def porocore_macro_solvers() -> list[Offer]:
    return [_offer(_macro_solver, "UFL forms on hexahedra, PETSc, MPI", suites=_macro_suites)]
