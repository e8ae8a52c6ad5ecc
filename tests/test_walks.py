"""The files through which a state, a number of the configuration and a load pass, as docs/architecture.md lists them.

A small study is run under a profiler, which sees every file that is handed one of them as an argument.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import porocore

ROOT = Path(__file__).parents[1]
OURS = (f"{ROOT}/porocore/", f"{ROOT}/plugins/")
HELD = {f"{axis}-": {"displacement": [0 if axis == other else None for other in "xyz"]} for axis in "xyz"}
SIDES = {f"{axis}+": {"displacement": [0 if axis == other else None for other in "xyz"]} for axis in "xz"}
STUDY = {
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.25},
        "mesh": {"size": 0.5, "fluid_size": 0.4},
    },
    "sampling": {
        "workers": 1,
        "sampler": "sobol",
        "options": {"count": 8},
        "inputs": {"H22": {"range": [-0.06, 0.02]}, "p": {"range": [-0.01, 0.03]}},
        "test": {"count": 1},
    },
    "surrogate": {"backend": "polynomial"},
    "macro": {
        "loads": [-0.02],
        "body": {"elements": [1, 2, 1]},
        "boundary": HELD | SIDES | {"y+": {"traction": [0, 1, 0], "pressure": 0}},
        "time": {"end": 2.0, "step": 1.0, "ramp_increments": 1, "ramp_step": 1.0, "profiles": []},
    },
}
#: Types by which each thing that walks is known.
WALKERS = {
    "a state": {"MacroState", "CellResponse", "SolvedState", "TrainingSet", "MacroResponse", "Request"},
    "`cell.geometry.radius`": {"OrthogonalChannels"},
    "a traction": {"Boundary", "Collector", "SurfaceConditions", "BoundaryData", "Loads"},
}
#: Files at most.
MOST = {"a state": 30, "`cell.geometry.radius`": 5, "a traction": 9}


@contextmanager
def watched(walks: dict[str, dict[str, None]]) -> Iterator[None]:
    """Add each file of ours that is called with one of the walkers to its walk."""

    def watch(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(OURS):
            return
        for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]:
            given = frame.f_locals.get(name)
            if isinstance(given, dict):
                given = next(iter(given.values()), None)
            for walker, types in WALKERS.items():
                if type(given).__name__ in types:
                    walks[walker].setdefault(str(Path(code.co_filename).relative_to(ROOT)))

    before = sys.getprofile()
    sys.setprofile(watch)
    try:
        yield
    finally:
        sys.setprofile(before)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, None]]:
    found: dict[str, dict[str, None]] = {walker: {} for walker in WALKERS}
    study = porocore.Study(STUDY, out=tmp_path_factory.mktemp("walk") / "run", progress=False, store=False)
    with watched({walker: found[walker] if walker != "a state" else {} for walker in found}):
        study.law("linear")  # the undeformed cell, which is no state that was sampled
    with watched(found):
        study.sample()
        study.train()
        study.solve(("surrogate",))
    return found


def listed(walker: str) -> list[str]:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8").split("## Three walks\n")[1]
    part = text.split(f"**The walk of {walker}**")[1].split("**The walk of")[0].split("\n## ")[0]
    return re.findall(r"`([\w/]+\.py)`", part)


@pytest.mark.parametrize("walker", WALKERS)
def test_a_walk_is_the_one_that_the_page_lists(walker: str, walks: dict[str, dict[str, None]]) -> None:
    assert sorted(listed(walker)) == sorted(walks[walker]), "\n".join(walks[walker])
    assert len(walks[walker]) <= MOST[walker]
