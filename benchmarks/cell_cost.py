"""Time and memory of cell problems on images against what ``porocore check`` expects, one process for each of them.

The images are of smoothed noise, half of them pores, three voxels a tetrahedron; each is a whole periodic cell, or the
eighth of one with mirrors. Seconds are those of the processor, so that other work on the machine counts little. The
rows are what ``porocore/study/notes/cost.py`` holds.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from common import table

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import Domain, MeshSettings
from porocore.states import Status
from porocore.study.notes import cost
from porocore.testing.cell_checks.base import image_cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: Voxels along an edge of the images of whole cells and of eighths.
IMAGES: dict[Domain, tuple[int, ...]] = {"whole": (12, 16, 24, 32, 48, 64), "eighth": (12, 24, 32, 40, 48)}
VOXELS = 3
#: Domains that are solved, by how an image becomes a cell, and the names of the solid's problem and of K there.
REPEATS: dict[Domain, Literal["periodic", "mirror"]] = {"whole": "periodic", "eighth": "mirror"}
PROBLEMS = ("state", "K")
#: An estimate within this factor of what is found is a good one.
FACTOR = 2.0


def measure(what: str, domain: Domain, voxels: int) -> dict[str, float]:
    """Return the nodes of a phase, and seconds and bytes of two states with derivatives, or of K."""
    with TemporaryDirectory() as folder:
        size = VOXELS / voxels * (1.0 if domain == "whole" else 0.5)
        image = image_cell(Path(folder) / "image.npy", 0, voxels, REPEATS[domain])
        geometry = image.model_copy(update={"drop_grains": True})
        cell = Cell(geometry=geometry, mesh=MeshSettings(size=size, fluid_size=size))
        nodes = len(cell.make_mesh("solid" if what == "state" else "fluid", domain).points)
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


def main(images: tuple[int, ...] = ()) -> float:
    rows, worst = [], 1.0
    cases = [
        (domain, voxels)
        for domain in REPEATS
        for voxels in IMAGES[domain]
        if voxels in (images or IMAGES[domain])
    ]
    for (domain, voxels), what in product(cases, PROBLEMS):
        costs = cost.WHOLE if domain == "whole" else cost.EIGHTH
        laws = {"first": costs.first, "seconds": costs.state, "bytes": costs.solid}
        if what == "K":
            laws = {"seconds": costs.conductivity, "bytes": costs.fluid}
        ran = subprocess.run(
            [sys.executable, __file__, what, domain, str(voxels)], check=True, capture_output=True, text=True
        )
        found = json.loads(ran.stdout)
        for name, law in laws.items():
            ratio = law.at(found["nodes"]) / found[name]
            if name != "first":
                worst = max(worst, ratio, 1 / ratio)
            measured = [f"{found['nodes']:,}", name, f"{found[name]:.4g}", f"{ratio:.2f}"]
            rows.append([f"{what}, {domain}", f"{voxels}³", *measured])
    print(table("Cost of cell problems", ["", "image", "nodes", "", "measured", "of that expected"], rows))
    return worst


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] in PROBLEMS:
        print(
            json.dumps(
                measure(sys.argv[1], "eighth" if sys.argv[2] == "eighth" else "whole", int(sys.argv[3]))
            )
        )
        sys.exit(0)
    sys.exit(0 if main(tuple(map(int, sys.argv[1:]))) < FACTOR else 1)
