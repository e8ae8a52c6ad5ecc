"""A script without ``if __name__ == "__main__"`` has workers, however Python starts processes and gets the script."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing import Process
from pathlib import Path

import pytest

from tests.helpers.campaigns import gone, solves

#: Both kinds of workers; the list of all processes that ran the script stands in a file.
SCRIPT = """
import io, multiprocessing, os, sys
with open("begun", "a") as begun:
    print(os.getpid(), file=begun)
if sys.argv[1:]:
    multiprocessing.set_start_method(sys.argv[1])
from pathlib import Path
from tests.helpers.campaigns import sample
from tests.helpers.fake_cell import Fake
from porocore.core.console import Console
from tests.helpers.series_cases import Squares, cases

dataset, summary = sample(Path("data.h5"), Fake(log="log"), workers=2, {where})
os.mkdir("squares")
squares = Squares("squares").run(cases([2, 3]), Console(io.StringIO()), 2)
print(summary.solved == len(dataset), squares, __spec__ and __spec__.name)
"""
ROOT = Path(__file__).parents[2]
WAYS = {
    "spawn": (["plain.py", "spawn"], "None"),
    "forkserver": (["plain.py", "forkserver"], "None"),
    "fork": (["plain.py", "fork"], "None"),
    "module": (["-m", "plain"], "plain"),
    "stdin": (["-"], "None"),
}


def run(folder: Path, words: list[str], **settings: str) -> subprocess.CompletedProcess[str]:
    (folder / "plain.py").write_text(SCRIPT.format(where=settings.get("where", "")), encoding="utf-8")
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with (folder / "plain.py").open() as script:
        return subprocess.run(
            [sys.executable, *words],
            cwd=folder,
            stdin=script,
            env=os.environ | {"PYTHONPATH": paths},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )


@pytest.mark.parametrize(
    "way", [way if way == "stdin" else pytest.param(way, marks=pytest.mark.slow) for way in WAYS]
)
def test_a_plain_script_runs_once(tmp_path: Path, way: str) -> None:
    words, name = WAYS[way]
    done = run(tmp_path, words)
    assert (done.stdout, done.stderr) == (f"True [4.0, 9.0] {name}\n", "")
    assert len((tmp_path / "begun").read_text().split()) == 1
    solvers = {int(process) for process, _, _ in solves(tmp_path / "log")}
    assert len(solvers) == 2
    assert gone(solvers)


@pytest.mark.slow
def test_a_plain_script_runs_once_with_dask(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    done = run(tmp_path, ["plain.py"], where='executor="dask"')
    assert (done.stdout, done.stderr) == ("True [4.0, 9.0] None\n", "")
    assert len((tmp_path / "begun").read_text().split()) == 1


def begin(folder: str) -> None:
    sys.path.insert(0, str(ROOT))
    from porocore.errors import PorocoreError
    from tests.helpers.campaigns import sample

    try:
        sample(Path(folder, "data.h5"), workers=2)
    except PorocoreError as error:
        Path(folder, "refused").write_text(str(error), encoding="utf-8")


def test_a_worker_of_a_pool_is_told_what_to_do(tmp_path: Path) -> None:
    process = Process(target=begin, args=(str(tmp_path),), daemon=True)
    process.start()
    process.join()
    said = (tmp_path / "refused").read_text(encoding="utf-8")
    assert said.startswith("this process is a worker of multiprocessing.Pool and may not start workers")
    assert "sampling.workers: 1" in said
