"""Folder of a calibration (CalibrationFolder): claim, lock, record of what it is of, paths of its files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from porocore.core.echo import joined, reason
from porocore.core.files.atomic import require_outside_a_run
from porocore.core.files.claim import claim_folder, lock_folder
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import RunFolderError

FORMAT, VERSION = "porocore-calibration", 2
RECORD = "calibrate.json"


class CalibrationFolder:
    """Files of one calibration; a context manager that holds the folder's lock.

    Parameters
    ----------
    path
        The folder, made where there is none.
    identity
        Hashes of all that the answer depends on, by words for what they are of.
    resume
        Whether it may hold this calibration already.

    Raises
    ------
    RunFolderError
        It holds another calibration or foreign files, or this one while ``resume`` is not set, or cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, str], *, resume: bool = False) -> None:
        self.path = path
        self._lock: int | None = None
        self._expected: dict[str, Any] = {"format": FORMAT, "version": VERSION, "identity": dict(identity)}
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
            raise RunFolderError(
                f"{record} is damaged ({reason(error)}); start again in another --out"
            ) from error
        if found != self._expected:
            raise RunFolderError(
                f"{self.path} holds another calibration, {self._difference(found)}; choose another --out, or undo the "
                "change"
            )

    def _difference(self, found: Any) -> str:
        """Return words for what differs in a record that was read."""
        known = found.get("identity") if isinstance(found, dict) else None
        mine = self._expected["identity"]
        if (
            not isinstance(known, dict)
            or {**found, "identity": mine} != self._expected
            or set(known) != set(mine)
        ):
            return "whose record is of another version, or damaged"
        return f"with other {joined(name for name in mine if known[name] != mine[name])}"

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
    def halved_steps(self) -> Path:
        """Curves at the best values with halved time steps."""
        return self.path / "halved-steps.json"

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
