"""The losses of a training in a CSV file, which a resumed training goes on writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from porocore.core.files.reading import read_text
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.surrogate import TrainingProgress
from porocore.states import Array

HEADER = "epoch,loss,validation_loss"


class TrainingCurveFile:
    """One row for each report of progress, on the disk at once.

    A training that is resumed from a checkpoint repeats the epochs behind it; these rows come twice.

    Parameters
    ----------
    path
        The file; it is begun if it does not exist. What a full disk or a kill left of a last row is removed.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            text = read_text(path) if path.exists() else ""
            whole = text[: text.rfind("\n") + 1] or f"{HEADER}\n"
            if whole != text:
                path.write_text(whole, encoding="utf-8")
        except OSError as error:
            raise self._cannot_write(error) from error

    def add(self, progress: TrainingProgress) -> None:
        """Append one row."""
        row = f"{progress.epoch},{progress.loss:.6e},{progress.validation_loss:.6e}\n"
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(row)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _cannot_write(self, error: OSError) -> RunFolderError:
        return RunFolderError(f"cannot write {self.path}: {error}; make room or choose another --out")


def read_training_curve(path: Path) -> Array | None:
    """Rows (n, 3) of epoch, loss and validation loss, each epoch once; None where there is nothing to show.

    Raises
    ------
    DataError
        The file is damaged.
    """
    if not path.exists():
        return None
    try:
        header, *rows = read_text(path).splitlines() or [HEADER]
        if header != HEADER:
            raise ValueError(f"its first line is not '{HEADER}'")
        table = np.array([[float(word) for word in row.split(",")] for row in rows]).reshape(len(rows), 3)
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path}: not a record of losses ({error}); delete it, the report can do without"
        ) from error
    if not rows:
        return None
    _, first = np.unique(table[:, 0], return_index=True)
    once: Array = table[first]
    return once
