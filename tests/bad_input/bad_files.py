"""Files for the rows: of a finished run, which is made once, whole or altered; and what is no ordinary file."""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py

from tests.bad_input.bad_row import CONFIG, study

#: The names of a finished run's files that are read back.
SAMPLES, HELD_OUT, SURROGATE = "samples.h5", "test.h5", "surrogate.h5"
SOLUTION = "solutions/mean-gradient_load-0.04.h5"

#: All in one process, which imports everything once.
STEPS = f"""
import sys
from porocore.cli import main
for words in (["sample", {CONFIG!r}, "--out", "run"], ["train", "run"], ["solve", "run"]):
    sys.argv = ["porocore", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""

Edit = Callable[[h5py.File], object]


@cache
def finished_run() -> Path:
    """The folder of a run that was sampled, trained and solved, but has no report. Not to be changed."""
    folder = Path(tempfile.mkdtemp(prefix="porocore-bad-input-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / CONFIG).write_text(study(), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", STEPS], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "run"


def from_run(name: str = "", edit: Edit | None = None) -> Callable[[Path], None]:
    """Make a copy of a file of :func:`finished_run`, or of the whole folder; ``edit`` alters an HDF5 file."""

    def make(path: Path) -> None:
        source = finished_run() / name
        if source.is_dir():
            shutil.copytree(source, path, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, path)
        if edit is not None:
            with h5py.File(path, "r+") as file:
                edit(file)

    return make


def hdf5(edit: Edit) -> Callable[[Path], None]:
    """Make a new HDF5 file that ``edit`` fills."""

    def make(path: Path) -> None:
        with h5py.File(path, "w") as file:
            edit(file)

    return make


def folder(path: Path) -> None:
    """An empty folder."""
    path.mkdir()


def fifo(path: Path) -> None:
    """A named pipe that nobody writes to."""
    os.mkfifo(path)


def link(target: str) -> Callable[[Path], None]:
    """Make a symbolic link to ``target``, which need not exist."""

    def make(path: Path) -> None:
        path.symlink_to(target)

    return make


def holes(size: int) -> Callable[[Path], None]:
    """Make a file that says it has ``size`` bytes and takes no room."""

    def make(path: Path) -> None:
        path.touch()
        os.truncate(path, size)

    return make
