"""(h) The two FEM backends side by side: the cell at three sizes, the fluid, and the macroscale step."""

from __future__ import annotations

from functools import partial

import h5py  # noqa: F401 - before dolfinx, which brings an HDF5 library of its own
import numpy as np
from common import best, table

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.macro.body.kinds import Box
from porocore.macro.laws.closure import MeanGradientClosure
from porocore.macro.laws.linear import LinearCellLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import Boundary, MacroProblem, TimePlan
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver
from porocore_fem_dolfinx.macro import DolfinxMacroSolver
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.macro import SkfemMacroSolver

SHEAR = np.zeros((3, 3))
SHEAR[0, 1] = 0.05
COMPRESSED = np.diag([0.0, -0.15, 0.0])
#: Title, cell, displacement gradient, runs.
CELLS = (
    ("eighth, curved, H_22 = −0.15", Cell(), COMPRESSED, 3),
    ("whole, curved, H_12 = 0.05", Cell(), SHEAR, 2),
    (
        "whole, the paper's size, H_12 = 0.05",
        Cell(mesh=MeshSettings(size=0.0308, element="linear")),
        SHEAR,
        1,
    ),
)
SOLVERS = {
    "skfem": SkfemCellSolver,
    "dolfinx, MUMPS": lambda: DolfinxCellSolver(solver="mumps"),
    "dolfinx, CHOLMOD": lambda: DolfinxCellSolver(solver="cholmod"),
    "dolfinx, GAMG": lambda: DolfinxCellSolver(solver="gamg"),
}
SIDE = Boundary(displacement=(0.0, None, 0.0))


def cells() -> str:
    rows = []
    for title, cell, H, runs in CELLS:
        for name, make in SOLVERS.items():
            solver = make()
            prepared = solver.prepare(cell)
            setup, first = best(partial(solver.solve_one, prepared, H, tangent=False), 1)
            plain, _ = best(partial(solver.solve_one, prepared, H, tangent=False), runs)
            full, response = best(partial(solver.solve_one, prepared, H), runs)
            stress = float(response.stress[0].ravel()[np.abs(first.stress[0]).argmax()])
            rows.append([title, name, f"{setup:.2f}", f"{plain:.2f}", f"{full:.2f}", f"{stress:.8f}"])
    return table(
        "(h) The solid cell problem",
        ["cell", "backend", "first solve s", "solve s", "with derivatives s", "largest stress"],
        rows,
    )


def fluid() -> str:
    rows = []
    for name in ("skfem", "dolfinx, MUMPS"):
        solver = SOLVERS[name]()
        seconds, K = best(lambda s=solver: s.conductivity(s.prepare(Cell())), 2)
        rows.append([name, f"{seconds:.2f}", f"{K[0, 0]:.10f}"])
    return table("The fluid cell problem, eighth, default mesh", ["backend", "seconds", "K_11"], rows)


def macro() -> str:
    solver = SkfemCellSolver()
    prepared = solver.prepare(Cell())
    reference = solver.solve_one(prepared, np.zeros((3, 3)))
    rows = []
    for title, size, elements in (
        ("column, 1 × 106 × 1", (0.1, 7.5, 0.1), (1, 106, 1)),
        ("block, 4 × 8 × 4", (1.0, 2.0, 1.0), (4, 8, 4)),
    ):
        problem = MacroProblem(
            body=Box(size=size, elements=elements),
            load=-0.05,
            boundary={
                "y-": Boundary(displacement=(0.0, 0.0, 0.0)),
                "y+": Boundary(traction=(0.0, 1.0, 0.0), pressure=0.0),
                "x-": SIDE,
                "x+": SIDE,
                "z-": SIDE,
                "z+": SIDE,
            },
            time=TimePlan(end=2.5, step=0.5, profiles=(2.5,)),
        )
        law = ClosedLaw(
            LinearCellLaw(reference),
            MeanGradientClosure(
                1 - float(reference.fluid_volume[0]),
                Cell().material,
                solver.conductivity(prepared),
            ),
        )
        for name, make in (("skfem", SkfemMacroSolver), ("dolfinx", DolfinxMacroSolver)):
            backend = make()
            setup, ready = best(partial(backend.prepare, problem), 1)
            seconds, solution = best(partial(backend.solve, ready, law), 2)
            solves = float(solution.history.iterations.sum())
            rows.append(
                [
                    title,
                    name,
                    f"{setup:.2f}",
                    f"{1e3 * seconds / solves:.0f}",
                    f"{solution.history.settlement[-1]:.12f}",
                ]
            )
    return table(
        "The macroscale, quadratic hexahedra, mean-gradient closure",
        ["body", "backend", "set-up s", "ms a Newton iteration", "settlement"],
        rows,
    )


def main() -> None:
    for part in (cells, fluid, macro):
        print(part(), flush=True)


if __name__ == "__main__":
    main()
