"""Folder of a calibration (CalibrationFolder): claim, lock, record of what it is of, paths of its files."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Self

from porocore.core.files.atomic import require_outside_a_run
from porocore.core.files.claim import claim_folder, lock_folder
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import RunFolderError

FORMAT, VERSION = "porocore-calibration", 1
RECORD = "calibrate.json"


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
        self._lock: int | None = None
        self._expected = {"format": FORMAT, "version": VERSION, "identity": identity}
        require_outside_a_run(path.absolute())
        claim_folder(
            path,
            RECORD,
            "calibration",
            resume=resume,
            lock=self,
            begin=self._write_record,
            check=self._check_same,
        )

    def _write_record(self) -> None:
        write_json(self.path / RECORD, self._expected, indent=2)

    def _check_same(self) -> None:
        record = self.path / RECORD
        try:
            found = read_json(record)
        except ValueError as error:
            raise RunFolderError(f"{record} is damaged ({error}); start again in another --out") from error
        if found != self._expected:
            raise RunFolderError(
                f"{self.path} holds another calibration: its studies, data, unknowns or settings of the fit are not "
                "these; choose another --out"
            )

    def __enter__(self) -> Self:
        """Take the lock; the system releases it when the process ends, however it ends."""
        self._lock = lock_folder(self.path)
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
    def posterior(self) -> Path:
        """Draws from the posterior distribution."""
        return self.path / "posterior.csv"

    @property
    def samples(self) -> Path:
        """Evaluations of the fit."""
        return self.path / "samples.csv"
