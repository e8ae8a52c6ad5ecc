"""The distributions that are tested: those of a folder that is given, or built here."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
from tests.e2e.study import write_study  # noqa: E402
from tests.release.environments import CONSTRAINTS, Environment  # noqa: E402
from tools.distributions import build  # noqa: E402

#: A study of seconds.
COARSE = {
    "cell.mesh": {"size": 0.5, "fluid_size": 0.3},
    "sampling.test.count": 2,
    "macro.loads": [-0.04],
    "macro.body.elements": [1, 4, 1],
    "macro.time": {"end": 24, "step": 6, "ramp_increments": 2, "ramp_step": 0.5, "profiles": [1, 10]},
}


@pytest.fixture(scope="session")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the sdists and wheels.

    With the variable ``POROCORE_DIST``, as ``make dist`` sets it, the files there, so that what is uploaded is what was
    tested.
    """
    given = os.environ.get("POROCORE_DIST")
    if given:
        return ROOT / given
    folder = tmp_path_factory.mktemp("dist")
    build(folder, isolated=False)
    return folder


@pytest.fixture(scope="session")
def usual(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Environment]:
    """An environment that was empty, and in which a user has installed what a study usually takes."""
    environment = Environment(tmp_path_factory.mktemp("usual") / "environment")
    environment.install("--find-links", dist, "-c", CONSTRAINTS, "porocore[skfem,torch]")
    yield environment
    environment.remove()


@pytest.fixture(scope="session")
def write_coarse() -> Callable[[Path], Path]:
    """Writes the study of seconds into a file."""
    return lambda path: write_study(path, COARSE)


@pytest.fixture(scope="session")
def finished(
    usual: Environment, write_coarse: Callable[[Path], Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A run folder that was made there."""
    folder = tmp_path_factory.mktemp("finished")
    usual.porocore("run", write_coarse(folder / "study.yaml"), "--out", "run", cwd=folder)
    return folder / "run"
