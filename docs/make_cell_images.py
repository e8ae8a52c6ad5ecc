"""The pictures of the kinds of cells in docs/cell.md, as ``porocore cell show`` draws them.

.venv/bin/python docs/make_cell_images.py [NAME …]
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.fields.pictures import render_phases, write_phases
from porocore.errors import PorocoreError

IMAGES = Path(__file__).parent / "images"
FINE = MeshSettings(size=0.07, fluid_size=0.07)
GEOMETRIES: dict[str, dict[str, Any]] = {
    "radii": {"radii": [0.15, 0.25, 0.35]},
    "bcc": {"kind": "sphere-pores", "lattice": "bcc", "radius": 0.32, "throat": 0.12},
    "spheres": {
        "kind": "sphere-pores",
        "centres": [[0.1, 0.05, -0.2], [-0.35, -0.3, 0.3]],
        "radii": [0.3, 0.25],
        "throat": 0.12,
        "throats": [
            {"join": [0, 1]},
            {"join": [0, 0], "shift": [1, 0, 0]},
            {"join": [0, 0], "shift": [0, 1, 0], "radius": 0.08},
            {"join": [1, 1], "shift": [0, 0, 1]},
        ],
    },
    "gyroid": {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.6},
    "schwarz-p": {"kind": "tpms", "surface": "schwarz-p", "level": 0.0},
    "diamond": {"kind": "tpms", "surface": "diamond", "level": 0.0},
    "sheet": {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.7, "solid": "sheet"},
}


def image(folder: Path) -> dict[str, Any]:
    """Overlapping spherical pores as voxels, to be mirrored."""
    n, rng = 32, np.random.default_rng(3)
    x = (np.arange(n) + 0.5) / n
    X = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1)
    pores = np.zeros((n, n, n), dtype=bool)
    for centre, radius in zip(rng.uniform(0, 1, (6, 3)), rng.uniform(0.28, 0.42, 6), strict=True):
        pores |= ((X - centre) ** 2).sum(axis=-1) < radius**2
    np.save(folder / "pores.npy", pores)
    return {"kind": "voxels", "path": str(folder / "pores.npy"), "pore": 1}


def mesh_file(folder: Path) -> dict[str, Any]:
    """Channels in two layers of solid, as a mesh with three tags."""
    cell = Cell(mesh=FINE)
    solid, fluid = (cell.make_mesh(phase, "whole") for phase in ("solid", "fluid"))
    nodes = np.concatenate([solid.points, fluid.points])
    points, inverse = np.unique(nodes, axis=0, return_inverse=True)
    cells = inverse.reshape(-1)[np.concatenate([solid.cells, fluid.cells + len(solid.points)])]
    tags = np.where(points[cells[:, :4]].mean(axis=1)[:, 2] > 0, 2, 1)
    tags[len(solid.cells) :] = 3
    meshio.write(folder / "cell.vtu", meshio.Mesh(points, [("tetra10", cells)], cell_data={"phase": [tags]}))
    return {"kind": "mesh-file", "path": str(folder / "cell.vtu"), "solid": [1, 2], "fluid": [3]}


def main() -> None:
    """Write docs/images/cell-<name>.png, all of them or those that the command line names."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        geometries = GEOMETRIES | {"voxels": image(folder), "mesh-file": mesh_file(folder)}
        for name in sys.argv[1:] or geometries:
            if name not in geometries:
                sys.exit(f"unknown picture {name}; there are {', '.join(geometries)}")
            cell = Cell(geometry=geometries[name], mesh=FINE)
            path = IMAGES / f"cell-{name}.png"
            try:
                render_phases(cell, write_phases(cell, folder, name), path)
            except PorocoreError as error:
                sys.exit(f"error: {error}")
            print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
