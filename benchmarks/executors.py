"""Speed-up of two workers over one, with processes and with dask.

The same states of seven inputs with each; the time runs from the first finished state to the last, so that starting
workers and preparing cells, once for each worker, do not count.
"""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from common import table

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.inputs import InputSpace
from porocore.sampling.campaign import CampaignProgress, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.designs import RandomStates
from porocore.study.run.composition import prepare_cell

INPUTS = InputSpace(
    ("H11", "H22", "H33", "H12", "H13", "H23", "p"),
    (-0.04, -0.1, -0.04, -0.02, -0.02, -0.02, -0.02),
    (0.04, 0.02, 0.04, 0.02, 0.02, 0.02, 0.06),
)
CELL = Cell(mesh=MeshSettings(size=0.2, fluid_size=0.2))
STATES = 24


def sampled(path: Path, executor: str, workers: int) -> tuple[str, float]:
    """Digest of the data set, and seconds per state."""
    dataset = Dataset.create(path, inputs=INPUTS, identity=CELL.identity)
    marks: list[tuple[float, int]] = []

    def mark(progress: CampaignProgress) -> None:
        if progress.done:
            marks.append((time.perf_counter(), progress.done))

    with CellPool(prepare_cell, ("skfem", {}, CELL), workers=workers, executor=executor) as pool:
        # Every worker prepares its cell before the first of these states is finished.
        run_campaign(RandomStates(INPUTS, count=workers, seed=1), pool, dataset)
        run_campaign(RandomStates(INPUTS, count=STATES + workers, seed=1), pool, dataset, on_progress=mark)
    (began, before), (ended, after) = marks[0], marks[-1]
    return dataset.digest(), (ended - began) / (after - before)


def main() -> None:
    """Print the table."""
    rows, digests = [], set()
    with TemporaryDirectory(prefix="porocore-executors-") as folder:
        for executor in ("processes", "dask"):
            times = {}
            for workers in (1, 2):
                digest, times[workers] = sampled(Path(folder) / f"{executor}{workers}.h5", executor, workers)
                digests.add((workers, digest))
            rows.append([executor, f"{times[1]:.3f}", f"{times[2]:.3f}", f"{times[1] / times[2]:.2f}"])
    if len(digests) != 2:
        raise SystemExit("the data sets differ")
    header = ["executor", "one worker, s per state", "two workers", "times as fast"]
    print(table(f"(k) Two workers, {STATES} states of seven inputs on a coarse whole cell", header, rows))


if __name__ == "__main__":
    main()
