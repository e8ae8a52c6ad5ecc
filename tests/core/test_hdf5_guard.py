"""Files without a seal are read in another process first; what harms it is one message here."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from porocore.core import hdf5 as guard
from porocore.core.hdf5 import atomic_hdf5, opened
from porocore.core.hdf5_trial import BUSY, SECONDS
from porocore.errors import DataError
from tests.helpers.invoked import invoke

TEXT = h5py.string_dtype()


def endless(path: Path) -> Path:
    """Make a file with a text that says it ends where nothing is: HDF5 looks for the next one for ever."""
    with h5py.File(path, "w") as file:
        file.create_dataset("key", data=["needle"], dtype=TEXT)
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"needle") - 7] = 1
    path.write_bytes(raw)
    return path


def foreign(path: Path) -> Path:
    with h5py.File(path, "w") as file:
        file["x"], file.attrs["format"] = np.arange(6.0).reshape(3, 2), "mine"
        file.create_dataset("key", data=["a", "∇"], dtype=TEXT)
    return path


def read(path: Path) -> tuple[list[float], list[str]]:
    with opened(path, "file", "make it again") as file:
        return file.array("x", 3, 2).ravel().tolist(), file.texts("key", 2)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The paths that the other process was asked about."""
    paths = list[str]()
    true = guard._Trial.ask
    monkeypatch.setattr(guard._Trial, "ask", lambda self, path: (paths.append(path), true(self, path))[1])
    return paths


def test_a_file_that_never_ends_is_one_message_within_seconds(tmp_path: Path, asked: list[str]) -> None:
    path = endless(tmp_path / "data.h5")
    began = time.perf_counter()
    for _ in range(2):
        with pytest.raises(DataError, match="HDF5 comes to no end with it") as error:
            read(path)
        assert str(error.value).startswith(f"{path}: not a complete file (")
    check, info = invoke("data", "check", path), invoke("data", "info", path)
    assert (check.exit_code, isinstance(info.exception, DataError)) == (1, True)
    assert "HDF5 comes to no end with it" in " ".join(check.output.split())
    assert len(asked) == 1, "the answer about an unchanged file is kept"
    assert time.perf_counter() - began < (2 * BUSY if sys.platform == "win32" else 5) * SECONDS
    path.unlink()
    assert read(foreign(path)) == ([0, 1, 2, 3, 4, 5], ["a", "∇"])


def test_a_file_with_a_seal_is_not_tried(tmp_path: Path, asked: list[str]) -> None:
    with atomic_hdf5(tmp_path / "ours.h5") as file:
        file["x"] = np.zeros((3, 2))
        file.create_dataset("key", data=["a", "b"], dtype=TEXT)
    read(tmp_path / "ours.h5")
    assert not asked


def test_a_process_that_was_killed_is_started_again(tmp_path: Path) -> None:
    read(foreign(tmp_path / "one.h5"))
    killed = guard._trial()._process  # asked once: the next time it may be another, which nobody ends
    killed.kill()
    killed.wait()
    read(foreign(tmp_path / "two.h5"))


def test_a_crash_after_other_files_is_no_fault_of_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read(foreign(tmp_path / "one.h5"))
    killed = guard._trial()
    killed._process.kill()
    killed._process.wait()
    monkeypatch.setattr(killed, "alive", lambda: guard._RUNNING[0].answers < 2)
    read(foreign(tmp_path / "two.h5"))
    assert guard._trial() is not killed


def test_a_crash_over_the_first_file_is_its_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guard._trial().end()
    with monkeypatch.context() as patched:
        patched.setattr(guard, "_COMMAND", "import os; os._exit(9)")
        with pytest.raises(DataError, match="HDF5 crashes with it, so it is damaged"):
            read(foreign(tmp_path / "one.h5"))
    read(foreign(tmp_path / "two.h5"))


def test_names_of_files_may_be_anything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a\nb.h5", "∇ .h5", "-c", os.fsdecode(b"\xff.h5")):
        assert read(foreign(Path(name)))[1] == ["a", "∇"]


def test_an_interrupted_question_is_no_answer_to_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:

        def stop(text: str) -> None:
            raise KeyboardInterrupt

        patched.setattr(guard.json, "loads", stop)
        with pytest.raises(KeyboardInterrupt):
            read(foreign(tmp_path / "first.h5"))
    assert read(foreign(tmp_path / "next.h5"))[1] == ["a", "∇"]


def test_a_whole_number_without_bound_is_refused_in_a_short_message(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file.attrs["version"] = 1e308
    with (
        pytest.raises(DataError, match=r"attribute 'version' is 1e\+308"),
        opened(tmp_path / "data.h5", "file", "make it again") as file,
    ):
        file.attribute("version", int)
