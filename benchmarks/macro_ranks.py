"""(s) Large bodies by dolfinx on one and on two MPI processes: a time step, the iterations and the same solution."""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import h5py  # noqa: F401 - before dolfinx, which brings an HDF5 library of its own
import numpy as np
from common import table
from macro_size import GEOMETRY, problem

from porocore.testing.synthetic.response import mean_gradient_law

#: Edges of an element of the unit cube: 61,000 and 245,000 unknowns.
SIZES = (0.075, 0.046)


def solve(size: float, file: Path) -> dict[str, Any] | None:
    """In this process, one of several; the first returns what it took, and the last displacements."""
    from porocore_fem_dolfinx.macro import DolfinxMacroSolver

    solver = DolfinxMacroSolver(checkpoint_seconds=1e9)
    prepared = solver.prepare(problem(file, size))
    times, cpu = [perf_counter()], [process_time()]

    def note(report: object) -> None:
        times.append(perf_counter())
        cpu.append(process_time())

    solution = solver.solve(prepared, mean_gradient_law(), on_step=note)
    gib = solver.communicator.sum(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
    if solver.communicator.rank:
        return None
    return {
        "unknowns": prepared.mesh.size,
        "step": float(np.diff(times).mean()),
        "cpu": float(np.diff(cpu).mean()),
        "most": int(solution.work["most_iterations"].max()),
        "iterations": int(solution.work["iterations"].sum()),
        "set_ups": int(solution.work["set_ups"].sum()),
        "memory": float(gib),
        "settlement": solution.history.settlement.tolist(),
    }


def measure(size: float, ranks: int) -> dict[str, Any]:
    """Start so many processes, and return what the first of them printed."""
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cube.geo"
        file.write_text(GEOMETRY, encoding="utf-8")
        command = [sys.executable, __file__, "--solve", str(size), str(file)]
        if ranks > 1:
            command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment, text=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--solve", nargs=2, metavar=("SIZE", "FILE"))
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES)
    parser.add_argument("--ranks", type=int, nargs="+", default=(1, 2))
    arguments = parser.parse_args()
    if arguments.solve:
        result = solve(float(arguments.solve[0]), Path(arguments.solve[1]))
        if result is not None:
            print(json.dumps(result))
        return
    rows = []
    for size in arguments.sizes:
        found = [measure(size, ranks) for ranks in arguments.ranks]
        first = np.array(found[0]["settlement"])
        for ranks, r in zip(arguments.ranks, found, strict=True):
            apart = np.abs(np.array(r["settlement"]) - first).max() / np.abs(first).max()
            rows.append(
                [
                    f"{r['unknowns']:,}",
                    str(ranks),
                    f"{r['step']:.1f}",
                    f"{found[0]['step'] / r['step']:.2f}",
                    f"{r['cpu']:.1f}",
                    str(r["most"]),
                    str(r["iterations"]),
                    str(r["set_ups"]),
                    f"{r['memory']:.2f}",
                    f"{apart:.0e}",
                ]
            )
    header = ["unknowns", "processes", "mean step, s", "times as fast", "CPU of the first, s"]
    header += ["most iterations", "iterations", "set-ups", "GiB together", "settlement apart"]
    print(table("A cube of quadratic tetrahedra by dolfinx", header, rows))


if __name__ == "__main__":
    main()
