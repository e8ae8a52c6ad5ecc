"""(a) Newton's method on one mesh of first-order tetrahedra: porocore against FElupe, both with MKL PARDISO.

Both use one thread and take turns, and their processor times are compared. Wall times of single runs on a machine with
other work gave ratios from 0.30 to 0.59. Its status is 1 where the ratio with all derivatives exceeds ``LARGEST``.
"""

from __future__ import annotations

import sys

import felupe
import numpy as np
from common import in_turn, table
from pypardiso import spsolve

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.responses import follow
from porocore_fem_skfem.cell_solver import SkfemCellSolver

H_22, TOLERANCE = -0.15, 1e-9
#: Largest share of FElupe's time that Newton's method and all derivatives may take.
LARGEST = 0.40


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


def main() -> bool:
    cell = Cell(mesh={"size": 0.0318, "element": "linear"})
    solver = SkfemCellSolver()
    prepared = solver.prepare(cell)
    H = np.diag([0.0, H_22, 0.0])

    def newton() -> None:
        follow(prepared.eighth, prepared.eighth.iterate_at(np.zeros((3, 3)), 0.0), H, 0.0, TOLERANCE)

    works = (lambda: felupe_solve(cell), newton, lambda: solver.solve_one(prepared, H))
    (baseline, *times), (stress, _, response) = in_turn(works)
    difference = abs(response.stress[0, 1, 1] - stress) / abs(stress)
    names = ("porocore, Newton", "porocore, Newton, averages and all derivatives")
    rows = [["FElupe, Newton", f"{baseline:.3f}", "1.00"]]
    rows += [[name, f"{t:.3f}", f"{t / baseline:.2f}"] for name, t in zip(names, times, strict=True)]
    tetrahedra = len(prepared.eighth.mesh.cells)
    title = f"(a) {tetrahedra:,} first-order tetrahedra, eighth of the cell, H_22 = {H_22}"
    print(table(title, ["", "processor seconds", "of FElupe's time"], rows))
    print(f"<P_22> of the two differs by {difference:.1e}.\n")
    return bool(times[-1] <= LARGEST * baseline)


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
