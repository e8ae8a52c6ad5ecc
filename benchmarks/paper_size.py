"""(c) The whole periodic cell under shear: at the paper's own size, and at 1 % error; seconds of the processor."""

from __future__ import annotations

import time

import numpy as np
from common import in_turn, table

from porocore.cell.cell import Cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: What the paper reports for one solve without derivatives: solving, and averaging.
PAPER_SECONDS = 6.514 + 14
H = np.zeros((3, 3))
H[0, 1] = 0.05


def main() -> str:
    solver = SkfemCellSolver()
    fine = solver.prepare(Cell(mesh={"size": 0.13, "element": "quadratic-curved"}))
    exact = solver.solve_one(fine, H).tangent.mean_grad_grad_u[0, 0, 1, 0, 1]
    rows = []
    for title, mesh in (
        ("the paper's size, first order", {"size": 0.0308, "element": "linear"}),
        ("curved second order", {"size": 0.2, "element": "quadratic-curved"}),
    ):
        prepared = solver.prepare(Cell(mesh=mesh))
        began = time.process_time()
        prepared.whole.reset()
        setup = time.process_time() - began
        (plain, seconds), (_, response) = in_turn(
            [
                lambda p=prepared: solver.solve_one(p, H, tangent=False),
                lambda p=prepared: solver.solve_one(p, H),
            ],
            rounds=3,
        )
        error = abs(response.tangent.mean_grad_grad_u[0, 0, 1, 0, 1] / exact - 1)
        rows.append(
            [
                title,
                f"{len(prepared.whole.mesh.cells):,}",
                f"{len(prepared.whole.constraints().free):,}",
                f"{100 * error:.2f} %",
                f"{setup:.1f}",
                f"{plain:.2f}",
                f"{seconds:.2f}",
            ]
        )
    text = table(
        "(c) Whole periodic cell, H_12 = 0.05",
        ["mesh", "tetrahedra", "unknowns", "error of M_1212", "set-up s", "solve s", "with derivatives s"],
        rows,
    )
    return (
        text
        + f"\nThe paper: 147,043 tetrahedra, {PAPER_SECONDS:.1f} s without derivatives (other hardware).\n"
    )


if __name__ == "__main__":
    print(main())
