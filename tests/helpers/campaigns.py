"""Sampling of the made-up cell, and which processes work on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from porocore.interfaces.sampler import Sampler
from porocore.sampling.campaign import CampaignProgress, CampaignSummary, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.density import DensitySweep
from tests.helpers.fake_cell import IDENTITY, INPUTS, OPTIONS, Fake, make

SCRIPT = str(Path(__file__).with_name("fake_cell.py"))


def sample(
    path: Path,
    fake: Fake | None = None,
    *,
    workers: int = 1,
    sampler: Sampler | None = None,
    on_progress: Callable[[CampaignProgress], None] | None = None,
    **where: Any,
) -> tuple[Dataset, CampaignSummary]:
    dataset = Dataset.create_or_open(path, inputs=INPUTS, identity=IDENTITY)
    with CellPool(make, (fake or Fake(),), workers=workers, **where) as pool:
        sampler = sampler or DensitySweep(INPUTS, **OPTIONS)
        return dataset, run_campaign(sampler, pool, dataset, on_progress=on_progress)


def solves(log: Path) -> list[tuple[str, str, str]]:
    """(process, threads, state) of each solve that began."""
    if not log.exists():
        return []
    return [tuple(line.split(maxsplit=2)) for line in log.read_text().splitlines()]  # type: ignore[misc]


def state_text(dataset: Dataset, key: str) -> str:
    return " ".join(f"{value:+.10f}" for value in dataset.inputs_of(key))


def gone(pids: set[int], within: float = 10.0) -> bool:
    """Whether all these processes end in time (a zombie of another parent has ended too)."""

    def alive(pid: int) -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
        except OSError:
            return False

    end = time.monotonic() + within
    while any(map(alive, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return not any(map(alive, pids))


def session_gone(session: int, within: float = 10.0) -> bool:
    """Whether every process of this session ends in time, also one that was starting and has logged nothing yet."""

    def members() -> set[int]:
        found = set()
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, _, of = stat.read_text().rsplit(")", 1)[1].split()[:4]
            except OSError:
                continue
            # An orphan that has ended stays in the table until the first process of the machine asks for it.
            if int(of) == session and state != "Z":
                found.add(int(stat.parent.name))
        return found

    end = time.monotonic() + within
    return gone(members(), within) and gone(members(), max(0.0, end - time.monotonic()))
