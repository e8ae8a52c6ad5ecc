"""(i) Contact: what a solve costs with and without it, what the meshes say, and what the penalty's stiffness changes.

Times are of one solve with all derivatives from the equilibrium at 0.95 of the load, as the sampling does it. To have
something to compare with, the solves without contact let the wall pass through itself.
"""

from __future__ import annotations

import numpy as np
from common import best, table

import porocore.cell.equilibrium.responses as path
from porocore.cell.cell import Cell
from porocore.states import MacroState, Status
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: Elements, size, and H22 at p = 0.
STATES = [
    (element, size, h)
    for element, size in (("linear", 0.05), ("quadratic-curved", 0.1))
    for h in (-0.20, -0.28, -0.32, -0.36)
]
SIZES = (0.2, 0.1, 0.08)
PATH = (-0.20, -0.24, -0.28, -0.32, -0.36, -0.40)
#: P_E,22 on PATH at p = 0 of an independent solver (straight second-order elements, sizes 0.08 to 0.05).
PUBLISHED = (-0.110, -0.135, -0.157, -0.178, -0.205, -0.24)


def cell(size: float, **contact: object) -> Cell:
    return Cell.model_validate({"mesh": {"size": size}, "contact": contact})


def solve_each(
    solver: SkfemCellSolver, prepared: object, p: float, path: tuple[float, ...]
) -> list[tuple[str, float]]:
    found = []
    for h in path:
        response = solver.solve(
            prepared, MacroState.single(np.diag([0.0, h, 0.0]), p), tangent=False
        ).response
        found.append((Status(int(response.status[0])).name, float(response.stress[0, 1, 1])))
    return found


def cost() -> list[list[str]]:
    rows, overlaps = [], path._overlaps
    solver = SkfemCellSolver()
    for element, size, h in STATES:
        H = np.diag([0.0, h, 0.0])
        times, names = {}, {}
        for kind in ("none", "frictionless"):
            path._overlaps = overlaps if kind == "frictionless" else lambda problem, here: False
            mesh = {"size": size, "element": element}
            prepared = solver.prepare(Cell.model_validate({"mesh": mesh, "contact": {"kind": kind}}))
            near = MacroState.single(0.95 * H, 0.0)
            start = solver.solve(prepared, near, tangent=False, fields=True).fields
            state = MacroState.single(H, 0.0)
            times[kind], solution = best(lambda a=prepared, b=state, c=start: solver.solve(a, b, start=c))
            names[kind] = Status(int(solution.response.status[0])).name
        path._overlaps = overlaps
        ratio = times["frictionless"] / times["none"]
        rows.append(
            [element, f"{size:g}", f"{h:g}", f"{times['none']:.2f}", names["frictionless"],
             f"{times['frictionless']:.2f}", f"{ratio:.1f}"]
        )  # fmt: skip
    return rows


def main() -> str:
    header = ["elements", "size", "H22", "without, s", "with", "s", "ratio"]
    text = table("(i) Cost of contact at p = 0, eighth of the cell", header, cost())
    rows = [["independent", *(f"{P:.3f}" for P in PUBLISHED)]]
    for size in SIZES:
        solver = SkfemCellSolver()
        found = solve_each(solver, solver.prepare(cell(size)), 0.0, PATH)
        rows.append([f"{size:g}", *(f"{P:.4f} ({name})" for name, P in found)])
    text += "\n" + table("P_E,22 at p = 0", ["size", *(f"H22 = {h:g}" for h in PATH)], rows)
    rows = []
    for stiffness in (7.5, 15, 30):
        solver = SkfemCellSolver()
        found = solve_each(solver, solver.prepare(cell(0.1, stiffness=stiffness)), 0.0, PATH)
        rows.append([str(stiffness), *(f"{P:.4f}" for _, P in found)])
    return (
        text
        + "\n"
        + table(
            "Influence of the penalty, size 0.1", ["stiffness [E/h]", *(f"H22 = {h:g}" for h in PATH)], rows
        )
    )


if __name__ == "__main__":
    print(main())
