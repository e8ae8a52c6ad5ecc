"""Images of the paper's cell, more and more voxels: what comes out, against the cell itself on a fine mesh."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import table

from porocore.cell.cell import Cell
from porocore.states import MacroState
from porocore_fem_skfem.cell_solver import SkfemCellSolver

RADIUS = 0.25
#: Voxels along an edge of the eighth, and sizes of the elements of solid and fluid.
IMAGES = {8: (0.06, 0.05), 16: (0.06, 0.05), 32: (0.05, 0.04), 64: (0.05, 0.04)}
#: Largest errors of K, M and Q at 64 voxels.
GOALS = 0.025, 0.005, 0.002


def pores(n: int) -> np.ndarray:
    """Voxels whose middles lie in a channel, (n, n, n)."""
    x = (np.arange(n) + 0.5) / (2 * n)
    X, Y, Z = np.meshgrid(x, x, x, indexing="ij")
    return np.minimum(np.minimum(X**2 + Y**2, Y**2 + Z**2), X**2 + Z**2) < RADIUS**2


def measure(geometry: dict, size: float, fluid_size: float) -> np.ndarray:
    """Porosity of the mesh, K_11 μ_f, M_2222, M_2211, Q_11."""
    cell = Cell(geometry=geometry, viscosity=1.0, mesh={"size": size, "fluid_size": fluid_size})
    solver = SkfemCellSolver()
    prepared = solver.prepare(cell)
    rest = solver.solve(prepared, MacroState.zeros(1)).response
    M, Q = rest.tangent.mean_grad_grad_u[0], rest.tangent.mean_grad_p[0]
    K = solver.conductivity(prepared)
    return np.array([rest.fluid_volume[0], K[0, 0], M[1, 1, 1, 1], M[1, 1, 0, 0], Q[0, 0]])


def _shown(values: np.ndarray) -> list[str]:
    return [f"{values[0]:.5f}", f"{1e3 * values[1]:.3f}", *(f"{x:.5f}" for x in values[2:])]


def main(images: dict = IMAGES) -> list[np.ndarray]:
    exact = measure({"radius": RADIUS}, 0.05, 0.04)
    rows, errors = [], []
    with TemporaryDirectory() as folder:
        for n, sizes in images.items():
            path = Path(folder) / f"pores-{n}.npy"
            np.save(path, pores(n))
            found = measure({"kind": "voxels", "path": str(path), "pore": 1}, *sizes)
            errors.append(found / exact - 1)
            rows.append([f"{n}³", *_shown(found), *(f"{100 * e:+.2f} %" for e in errors[-1][1:])])
    rows.append(["cell itself", *_shown(exact), "", "", "", ""])
    header = ["voxels of the eighth", "porosity", "10³ K μ_f", "M_2222", "M_2211", "Q_11"]
    header += [f"error of {name}" for name in ("K", "M_2222", "M_2211", "Q_11")]
    print(table("Images of the cell with channels of radius 0.25", header, rows))
    return errors


if __name__ == "__main__":
    last = np.abs(main()[-1])
    met = last[1] < GOALS[0] and last[2:4].max() < GOALS[1] and last[4] < GOALS[2]
    sys.exit(0 if met else 1)
