"""A sensitivity study as a table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from porocore.core.files.csv_table import write_csv
from porocore.states import Status
from porocore.verification.sensitivity.results import Sensitivity


def write_table(folder: Path, study: Sensitivity) -> Path:
    """sensitivity.csv: a row for each state, load by load; returns its path.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    names = list(next(iter(study.loads.values())).quantities)
    return write_csv(
        folder / "sensitivity.csv", ["load", "value", "status", "seconds", *names], _rows(study, names)
    )


def _rows(study: Sensitivity, names: list[str]) -> Iterator[list[Any]]:
    for name, along in study.loads.items():
        for k, value in enumerate(along.values):
            status = Status(int(along.status[k])).name
            found = [float(along.quantities[quantity][k]) for quantity in names]
            yield [name, float(value), status, float(along.seconds[k]), *found]
