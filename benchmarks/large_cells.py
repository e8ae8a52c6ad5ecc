"""(p) Large cells: the solid with ten derivatives and K, by multigrid and by factors, one process for each of them.

Images of one sample, smoothed noise of which half is pores, scanned with ever smaller voxels, at three voxels a
tetrahedron; and one cell, a gyroid, with elements of the same sizes. Different samples of one size take up to twice as
many iterations, so growth is measured on one. Seconds are those of the processor, and memory is the largest
of the process. ``large_cells.py 32 48`` measures these sizes only; ``large_cells.py case 64`` measures one whole task:
K, M, Q and a state of 10 % compression of an image, with its derivatives.
"""

from __future__ import annotations

import itertools
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
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.parallel.memory import freed_memory_kept, one_thread_in_children
from porocore.states import CellResponse, Status
from porocore_fem_skfem.cell_solver import SkfemCellSolver

#: Voxels along an edge: 45,000 to 1,100,000 unknowns of the solid.
IMAGES = (32, 48, 64, 80, 94)
VOXELS = 3
#: Seed of the sample, waves along an edge that it consists of, and width of the smoothing as a share of the edge.
SAMPLE, MODES, SMOOTHING = 0, 16, 1 / 8
#: Largest image that is also solved with factors.
LARGEST_WITH_FACTORS = 64
#: Largest difference of a response from that with a factor, and largest exponent of time above so many unknowns.
AGREEMENT, EXPONENT, ABOVE = 1e-8, 1.2, 100_000
#: Sizes are known only after the solve: memory is kept for cells of every size.
ANY_SIZE = 10**9
COMPRESSION = -0.02 * np.diag([1.0, 0.0, 0.0])
TASK_COMPRESSION = -0.1 * np.diag([1.0, 0.0, 0.0])


def make_cell(folder: Path, kind: str, voxels: int) -> Cell:
    size = VOXELS / voxels
    geometry: TriplyPeriodic | Voxels
    if kind == "image":
        np.save(folder / "image.npy", scan(voxels))
        geometry = Voxels(kind="voxels", path=str(folder / "image.npy"), pore=1, repeat="periodic")
    else:
        geometry = TriplyPeriodic.model_validate({"kind": "tpms", "surface": kind, "void_fraction": 0.5})
    return Cell(geometry=geometry, mesh=MeshSettings(size=size, fluid_size=size))


def scan(voxels: int) -> np.ndarray:
    """Return the image of the sample: 1 in the pores; the noise is smoothed over an eighth of the edge."""
    waves = np.fft.fftfreq(MODES, 1 / MODES)
    damping = np.exp(-((2 * np.pi * waves * SMOOTHING) ** 2) / 2)
    spectrum = np.fft.fftn(np.random.default_rng(SAMPLE).normal(size=(MODES,) * 3))
    spectrum *= damping[:, None, None] * damping[:, None] * damping
    fine = np.zeros((voxels,) * 3, dtype=complex)
    places = waves.astype(int) % voxels
    fine[np.ix_(places, places, places)] = spectrum
    values = np.fft.ifftn(fine).real
    return np.asarray(values < np.median(values), dtype=np.uint8)


def values_of(response: CellResponse) -> list[float]:
    """Return averages and derivatives of a response as one list."""
    assert response.tangent is not None
    fields = [response.mean_grad, response.stress, response.fluid_volume, *vars(response.tangent).values()]
    return [float(x) for field in fields if field is not None for x in np.ravel(field)]


def measure(what: str, kind: str, solver: str, voxels: int) -> dict[str, object]:
    """Return unknowns, values, and seconds and bytes of a first and a further state with derivatives, or of K.

    With multigrid everything is solved once before it is timed, and the process keeps the memory. A virtual machine
    takes memory from its host when a process touches it first, which costs up to 2.3 s a gigabyte and is no work of the
    solver.
    """
    with TemporaryDirectory() as folder, freed_memory_kept(ANY_SIZE):
        cell = make_cell(Path(folder), kind, voxels)
        cell.make_mesh("solid" if what == "state" else "fluid", "whole")
        if solver == "amg":
            solve_all(what, cell, SkfemCellSolver(solver=solver))
        backend = SkfemCellSolver(solver=solver)
        seconds, values, words = solve_all(what, cell, backend)
    unknowns = int(words.split(": ")[1].split()[0].replace(",", ""))
    return {
        "unknowns": unknowns,
        "first": seconds[0],
        "seconds": seconds[-1],
        "values": values,
        "bytes": peak(),
    }


