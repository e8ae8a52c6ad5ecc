"""(l) A three-dimensional body of 1,000 to 20,000 tetrahedra: time and memory of a time step against size."""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import h5py  # noqa: F401 - before dolfinx, which brings an HDF5 library of its own
import numpy as np
from common import table

from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import mean_gradient_law

#: Edge of an element of the unit cube.
SIZES = (0.178, 0.128, 0.096, 0.0635)
GEOMETRY = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1};
Physical Volume("body") = {1};
Physical Surface("bottom") = Surface In BoundingBox {-0.001, -0.001, -0.001, 1.001, 0.001, 1.001};
Physical Surface("top") = Surface In BoundingBox {-0.001, 0.999, -0.001, 1.001, 1.001, 1.001};
Physical Surface("left") = Surface In BoundingBox {-0.001, -0.001, -0.001, 0.001, 1.001, 1.001};
Physical Surface("front") = Surface In BoundingBox {-0.001, -0.001, -0.001, 1.001, 1.001, 0.001};
"""


def problem(file: Path, size: float) -> MacroProblem:
    """A cube pressed on a part of its drained top, by up to 4 % of its height: four steps, 2 to 4 iterations each."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "file", "path": str(file), "size": size},
            "surfaces": {"strip": {"of": "top", "x": (0, 0.4)}},
            "boundary": {
                "bottom": {"displacement": (0, 0, 0)},
                "left": {"normal": 0},
                "front": {"normal": 0},
                "top": {"pressure": 0},
                "strip": {"traction": (0, 1, 0), "pressure": 0},
            },
            "load": -0.02,
            "time": {"end": 0.2, "step": 0.05, "ramp_increments": 2, "ramp_step": 0.05, "profiles": ()},
        }
    )


def solve(backend: str, size: float) -> dict[str, float]:
    """In this process: sizes, seconds and GiB."""
    if backend == "skfem":
        from porocore_fem_skfem.macro import SkfemMacroSolver as Solver
    else:
        from porocore_fem_dolfinx.macro import DolfinxMacroSolver as Solver
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cube.geo"
        file.write_text(GEOMETRY, encoding="utf-8")
        began = perf_counter()
        solver = Solver(checkpoint_seconds=1e9)
        prepared = solver.prepare(problem(file, size))
    ready = perf_counter()
    times = [ready]
    solver.solve(prepared, mean_gradient_law(), on_step=lambda report: times.append(perf_counter()))
    return {
        "elements": len(prepared.mesh.cells),
        "unknowns": prepared.mesh.size,
        "prepare": ready - began,
        "step": float(np.diff(times).mean()),
        "longest": float(np.diff(times).max()),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--solve", nargs=2, metavar=("BACKEND", "SIZE"))
    arguments = parser.parse_args()
    if arguments.solve:
        print(json.dumps(solve(arguments.solve[0], float(arguments.solve[1]))))
        return
    rows, found = [], {}
    for backend in ("skfem", "dolfinx"):
        found[backend] = []
        for size in SIZES:  # a process each, so that the memory is its own
            command = [sys.executable, __file__, "--solve", backend, str(size)]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=os.environ)
            result = json.loads(done.stdout.splitlines()[-1])
            found[backend].append(result)
            rows.append(
                [
                    backend,
                    f"{result['elements']:,}",
                    f"{result['unknowns']:,}",
                    f"{result['prepare']:.1f}",
                    f"{result['step']:.1f}",
                    f"{result['longest']:.1f}",
                    f"{result['memory']:.2f}",
                ]
            )
        logs = np.log([[r["elements"], r["step"], r["memory"]] for r in found[backend]])
        time, memory = (np.polyfit(logs[-3:, 0], logs[-3:, i], 1)[0] for i in (1, 2))
        rows.append([backend, "exponent", "", "", f"{time:.2f}", "", f"{memory:.2f}"])
    header = ["backend", "elements", "unknowns", "prepare, s", "mean step, s", "longest step, s", "GiB"]
    print(table("A cube of quadratic tetrahedra", header, rows))


if __name__ == "__main__":
    main()
