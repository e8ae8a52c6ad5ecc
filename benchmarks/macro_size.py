"""(l) A three-dimensional body of 14,000 to 1,000,000 unknowns: time, iterations and memory against size."""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import h5py  # noqa: F401 - before dolfinx, which brings an HDF5 library of its own
import numpy as np
from common import table

from porocore.commands.verify.linear_cases import mean_gradient, potential
from porocore.core.parallel.memory import one_thread_in_children
from porocore.macro.linear_systems import work_figures
from porocore.macro.problem import MacroProblem

#: Edge of an element of the unit cube, and the unknowns that it leads to.
SIZES = {0.128: 14_000, 0.0635: 91_000, 0.045: 256_000, 0.0362: 490_000, 0.0285: 1_000_000}
#: Sizes that are solved by default, and by a factor for comparison.
UP_TO, FACTORS_UP_TO = 300_000, 100_000
#: Unknowns from which on the exponents count.
LARGE = 50_000
BACKENDS, LAWS = ("skfem", "dolfinx"), {"mean-gradient": mean_gradient, "potential": potential}
GEOMETRY = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1};
Physical Volume("body") = {1};
Physical Surface("bottom") = Surface In BoundingBox {-0.001, -0.001, -0.001, 1.001, 0.001, 1.001};
Physical Surface("top") = Surface In BoundingBox {-0.001, 0.999, -0.001, 1.001, 1.001, 1.001};
Physical Surface("left") = Surface In BoundingBox {-0.001, -0.001, -0.001, 0.001, 1.001, 1.001};
Physical Surface("front") = Surface In BoundingBox {-0.001, -0.001, -0.001, 1.001, 1.001, 0.001};
"""
HEADER = [
    "backend",
    "closure",
    "solver",
    "unknowns",
    "prepare, s",
    "mean step, s",
    "longest step, s",
    "systems",
    "iterations a system",
    "at most",
    "set-ups",
    "a set-up, s",
    "GiB",
]


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


def solve(backend: str, law: str, solver: str, size: float) -> dict[str, Any]:
    """In this process: sizes, seconds, iterations and GiB."""
    if backend == "skfem":
        from porocore_fem_skfem.macro import SkfemMacroSolver as Solver
    else:
        from porocore_fem_dolfinx.macro import DolfinxMacroSolver as Solver
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cube.geo"
        file.write_text(GEOMETRY, encoding="utf-8")
        began = perf_counter()
        made = Solver(solver=solver, checkpoint_seconds=1e9)
        prepared = made.prepare(problem(file, size))
    ready = perf_counter()

    def tell(report: Any) -> None:
        print(f"t = {report.time:g}: {report.work}", *report.notes, file=sys.stderr, flush=True)

    print(made.remark(prepared), file=sys.stderr, flush=True)
    solution = made.solve(prepared, LAWS[law]()[0], on_step=tell)
    seconds = solution.work["seconds"][1:]
    return work_figures(solution) | {
        "unknowns": prepared.mesh.size,
        "prepare": ready - began,
        "step": float(seconds.mean()),
        "longest": float(seconds.max()),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def row(backend: str, law: str, solver: str, r: dict[str, Any]) -> list[str]:
    """A row of the table."""
    return [
        backend,
        law,
        solver,
        f"{r['unknowns']:,}",
        f"{r['prepare']:.1f}",
        f"{r['step']:.1f}",
        f"{r['longest']:.1f}",
        str(r["systems"]),
        f"{r['iterations'] / r['systems']:.0f}",
        str(r["most_iterations"]),
        str(r["set_ups"]),
        f"{r['set_up_seconds'] / max(r['set_ups'], 1):.1f}",
        f"{r['memory']:.2f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solve", nargs=4, metavar=("BACKEND", "CLOSURE", "SOLVER", "SIZE"))
    parser.add_argument("--backends", nargs="+", choices=BACKENDS, default=BACKENDS)
    parser.add_argument("--closures", nargs="+", choices=tuple(LAWS), default=tuple(LAWS))
    parser.add_argument("--from", dest="least", type=float, default=0, help="fewest unknowns")
    parser.add_argument("--up-to", type=float, default=UP_TO, help="most unknowns, 1e6 for all")
    parser.add_argument("--factors-up-to", type=float, default=FACTORS_UP_TO, help="the same with a factor")
    arguments = parser.parse_args()
    if arguments.solve:
        backend, law, solver, size = arguments.solve
        print(json.dumps(solve(backend, law, solver, float(size))))
        return
    rows = []
    for backend in arguments.backends:
        for law in arguments.closures:
            for solver, most in (("iterative", arguments.up_to), ("direct", arguments.factors_up_to)):
                found = []
                for size, unknowns in SIZES.items():
                    if not arguments.least <= unknowns <= most:
                        continue
                    # A process each, so that the memory is its own.
                    command = [sys.executable, __file__, "--solve", backend, law, solver, str(size)]
                    with one_thread_in_children():
                        done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
                    result = json.loads(done.stdout.splitlines()[-1])
                    found.append(result)
                    rows.append(row(backend, law, solver, result))
                large = [r for r in found if r["unknowns"] >= LARGE]
                if len(large) > 1:
                    logs = np.log([[r["unknowns"], r["step"], r["memory"]] for r in large])
                    time, memory = (np.polyfit(logs[:, 0], logs[:, i], 1)[0] for i in (1, 2))
                    exponents = ["", f"{time:.2f}", *[""] * 6, f"{memory:.2f}"]
                    rows.append([backend, law, solver, f"exponent from {LARGE:,} on", *exponents])
    print(table("A cube of quadratic tetrahedra", HEADER, rows))


if __name__ == "__main__":
    main()
