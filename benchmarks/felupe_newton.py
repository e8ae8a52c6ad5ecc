"""(a) Newton's method on one mesh of first-order tetrahedra: porocore against FElupe, both with MKL PARDISO."""

from __future__ import annotations

import felupe
import numpy as np
from common import best, table
from pypardiso import spsolve

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.path import follow
from porocore_fem_skfem.cell_solver import SkfemCellSolver

H_22, TOLERANCE = -0.15, 1e-9


def felupe_solve(cell: Cell) -> float:
    """<P_22>_s of the eighth by FElupe; its normal displacements are prescribed on the six planes."""
    mesh = cell.make_mesh("solid", "eighth")
    region = felupe.RegionTetra(felupe.Mesh(mesh.points, mesh.cells, "tetra"))
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    material = felupe.NeoHookeCompressible(mu=cell.material.mu, lmbda=cell.material.lam)
    solid = felupe.SolidBody(material, field)
    boundaries = {}
    for axis, name in enumerate("xyz"):
        skip = tuple(int(i != axis) for i in range(3))
        boundaries[f"low {name}"] = felupe.Boundary(field[0], **{f"f{name}": 0.0}, skip=skip)
        boundaries[f"high {name}"] = felupe.Boundary(
            field[0], **{f"f{name}": 0.5}, skip=skip, value=H_22 / 2 if name == "y" else 0.0
        )
    dof0, dof1 = felupe.dof.partition(field, boundaries)
    ext0 = felupe.dof.apply(field, boundaries, dof0)
    felupe.newtonraphson(
        items=[solid], dof0=dof0, dof1=dof1, ext0=ext0, solver=spsolve, tol=TOLERANCE, verbose=0
    )
    return float(8 * np.sum(solid.results.stress[0][1, 1] * region.dV))


def main() -> str:
    cell = Cell(mesh={"size": 0.0318, "element": "linear"})
    solver = SkfemCellSolver()
    prepared = solver.prepare(cell)
    H = np.diag([0.0, H_22, 0.0])
    solver.solve_one(prepared, H / 2)

    def ours() -> None:
        follow(prepared.eighth, prepared.eighth.iterate_at(np.zeros((3, 3)), 0.0), H, 0.0, TOLERANCE)

    baseline, stress = best(lambda: felupe_solve(cell))
    alone, _ = best(ours)
    everything, response = best(lambda: solver.solve_one(prepared, H))
    difference = abs(response.stress[0, 1, 1] - stress) / abs(stress)
    tetrahedra = len(prepared.eighth.mesh.cells)
    rows = [
        ["FElupe, Newton", f"{baseline:.3f}", "1.00"],
        ["porocore, Newton", f"{alone:.3f}", f"{alone / baseline:.2f}"],
        [
            "porocore, Newton, averages and all derivatives",
            f"{everything:.3f}",
            f"{everything / baseline:.2f}",
        ],
    ]
    text = table(
        f"(a) {tetrahedra:,} first-order tetrahedra, eighth of the cell, H_22 = {H_22}",
        ["", "seconds", "of FElupe's time"],
        rows,
    )
    return text + f"\n<P_22> of the two differs by {difference:.1e}.\n"


if __name__ == "__main__":
    print(main())
