"""Time and memory of cell problems on images against what ``porocore check`` expects, one process for each of them.

The images are of smoothed noise, half of them pores, three voxels a tetrahedron. Seconds are those of the processor, so
that other work on the machine counts little. The rows are what ``porocore/study/preflight/cost.py`` holds.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import table

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.states import Status
from porocore.study.preflight import cost
from porocore.testing.cell_laws.open_cells import image_cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: Voxels along an edge of the images.
IMAGES = (16, 24, 32, 48, 64)
VOXELS = 3
#: An estimate within this factor of what is found is a good one.
FACTOR = 2.0


def measure(what: str, voxels: int) -> dict[str, float]:
    """Return the nodes of a phase, and seconds and bytes of two states with derivatives, or of K."""
    with TemporaryDirectory() as folder:
        size = VOXELS / voxels
        geometry = image_cell(Path(folder) / "image.npy", 0, voxels)
        cell = Cell(geometry=geometry, mesh=MeshSettings(size=size, fluid_size=size))
        nodes = len(cell.make_mesh("solid" if what == "state" else "fluid", "whole").points)
        solver, low = SkfemCellSolver(), _peak()
        prepared = solver.prepare(cell)
        clock = [time.process_time()]
        for axis in (0, 1) if what == "state" else (0,):
            if what == "state":
                found = solver.solve_one(prepared, -0.02 * np.diag(np.eye(3)[axis]))
                assert Status(int(found.status[0])).has_values, "a state has no values"
            else:
                solver.conductivity(prepared)
            clock.append(time.process_time())
    seconds = np.diff(clock)
    first = seconds[0] - seconds[-1]
    return {"nodes": nodes, "first": first, "seconds": seconds[-1], "bytes": _peak() - low}


def _peak() -> float:
    """Return the largest memory of this process so far [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(images: tuple[int, ...] = IMAGES) -> float:
    rows, worst = [], 1.0
    for what, laws in (
        ("state", {"first": cost.FIRST, "seconds": cost.STATE, "bytes": cost.SOLID}),
        ("K", {"seconds": cost.CONDUCTIVITY, "bytes": cost.FLUID}),
    ):
        for voxels in images:
            ran = subprocess.run(
                [sys.executable, __file__, what, str(voxels)], check=True, capture_output=True, text=True
            )
            found = json.loads(ran.stdout)
            for name, law in laws.items():
                ratio = law.at(found["nodes"]) / found[name]
                if name != "first":
                    worst = max(worst, ratio, 1 / ratio)
                rows.append(
                    [what, f"{voxels}³", f"{found['nodes']:,}", name, f"{found[name]:.4g}", f"{ratio:.2f}"]
                )
    print(table("Cost of cell problems", ["", "image", "nodes", "", "measured", "of that expected"], rows))
    return worst


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in ("state", "K"):
        print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
        sys.exit(0)
    sys.exit(0 if main(tuple(map(int, sys.argv[1:])) or IMAGES) < FACTOR else 1)
