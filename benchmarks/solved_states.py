"""Solved states for the surrogate benchmarks, kept in a folder so that a second run solves nothing."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from porocore.cell.cell import Cell
from porocore.core.inputs import InputSpace
from porocore.interfaces.sampler import Request, Sampler
from porocore.interfaces.surrogate import TrainingSet
from porocore.sampling.campaign import run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.states import Array, CellResponse, IntArray, MacroState
from porocore.study.run.composition import prepare_cell

#: Second-order elements on an eighth of the cell for diagonal states, on the whole cell for others; r = 0.25, ν = 0.35.
CELL = Cell()


class Given(Sampler):
    """States listed beforehand, each solved from the undeformed cell."""

    def __init__(self, inputs: InputSpace, points: Array) -> None:
        self.requests = [Request(f"{i:04d}", tuple(map(float, x))) for i, x in enumerate(points)]
        self.asked, self.open = False, {request.key for request in self.requests}

    def ask(self) -> list[Request]:
        asked, self.asked = self.asked, True
        return [] if asked else self.requests

    def tell(self, key: str, response: CellResponse) -> None:
        self.open.remove(key)

    @property
    def done(self) -> bool:
        return not self.open

    @property
    def expected(self) -> int:
        return len(self.requests)


class Library:
    """A folder of solved states, one file for each list of states.

    Attributes
    ----------
    inputs
        What moves.
    cell
        What is solved.
    reference
        Response of the undeformed cell.
    """

    def __init__(self, folder: Path, inputs: InputSpace, cell: Cell = CELL) -> None:
        self.folder, self.inputs, self.cell = folder, inputs, cell
        folder.mkdir(parents=True, exist_ok=True)
        solver, prepared = prepare_cell("skfem", {}, cell)
        self.reference = solver.solve(prepared, MacroState.zeros(1)).response

    def solve(self, name: str, sampler: Sampler) -> tuple[MacroState, CellResponse]:
        """All states that ``sampler`` asks for and that are stable, in the order of their keys."""
        states, responses, _ = self.numbered(name, sampler)
        return states, responses

    def numbered(self, name: str, sampler: Sampler) -> tuple[MacroState, CellResponse, IntArray]:
        """The same, and the place of each among all that were asked for."""
        dataset = Dataset.create_or_open(
            self.folder / f"{name}.h5", inputs=self.inputs, identity=self.cell.identity
        )
        workers = len(os.sched_getaffinity(0))
        with CellPool(prepare_cell, ("skfem", {}, self.cell), workers=workers, fields=True) as pool:
            summary = run_campaign(sampler, pool, dataset)
        counts = ", ".join(f"{n} {status.name}" for status, n in summary.counts.items())
        print(f"{name}: {counts}; {summary.solved} solved in {summary.seconds:.0f} s", file=sys.stderr)
        responses = dataset.responses()
        stable = np.flatnonzero(responses.stable)
        return dataset.states()[stable], responses[stable], stable

    def training_set(self, states: MacroState, responses: CellResponse) -> TrainingSet:
        """What a surrogate learns from."""
        return TrainingSet(
            states, responses, self.inputs, self.reference, self.cell.identity, {}, self.cell.point_group
        )


def farthest_points(inputs: InputSpace, count: int) -> Array:
    """The corners of the box, then always the point farthest from all before; its beginning serves smaller counts."""
    d = len(inputs)
    corners = np.array(np.meshgrid(*[(0.0, 1.0)] * d, indexing="ij")).reshape(d, -1).T
    cloud = qmc.Sobol(d, seed=0).random(4096)
    points = list(corners)
    distance = np.linalg.norm(cloud[:, None] - corners, axis=2).min(axis=1)
    while len(points) < count:
        points.append(cloud[np.argmax(distance)])
        distance = np.minimum(distance, np.linalg.norm(cloud - points[-1], axis=1))
    return _scaled(inputs, np.array(points[:count]))


def sobol_points(inputs: InputSpace, count: int, seed: int) -> Array:
    """The first points of a scrambled Sobol sequence."""
    power = int(np.ceil(np.log2(count)))
    return _scaled(inputs, qmc.Sobol(len(inputs), seed=seed).random_base2(power)[:count])


def random_points(inputs: InputSpace, count: int, seed: int) -> Array:
    """Uniform in the box."""
    return _scaled(inputs, np.random.default_rng(seed).random((count, len(inputs))))


def _scaled(inputs: InputSpace, unit: Array) -> Array:
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    return low + (high - low) * unit


def worst_share(error: Array, truth: Array) -> float:
    """Largest root mean square of a component's error over the largest range of a component."""
    error, truth = error.reshape(len(error), -1), truth.reshape(len(truth), -1)
    return float(np.sqrt((error**2).mean(axis=0)).max() / np.ptp(truth, axis=0).max())