def solve_all(what: str, cell: Cell, backend: SkfemCellSolver) -> tuple[list[float], list[float], str]:
    """Return the seconds of each solve, the first with its preparation, values of the last, words on the solver."""
    prepared, clock = backend.prepare(cell), [time.process_time()]
    for factor in (1.0, 0.9) if what == "state" else (1.0,):
        if what == "state":
            response = backend.solve_one(prepared, factor * COMPRESSION)
            assert Status(int(response.status[0])).has_values, "a state has no values"
            values = values_of(response)
        else:
            values = list(np.ravel(backend.conductivity(prepared)))
        clock.append(time.process_time())
    return list(np.diff(clock)), values, backend.remark(prepared)


def whole_task(voxels: int) -> None:
    """Print time and memory of K, the cell at rest and a compressed state, with derivatives, and the mesh."""
    began = time.perf_counter()
    with TemporaryDirectory() as folder:
        cell, backend = make_cell(Path(folder), "image", voxels), SkfemCellSolver()
        prepared = backend.prepare(cell)
        steps = {
            "meshes": lambda: [cell.make_mesh(phase, "whole") for phase in ("solid", "fluid")],
            "K": lambda: backend.conductivity(prepared),
            "M, Q": lambda: backend.solve_one(prepared, np.zeros((3, 3))),
            "10 % compression": lambda: backend.solve_one(prepared, TASK_COMPRESSION),
        }
        rows = []
        for name, step in steps.items():
            start = time.perf_counter()
            found = step()
            status = Status(int(found.status[0])).name if isinstance(found, CellResponse) else ""
            rows.append([name, f"{time.perf_counter() - start:.0f}", status, f"{peak() / 2**30:.1f}"])
    rows.append(["all", f"{time.perf_counter() - began:.0f}", "", f"{peak() / 2**30:.1f}"])
    print(table(f"An image of {voxels}³ voxels", ["", "s", "status", "GiB so far"], rows))
    print(backend.remark(prepared))


def peak() -> float:
    """Return the largest memory of this process so far [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(images: tuple[int, ...] = IMAGES) -> bool:
    rows, good = [], True
    for what, kind in itertools.product(("state", "K"), ("image", "gyroid")):
        points: dict[int, dict[str, float]] = {}
        for voxels in images:
            exact = None
            for solver in ("pardiso", "amg"):
                if solver == "pardiso" and voxels > LARGEST_WITH_FACTORS:
                    continue
                command = [sys.executable, __file__, what, kind, solver, str(voxels)]
                with one_thread_in_children():
                    done = subprocess.run(command, check=True, capture_output=True, text=True)
                found = json.loads(done.stdout)
                values = np.array(found["values"])
                error = None if exact is None else float(np.abs(values - exact).max() / np.abs(exact).max())
                exact = values if solver == "pardiso" else exact
                good &= error is None or error < AGREEMENT
                rows.append([
                    what, kind, str(voxels), f"{found['unknowns']:,}",
                    "factors" if solver == "pardiso" else "multigrid", f"{found['first']:.1f}",
                    f"{found['seconds']:.1f}", f"{found['bytes'] / 2**30:.2f}",
                    "" if error is None else f"{error:.0e}",
                ])  # fmt: skip
                print("|", " | ".join(rows[-1]), "|", file=sys.stderr, flush=True)
                if solver == "amg" and found["unknowns"] > ABOVE:
                    points[found["unknowns"]] = found
        if len(points) > 1:
            few, many = min(points), max(points)
            exponents = [
                np.log(points[many][time] / points[few][time]) / np.log(many / few)
                for time in ("first", "seconds")
            ]
            good &= exponents[0] < EXPONENT
            rows.append(
                [what, kind, "", "exponent", "multigrid", *(f"{one:.2f}" for one in exponents), "", ""]
            )
    header = ["", "cell", "voxels", "unknowns", "solver", "first, s", "another, s", "GiB", "difference"]
    print(table("(p) Large cells", header, rows))
    return good


if __name__ == "__main__":
    if sys.argv[1:2] == ["case"]:
        whole_task(int(sys.argv[2]))
    elif len(sys.argv) == 5 and sys.argv[1] in ("state", "K"):
        print(json.dumps(measure(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))))
    else:
        sys.exit(0 if main(tuple(map(int, sys.argv[1:])) or IMAGES) else 1)
