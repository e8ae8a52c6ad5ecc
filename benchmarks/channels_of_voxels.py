"""Straight round and square channels of so many voxels, as images: K against Hagen and Poiseuille and the duct.

Their shear modulus across is held to that of a round channel that gmsh draws, and to hexahedra with sharp corners.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import table

from porocore import CellProblem
from porocore.cell.cell import Cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: Voxels across a channel, and edges of the elements in voxels.
CHANNELS = {10: (1.0, 0.5), 20: (2.0, 1.0), 40: (4.0, 2.0)}
SMOOTHINGS = (0.0, 1.0)
#: Flux through a square duct of side a is this times a⁴; see White, Viscous fluid flow, chapter 3.
DUCT = 0.0351442
#: Shear modulus, in multiples of E, across a square channel that is half as wide as its cell, Poisson's ratio 0.35:
#: linear hexahedra as in ``tests/cell/test_image_corners.py``, 20, 40 and 80 of them across, continued to size 0.
SHEAR = 0.1089
#: Largest errors with smoothing 0 and 1, of the square channel of 10 voxels.
GOALS = 0.025, 0.06


def quarter(shape: str, voxels: int) -> np.ndarray:
    """Pores of a quarter of a channel along x in a quarter of a square that is twice as wide, (4, N, N)."""
    y, z = np.meshgrid(*[np.arange(voxels) + 0.5] * 2, indexing="ij")
    across = np.maximum(y, z) if shape == "square" else np.hypot(y, z)
    return np.broadcast_to(across < voxels / 2, (4, voxels, voxels))


def error(shape: str, voxels: int, smoothing: float, element: float, folder: Path) -> float:
    """Error of K, of a round channel against the circle with the area of its voxels."""
    path = folder / f"{shape}-{voxels}.npy"
    pores = quarter(shape, voxels)
    np.save(path, pores)
    geometry = {"kind": "voxels", "path": str(path), "pore": 1, "smoothing": smoothing}
    length = np.cbrt(8 * pores.size)
    size = min(0.5, element / length)
    cell = Cell(geometry=geometry, viscosity=1.0, mesh={"size": size, "fluid_size": size})
    solver = SkfemCellSolver()
    K = solver.conductivity(solver.prepare(cell))[0, 0] * length**2
    area = 4.0 * pores[0].sum()
    exact = DUCT * area**2 if shape == "square" else area**2 / (8 * np.pi)
    return float(K / (exact / (4 * voxels**2)) - 1)


def shear_error(shape: str, voxels: int, smoothing: float, folder: Path) -> float:
    """Error of the shear modulus across a channel, of a round one against the circle with the area of its voxels."""
    path = folder / f"{shape}-{voxels}-whole.npy"
    pores = quarter(shape, voxels)
    pores = np.concatenate([pores[:, ::-1], pores], axis=1)
    pores = np.concatenate([pores[:, :, ::-1], pores], axis=2)
    np.save(path, pores)
    geometry = {"kind": "voxels", "path": str(path), "pore": 1, "smoothing": smoothing, "repeat": "periodic"}
    size = 2.0001 * max(1, voxels / 20) / np.cbrt(pores.size)
    exact = (
        SHEAR
        if shape == "square"
        else shear(
            {"kind": "orthogonal-channels", "axes": "x", "radius": float(np.sqrt(pores.mean() / np.pi))}, 0.1
        )
    )
    return shear(geometry, size) / exact - 1


def shear(geometry: dict[str, object], size: float) -> float:
    cell = Cell(
        geometry=geometry,
        material={"kind": "neo-hookean", "poisson_ratio": 0.35},
        mesh={"size": size, "fluid_size": 0.5},
    )
    return float(CellProblem(cell, fem="skfem").properties.shear_moduli[0])


def main() -> dict[tuple[str, int], list[float]]:
    found = {}
    with TemporaryDirectory() as folder:
        for shape in ("square", "round"):
            for voxels, elements in CHANNELS.items():
                errors = [error(shape, voxels, s, e, Path(folder)) for s in SMOOTHINGS for e in elements]
                found[shape, voxels] = errors + [
                    shear_error(shape, voxels, s, Path(folder)) for s in SMOOTHINGS
                ]
    names = [f"smoothing {s:g}, {part} element" for s in SMOOTHINGS for part in ("larger", "smaller")]
    names += [f"G across, smoothing {s:g}" for s in SMOOTHINGS]
    rows = [[*map(str, key), *(f"{100 * e:+.2f} %" for e in errors)] for key, errors in found.items()]
    print(
        table(
            "Errors of K and of the shear modulus of straight channels as images",
            ["channel", "voxels across", *names],
            rows,
        )
    )
    return found


if __name__ == "__main__":
    worst = np.abs(main()["square", 10])
    sys.exit(0 if worst[1] < GOALS[0] and worst[3] < GOALS[1] else 1)
