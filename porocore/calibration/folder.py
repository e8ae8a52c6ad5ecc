"""Folder of a calibration (CalibrationFolder): claim, lock, record of what it is of, paths of its files."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from porocore.core.files.atomic import require_outside_a_run
from porocore.core.files.lock import Locked, take_lock
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import RunFolderError

FORMAT, VERSION = "porocore-calibration", 1
RECORD, LOCK = "calibrate.json", ".lock"


class CalibrationFolder:
    """Files of one calibration; a context manager that holds the folder's lock.

    Parameters
    ----------
    path
        The folder, made where there is none.
    identity
        Hash of the studies, the data, the unknowns and the settings of the fit.
    resume
        Whether it may hold this calibration already.

    Raises
    ------
    RunFolderError
        It holds another calibration or foreign files, or this one while ``resume`` is not set, or cannot be written.
    """

    def __init__(self, path: Path, identity: str, *, resume: bool = False) -> None:
        self.path = path
        require_outside_a_run(path.absolute())
        try:
            self._claim(identity, resume)
        except OSError as error:
            raise RunFolderError(
                f"{path}: the folder cannot be made: {error.strerror or error}; choose another --out"
            ) from error
        self._lock: int | None = None

    def _claim(self, identity: str, resume: bool) -> None:
        path, expected = self.path, {"format": FORMAT, "version": VERSION, "identity": identity}
        if path.exists() and not path.is_dir():
            raise RunFolderError(f"{path}: expected a folder, got a file; choose another --out")
        record = path / RECORD
        if record.exists():
            if self._record(record) != expected:
                raise RunFolderError(
                    f"{path} holds another calibration: its studies, data, unknowns or settings of the fit are not "
                    "these; choose another --out"
                )
            if not resume:
                raise RunFolderError(
                    f"{path} already holds this calibration; add --resume to continue it, or choose another --out"
                )
            return
        if path.exists() and any(entry.name != LOCK for entry in path.iterdir()):
            raise RunFolderError(f"{path} is not empty and holds no calibration; choose another --out")
        path.mkdir(parents=True, exist_ok=True)
        write_json(record, expected, indent=2)

    @staticmethod
    def _record(path: Path) -> Any:
        try:
            return read_json(path)
        except ValueError as error:
            raise RunFolderError(f"{path} is damaged ({error}); start again in another --out") from error

    def __enter__(self) -> Self:
        """Take the lock; the system releases it when the process ends, however it ends."""
        try:
            self._lock = take_lock(self.path / LOCK)
        except Locked as error:
            raise RunFolderError(
                f"another porocore (process {error.holder}) is working in {self.path}; "
                "wait for it, stop it, or choose another --out"
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def evaluations(self, round_: int) -> Path:
        """Return the record of all evaluations of a round."""
        return self.path / f"evaluations-{round_}.jsonl"

    @property
    def steps(self) -> Path:
        """Time steps of the experiments whose studies have an error control."""
        return self.path / "steps.json"

    @property
    def results(self) -> Path:
        """Values, intervals and directions."""
        return self.path / "calibration.json"

    @property
    def curves(self) -> Path:
        """Measured and fitted curves."""
        return self.path / "curves.csv"

    @property
    def samples(self) -> Path:
        """Evaluations of the fit."""
        return self.path / "samples.csv"
