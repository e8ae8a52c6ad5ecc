"""A study small enough to run whole in seconds, and how to run, watch, stop and compare it from outside."""

from __future__ import annotations

import atexit
import copy
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml

from porocore.errors import DataError
from porocore.sampling.datasets.dataset import Dataset, parts_folder
from tests.e2e.warm import WarmCommand

POROCORE = Path(sys.executable).with_name("porocore")
#: The same number of threads everywhere, so that results can be compared bit by bit.
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if name not in ("COLUMNS", "FORCE_COLOR")},
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
}
HEIGHT, LOADS = 7.5, (-0.04, -1e-4)
HELD_OUT = 7
#: For tests that need not repeat all of the study.
ONE_LOAD = {"macro.loads": [LOADS[0]]}
_SIDE = {"displacement": [0, None, 0]}
STUDY: dict[str, Any] = {
    "title": "A small study",
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.25, "axes": "xyz"},
        "material": {"kind": "neo-hookean", "poisson_ratio": 0.35},
        "viscosity": 1e-3,
        "mesh": {"size": 0.2, "fluid_size": 0.14},
    },
    "fem": {"backend": "skfem"},
    "sampling": {
        "inputs": {
            "p": {"range": [-0.02, 0.06], "step": 0.04},
            "H22": {"range": [-0.1, 0.02], "step": 0.04},
        },
        "tolerance": 0.05,
        "workers": 1,
        "test": {"count": HELD_OUT, "seed": 7},
    },
    "surrogate": {"backend": "torch", "seed": 7, "options": {"epochs": 400}},
    "closure": "mean-gradient",
    "macro": {
        "body": {"size": [0.1, HEIGHT, 0.1], "elements": [1, 8, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), _SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": list(LOADS),
        "time": {"end": 240, "step": 6, "ramp_increments": 10, "ramp_step": 0.075, "profiles": [1, 10, 40]},
    },
}
#: The same study on a cell and with a network that take a second, for what does not depend on their numbers.
QUICK = {
    "cell.mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    "sampling.tolerance": 0.5,
    "sampling.test.count": 2,
    "surrogate.options": {"epochs": 20},
    "macro.body.elements": [1, 2, 1],
    "macro.time": {"end": 60, "step": 20, "ramp_increments": 4, "ramp_step": 0.2, "profiles": []},
    "macro.loads": [LOADS[1]],
}
PLAIN = (str(POROCORE),)
#: Command lines whose training, or whose macro solves, write a checkpoint very often.
EAGER_TRAINING = (
    sys.executable,
    "-c",
    "import porocore.surrogates.network.training as adam; adam.CHECKPOINT_INTERVAL = 0.05\n"
    "from porocore.cli import main; main()",
)
EAGER_SOLVING = (
    sys.executable,
    "-c",
    "from porocore_fem_skfem.macro import SkfemMacroSolver\n"
    "SkfemMacroSolver.__init__.__kwdefaults__['checkpoint_seconds'] = 0.0\n"
    "from porocore.cli import main; main()",
)
#: The same with so long a pause after each checkpoint that a signal finds the solve at work.
PAUSING_SOLVING = (
    *EAGER_SOLVING[:2],
    "import time\n"
    "from porocore.macro.integration.checkpoint import CheckpointFile\n"
    "save = CheckpointFile.save_if_due\n"
    "CheckpointFile.save_if_due = lambda *args, **options: (save(*args, **options), time.sleep(0.05))[0]\n"
    + EAGER_SOLVING[2],
)


def write_study(path: Path, changes: dict[str, Any] | None = None, *, base: dict[str, Any] = STUDY) -> Path:
    """The study, or another ``base``, with ``changes`` by dotted key; None removes a key."""
    study = copy.deepcopy(base)
    for key, value in (changes or {}).items():
        *above, last = key.split(".")
        section = study
        for part in above:
            section = section.setdefault(part, {})
        if value is None:
            del section[last]
        else:
            section[last] = value
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return path


def porocore(
    *words: object, cwd: Path | None = None, timeout: float = 300, drawn: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run the command to its end; its figures are empty unless ``drawn``, which takes longer than all the rest."""
    return _warm().run([str(word) for word in words], cwd, timeout, drawn)


@cache
def _warm() -> WarmCommand:
    warm = WarmCommand(ENVIRONMENT)
    atexit.register(warm.close)
    return warm


def succeeded(done: subprocess.CompletedProcess[str]) -> str:
    """Standard output of a command that did what it was asked."""
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def message(done: subprocess.CompletedProcess[str]) -> str:
    """The one message of a command that refused: status 2, nothing on standard output, no traceback."""
    assert done.returncode == 2, f"status {done.returncode}: {done.stderr}"
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    notes, found, text = done.stderr.rpartition("error: ")
    assert found, done.stderr
    assert "error: " not in notes
    return text.strip()


def fingerprint(folder: Path) -> dict[str, str]:
    """SHA-256 of every file but the lock and the records of times, which are no results."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in (".lock", "timings.json", "finished.json")
    }


