"""Macro solver on dolfinx: its options, and the discretisation that it makes of a problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

from porocore.core.echo import echo
from porocore.core.parallel import Communicator
from porocore.errors import ConfigurationError
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.integration.solver import TimeSteppingMacroSolver
from porocore.macro.linear_systems import checked_solver
from porocore.macro.problem import MacroProblem, body_mesh
from porocore_fem_dolfinx import compat  # noqa: F401 - h5py before everything that brings MPI and PETSc
from porocore_fem_dolfinx.macro_assembly import DolfinxDiscretisation
from porocore_fem_dolfinx.macro_communicator import MpiCommunicator
from porocore_fem_dolfinx.petsc_options import OptionValue


class DolfinxMacroSolver(TimeSteppingMacroSolver):
    """Triquadratic hexahedra or quadratic tetrahedra with linear pressure, as UFL forms.

    Bodies in two dimensions have biquadratic quadrilaterals or quadratic triangles.
    The processes of MPI's world share the elements among them.

    Parameters
    ----------
    solver : {"auto", "direct", "iterative"}
        Solver of the linear systems: ``direct``, MUMPS' factors; ``iterative``, GMRES with multigrid, which takes less
        time and memory for large bodies; ``auto`` iterates above 10,000 unknowns.
    petsc : mapping
        PETSc options for it, without prefix, which go before its own; with ``auto`` they choose the solver. Those of
        ``direct`` are ``ksp_type: preonly``, ``pc_type: lu``, ``pc_factor_mat_solver_type: mumps``.
    checkpoint_seconds : float, at least 0
        Wall time between two checkpoints, in seconds; 0 writes one after every step.
    """

    distributed = True

    def __init__(
        self,
        *,
        solver: str = "auto",
        petsc: Mapping[str, OptionValue] | None = None,
        checkpoint_seconds: float = 5.0,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise ConfigurationError(
                f"macro.options: unknown key {echo(min(unknown))}; dolfinx takes solver, petsc and checkpoint_seconds"
            )
        if petsc is not None and not isinstance(petsc, Mapping):
            raise ConfigurationError(
                f"macro.options.petsc: expected PETSc options such as 'ksp_type: fgmres', got {echo(petsc)}"
            )
        super().__init__(checkpoint_seconds=checkpoint_seconds)
        self.solver, self.petsc = checked_solver(solver), dict(petsc or {})
        self._comm = MPI.COMM_WORLD
        self.communicator = MpiCommunicator(self._comm) if self._comm.size > 1 else Communicator()

    def prepare(self, problem: MacroProblem) -> DolfinxDiscretisation:
        """Return mesh, forms and linear solver; the solver is tried, so that wrong options are refused at once.

        Raises
        ------
        ConfigurationError
            Two surfaces contradict each other, a translation is not held, the body cannot be meshed, there are
            fewer elements than processes, or PETSc cannot use the options.
        """
        mesh = body_mesh(problem)
        return DolfinxDiscretisation(
            problem,
            mesh,
            boundary_data(mesh, problem),
            self._comm,
            self.communicator,
            self.petsc,
            self.solver,
        )
