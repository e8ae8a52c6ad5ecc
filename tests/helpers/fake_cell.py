"""A cell in closed form, for worker processes to import; as a script it samples into a file until it is done.

<∇u¹> is smooth in H22 and p, a region has no solution, and u¹ and W depend a little on the start, so that a
wrong start shows. It can be slow, log each solve, raise, and die.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.campaign import run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.density import DensitySweep
from porocore.sampling.samplers.designs import random_requests
from porocore.states import CellExtrema, CellResponse, CellTangent, MacroState, Status

INPUTS = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))
IDENTITY = "fake-1"
OPTIONS = {"step": {"p": 0.1, "H22": 0.1}, "tolerance": 0.05}


@dataclass(frozen=True)
class Fake:
    """What the cell does."""

    sleep: float = 0.0
    log: str = ""
    #: Below this H22 + p there is no solution.
    edge: float = -0.27
    #: p at which the solver raises an exception, the process dies, or the solve hangs.
    raise_at: float | None = None
    die_at: float | None = None
    hang_at: float | None = None
    nodes: int = 7


def mean_gradient(H22: float, p: float) -> np.ndarray:
    """<∇u¹> in closed form."""
    g = np.zeros((3, 3))
    g[1, 1] = -0.23 * H22 / (1 + 2 * H22) - 0.114 * p * (1 + H22)
    g[0, 0] = g[2, 2] = -0.075 * H22 + 0.02 * H22**2 - 0.114 * p
    return g


class FakeCellSolver(CellSolver):
    """See the module."""

    def __init__(self, fake: Fake) -> None:
        self.fake = fake

    def prepare(self, cell: Any) -> Fake:
        return self.fake

    def conductivity(self, prepared: Any) -> np.ndarray:
        return np.eye(3)

    def solve(
        self,
        prepared: Fake,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        assert len(states) == 1
        H22, p = float(states.grad_u[0, 1, 1]), float(states.p[0])
        if prepared.log:
            with open(prepared.log, "a") as file:
                file.write(f"{os.getpid()} {os.environ.get('OMP_NUM_THREADS')} {p:+.10f} {H22:+.10f}\n")
        if prepared.raise_at is not None and abs(p - prepared.raise_at) < 1e-9:
            raise ArithmeticError("a pivot vanished")
        if prepared.die_at is not None and abs(p - prepared.die_at) < 1e-9:
            os._exit(9)
        if prepared.hang_at is not None and abs(p - prepared.hang_at) < 1e-9:
            time.sleep(600)
        time.sleep(prepared.sleep)
        if H22 + p < prepared.edge:
            return CellSolution(response(np.full((3, 3), np.nan), np.nan, Status.overlap), [None])
        before = start[0] if start else None
        u = np.sin(np.outer(np.arange(1, prepared.nodes + 1), [1, 2, 3]) * (H22 + 1.3 * p))
        u = u / 3 + 1e-3 * before.u if before is not None else u / 3
        field = CellField(states.grad_u[0].copy(), p, "eighth", u)
        g = mean_gradient(H22, p)
        return CellSolution(response(g, H22**2 - p + 1e-9 * u.sum(), Status.converged), [field])


def response(g: np.ndarray, W: float, status: Status) -> CellResponse:
    """One row in which every part is provided."""
    seed = np.arange(81.0).reshape(1, 3, 3, 3, 3) * W
    return CellResponse(
        mean_grad=g[None].copy(),
        status=np.array([int(status)]),
        potential=np.array([W]),
        stress=g[None] + 1,
        fluid_volume=np.array([0.4 + W]),
        tangent=CellTangent(seed, g[None] - 1, seed + 1, g[None] - 2, g[None] - 3, np.array([W - 1])),
        extrema=CellExtrema(g[None] * 2, *(np.array([W * k]) for k in (1, 2, 3, 4, 0, 0.1))),
    )


def make(fake: Fake) -> tuple[FakeCellSolver, Fake]:
    """The factory that a pool takes."""
    solver = FakeCellSolver(fake)
    return solver, solver.prepare(None)


def make_noted(fake: Fake, notes: str) -> tuple[FakeCellSolver, Fake]:
    """The same, and a line for each preparation."""
    with open(notes, "a") as file:
        file.write(f"{os.getpid()}\n")
    return make(fake)


def refuse() -> tuple[FakeCellSolver, Fake]:
    """A factory whose cell cannot be meshed."""
    raise ValueError("no mesh of such a cell")


class Tree(Sampler):
    """``count`` states, random in the box of the inputs, each from the field of another one that was solved before."""

    def __init__(self, inputs: InputSpace, count: int = 200, seed: int = 3) -> None:
        self.requests = [
            Request(request.key, request.x, f"test-{(k - 1) // 2:03d}" if k else None)
            for k, request in enumerate(random_requests(inputs, count, seed))
        ]
        self.known: set[str] = set()
        self.asked: set[str] = set()

    def ask(self) -> list[Request]:
        ready = [
            r for r in self.requests if r.key not in self.asked and (not r.start or r.start in self.known)
        ]
        self.asked |= {request.key for request in ready}
        return ready

    def tell(self, key: str, response: CellResponse) -> None:
        self.known.add(key)

    @property
    def done(self) -> bool:
        return len(self.known) == len(self.requests)

    @property
    def expected(self) -> int:
        return len(self.requests)


if __name__ == "__main__":
    import fake_cell  # workers import this module, and nothing of a script

    path, log, workers, sleep, *more = sys.argv[1:]
    executor, count = more[0] if more else "auto", int(more[1]) if len(more) > 1 else 0
    dataset = Dataset.create_or_open(Path(path), inputs=INPUTS, identity=IDENTITY)
    fake = fake_cell.Fake(sleep=float(sleep), log=log)
    sampler = Tree(INPUTS, count) if count else DensitySweep(INPUTS, **OPTIONS)
    with CellPool(fake_cell.make, (fake,), workers=int(workers), executor=executor) as pool:
        run_campaign(sampler, pool, dataset)
