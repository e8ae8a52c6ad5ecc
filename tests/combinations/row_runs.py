"""One row of the table: refused by `check` with a sentence, or run on both backends with the same answer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from porocore.errors import ConfigurationError
from porocore.interfaces.solution import History, MacroSolution, Profile
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import CellResponse
from porocore.study.api.study import Study
from porocore.study.run.composition import prepare_cell
from tests.combinations.levels import study

#: Of the largest value of each field.
SAME = 1e-7
#: States of a network's data that are solved by the other backend, too.
CHECKED_STATES = 3
POROCORE = Path(sys.executable).with_name("porocore")


@dataclass
class Outcome:
    """What a row came to.

    Attributes
    ----------
    refused
        The sentence of `check`, or "".
    cells, bodies, processes
        Largest difference, as a share of the largest value: of responses of the cell by the two backends; of the
        macroscopic solution by the two; of dolfinx on two processes from dolfinx on one. NaN where it was not compared.
    seconds
        Wall time.
    """

    refused: str = ""
    cells: float = np.nan
    bodies: float = np.nan
    processes: float = np.nan
    seconds: float = 0.0


def run_row(row: dict[str, str], folder: Path, *, processes: bool = True) -> Outcome:
    """Run a row in an empty folder.

    A polynomial is sampled, fitted and solved with each backend by itself. A network is trained once, on the data of
    scikit-fem, since training amplifies what differs in the last digits of its data.
    """
    begun, outcome = time.perf_counter(), Outcome()
    first = _study(row, folder, "skfem")
    try:
        first.check()
    except ConfigurationError as error:
        outcome.refused = str(error)
        outcome.seconds = time.perf_counter() - begun
        return outcome
    first.solve()
    one = _copy(first.path, folder / "one")
    _solve(one, 1)
    if row["surrogate"] == "polynomial":
        second = _study(row, folder, "dolfinx")
        second.solve()
        outcome.cells = _datasets_differ(first.path, second.path)
        outcome.bodies = _solutions_differ(first.path, second.path)
    else:
        outcome.cells = _cells_differ(first)
        outcome.bodies = _solutions_differ(first.path, one)
    if processes:
        two = _copy(first.path, folder / "two")
        _solve(two, 2)
        outcome.processes = _solutions_differ(one, two)
    outcome.seconds = time.perf_counter() - begun
    return outcome


def _study(row: dict[str, str], folder: Path, fem: str) -> Study:
    path = folder / f"{fem}.yaml"
    path.write_text(yaml.safe_dump(study(row, folder, fem), sort_keys=False), encoding="utf-8")
    return Study(path, out=folder / fem, progress=False)


def _copy(run: Path, to: Path) -> Path:
    """Copy a run without its solutions."""
    return Path(shutil.copytree(run, to, ignore=shutil.ignore_patterns("solutions", "checkpoints")))


def _solve(run: Path, processes: int) -> None:
    """Solve the macroscopic problem of a run with dolfinx."""
    words = [str(POROCORE), "solve", str(run), "--fem", "dolfinx"]
    if processes > 1:
        words = ["mpirun", "--oversubscribe", "-n", str(processes), *words]
    allowed = dict.fromkeys(("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"), "1")
    allowed |= {"OMPI_MCA_mpi_yield_when_idle": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(words, env=os.environ | allowed, capture_output=True, text=True, check=False)
    if done.returncode:
        raise AssertionError(f"{' '.join(words)}: status {done.returncode}\n{done.stderr[-2000:]}")


def _difference(found: Any, expected: Any) -> float:
    """Return the largest difference as a share of the largest value; NaN on one side alone is infinite."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    if found.shape != expected.shape or (np.isnan(found) != np.isnan(expected)).any():
        return np.inf
    there = ~np.isnan(expected)
    scale = np.abs(expected[there]).max(initial=0.0)
    gap = np.abs(found[there] - expected[there]).max(initial=0.0)
    return float(gap / max(scale, 1e-6))


def _responses_differ(found: Any, expected: Any) -> float:
    names = [
        field.name for field in fields(CellResponse) if field.name not in ("extrema", "tangent", "doubt")
    ]
    pairs = [(getattr(found, name), getattr(expected, name)) for name in names]
    return max(_difference(a, b) for a, b in pairs if b is not None)


def _datasets_differ(one: Path, other: Path) -> float:
    """Return the difference of the responses in two data sets, which hold the same states in the same order."""
    a, b = (Dataset.open(run / "samples.h5") for run in (one, other))
    if a.keys != b.keys:
        return np.inf
    return _responses_differ(a.responses(), b.responses())


def _cells_differ(done: Study) -> float:
    """Return the difference of some sampled states from what dolfinx makes of them."""
    config = done.config
    data = Dataset.open(done.path / "samples.h5")
    places = np.linspace(0, len(data.keys) - 1, CHECKED_STATES).astype(int)
    solver, prepared = prepare_cell("dolfinx", {}, config.cell, config.conductivity)
    found = solver.solve(prepared, data.states()[places]).response
    return _responses_differ(found, data.responses()[places])


def _solutions_differ(one: Path, other: Path) -> float:
    """Return the difference of all histories and profiles of two runs."""
    names = sorted(path.name for path in (one / "solutions").iterdir())
    assert names
    assert names == sorted(path.name for path in (other / "solutions").iterdir())
    largest = 0.0
    for name in names:
        a, b = (MacroSolution.load_file(run / "solutions" / name) for run in (one, other))
        for kind, mine, theirs in [
            (History, a.history, b.history),
            *((Profile, p, q) for p, q in zip(a.profiles, b.profiles, strict=True)),
        ]:
            for field in fields(kind):
                # Iterations are no result, and what is spread about a uniform stress is round-off.
                if field.name not in ("iterations", "stress_spread"):
                    largest = max(
                        largest, _difference(getattr(mine, field.name), getattr(theirs, field.name))
                    )
        for values in ("probes", "reactions", "inflow"):
            mine, theirs = getattr(a, values), getattr(b, values)
            assert mine.keys() == theirs.keys()
            largest = max([largest, *(_difference(mine[key], theirs[key]) for key in theirs)])
    return largest