def contents(path: Path) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    """Type, shape and bytes of every array in an HDF5 file but the work that it took, and its attributes."""
    found = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("work/"):
            value = np.asarray(item[()])
            found[name] = (str(value.dtype), value.shape, repr(value[()]).encode())
            if value.dtype != object:
                found[name] = (str(value.dtype), value.shape, value.tobytes())

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        found |= {f"@{name}": ("", (), repr(value).encode()) for name, value in file.attrs.items()}
    return found


def figures(folder: Path) -> dict[str, Any]:
    """metrics.json without the wall times, and over how many runs they are."""
    metrics: dict[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    assert metrics.pop("stages").keys() == metrics.pop("stage_runs").keys()
    assert metrics["sampling"].pop("solve_seconds_mean") > 0
    assert len(metrics.pop("linear_systems")) == len(metrics["macro"]) * 2
    return metrics


def assert_same_results(folder: Path, finished: Path) -> None:
    """The numbers of the finished run, bit by bit, in datasets, surrogate, losses and solutions."""
    for name in ("samples.h5", "test.h5"):
        assert Dataset.open(folder / name).digest() == Dataset.open(finished / name).digest()
    assert contents(folder / "surrogate.h5") == contents(finished / "surrogate.h5")
    rows, expected = ({*(run / "training.csv").read_text().splitlines()} for run in (folder, finished))
    assert rows == expected
    solutions = sorted(path.name for path in (folder / "solutions").iterdir())
    assert solutions == ["linear_load-0.04.h5", "mean-gradient_load-0.04.h5"]
    for name in solutions:
        assert contents(folder / "solutions" / name) == contents(finished / "solutions" / name)


def assert_tidy(folder: Path) -> None:
    """Nothing temporary is left."""
    assert not [path for path in folder.rglob("*") if path.name.endswith((".part", ".parts"))]
    assert not list((folder / "checkpoints").iterdir())


def seconds(folder: Path) -> dict[str, float]:
    """The wall time of each finished cell solve: two solves of one state never take exactly the same."""
    found: dict[str, float] = {}
    for name in ("samples.h5", "test.h5"):
        if (folder / name).exists():
            dataset = Dataset.open(folder / name)
            found |= {f"{name}: {key}": t for key, t in zip(dataset.keys, dataset.seconds(), strict=True)}
    return found


def parts(folder: Path, name: str) -> int:
    """How many finished solves lie beside a dataset."""
    return len(list(parts_folder(folder / name).glob("*.h5")))


class Running:
    """The command at work, in a session of its own and with a mark by which every process of it is known."""

    def __init__(self, scratch: Path, *words: object, program: tuple[str, ...] = PLAIN) -> None:
        self.mark = f"POROCORE_TEST_MARK={uuid.uuid4().hex}"
        name, value = self.mark.split("=")
        scratch.mkdir(parents=True, exist_ok=True)
        self.out, self.err = (scratch / f"{value}.{stream}" for stream in ("out", "err"))
        with self.out.open("w") as out, self.err.open("w") as err:
            self.process = subprocess.Popen(
                [*program, *map(str, words)],
                stdout=out,
                stderr=err,
                env=ENVIRONMENT | {name: value},
                start_new_session=True,
            )

    def until(self, condition: Callable[[], bool], timeout: float = 240) -> None:
        """Wait; the command must still be at work when ``condition`` comes true."""
        deadline = time.monotonic() + timeout
        while not self._met(condition):
            if self.process.poll() is not None:
                pytest.fail(f"ended too early with status {self.process.returncode}: {self.err.read_text()}")
            if time.monotonic() > deadline:
                pytest.fail(f"the moment never came: {self.err.read_text()}")
            time.sleep(0.01)

    @staticmethod
    def _met(condition: Callable[[], bool]) -> bool:
        try:
            return condition()
        except (OSError, KeyError, DataError):  # a file that is being replaced or removed
            return False

    def stop(self, number: int, *, only_main: bool = False) -> int:
        """Send a signal to all processes, or only to the first, and wait; returns the exit status."""
        if only_main:
            os.kill(self.process.pid, number)
        else:
            os.killpg(self.process.pid, number)
        return self.process.wait(timeout=60)

    def processes(self) -> list[int]:
        """Every living process that this command has started, directly or not."""
        found = []
        for entry in Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and self.mark.encode() in (entry / "environ").read_bytes().split(
                    b"\0"
                ):
                    found.append(int(entry.name))
            except OSError:
                continue
        return found

    def assert_gone(self, within: float = 15) -> None:
        """No process is left, at the latest after ``within`` seconds."""
        deadline = time.monotonic() + within
        while left := self.processes():
            if time.monotonic() > deadline:
                pytest.fail(f"{len(left)} processes are left")
            time.sleep(0.05)

    def kill_all(self) -> None:
        """End whatever is left."""
        for pid in self.processes():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait(timeout=60)
