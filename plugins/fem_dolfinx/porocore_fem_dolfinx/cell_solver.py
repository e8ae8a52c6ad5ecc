"""Cell solver on dolfinx and PETSc: its options, the discrete solid and the discrete fluid of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import make_contact_model
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore_fem_dolfinx.linalg import choose_solver
from porocore_fem_dolfinx.petsc_options import OptionValue
from porocore_fem_dolfinx.solid import DolfinxSolid
from porocore_fem_dolfinx.stokes import DolfinxStokes


class DolfinxCellSolver(EquilibriumCellSolver):
    """Cell problems as UFL forms, with PETSc's linear solvers; each process solves its own states.

    Parameters
    ----------
    quadrature_degree : int, 1 to 12
        Degree that the solid's quadrature integrates exactly; null: 2 (four points), and 1 for linear elements, whose
        gradients are constant.
    solver : {"auto", "mumps", "cholmod", "gamg"}
        PETSc's linear solver of the solid; ``auto`` is MUMPS up to 30,000 unknowns, CHOLMOD up to 100,000 and multigrid
        beyond.
    petsc : mapping
        PETSc options for it, such as ``mat_mumps_icntl_7: 5``; they go before what ``solver`` means.
    """

    def __init__(
        self,
        *,
        quadrature_degree: int | None = None,
        solver: str = "auto",
        petsc: Mapping[str, OptionValue] | None = None,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise ConfigurationError(
                f"fem.options: unknown key '{min(unknown)}'; dolfinx takes quadrature_degree, solver and petsc"
            )
        super().__init__(quadrature_degree=quadrature_degree)
        if petsc is not None and not isinstance(petsc, Mapping):
            raise ConfigurationError(
                f"fem.options.petsc: expected PETSc options such as 'ksp_type: cg', got {echo(petsc)}"
            )
        choose_solver(solver, 0)
        self.solver, self.petsc = solver, dict(petsc or {})

    def solid(self, cell: Cell, mesh: CellMesh, material: StrainEnergy | None = None) -> DolfinxSolid:
        degree = self.quadrature_degree or mesh.quadrature_degree
        material = cell.solid.on(mesh) if material is None else material
        contact = make_contact_model(mesh, cell.contact, material)
        return DolfinxSolid(
            mesh, material, degree=degree, solver=self.solver, petsc=self.petsc, contact=contact
        )

    def fluid(self, mesh: CellMesh) -> DolfinxStokes:
        return DolfinxStokes(mesh)
