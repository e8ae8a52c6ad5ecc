"""Cell solver on scikit-fem's elements: its options, the discrete solid and the discrete fluid of a mesh."""

from __future__ import annotations

from typing import Any

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import make_contact_model
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore_fem_skfem.solid import SkfemSolid
from porocore_fem_skfem.stokes import SkfemStokes


class SkfemCellSolver(EquilibriumCellSolver):
    """Cell problems with scikit-fem's elements, batched numpy assembly and a sparse factor that is kept.

    Parameters
    ----------
    quadrature_degree : int, 1 to 12
        Degree that the solid's quadrature integrates exactly; null: 2 (four points), and 1 for linear elements, whose
        gradients are constant.
    solver : {"auto", "pardiso", "superlu", "amg"}
        Linear solver of the cell; ``auto`` takes the best that is installed, multigrid beyond 50,000 unknowns.
    """

    def __init__(self, *, quadrature_degree: int | None = None, solver: str = "auto", **unknown: Any) -> None:
        if unknown:
            raise ConfigurationError(
                f"fem.options: unknown key {echo(min(unknown))}; scikit-fem takes quadrature_degree and solver"
            )
        super().__init__(quadrature_degree=quadrature_degree)
        self.solver = solver

    def solid(self, cell: Cell, mesh: CellMesh, material: StrainEnergy | None = None) -> SkfemSolid:
        degree = self.quadrature_degree or mesh.quadrature_degree
        material = cell.solid.on(mesh) if material is None else material
        contact = make_contact_model(mesh, cell.contact, material)
        return SkfemSolid(mesh, material, degree=degree, solver=self.solver, contact=contact)

    def fluid(self, mesh: CellMesh) -> SkfemStokes:
        return SkfemStokes(mesh, self.solver)
