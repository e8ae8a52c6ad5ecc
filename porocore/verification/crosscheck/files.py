"""Writing a crosscheck: one JSON file with every number, one page to look at."""

from __future__ import annotations

from pathlib import Path

from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_json
from porocore.verification.crosscheck.check import CrossCheck
from porocore.verification.crosscheck.document import document
from porocore.verification.crosscheck.html import render


def write(folder: Path, result: CrossCheck) -> tuple[Path, Path]:
    """Paths of crosscheck.json and crosscheck.html, which take the place of older ones.

    Raises
    ------
    RunFolderError
        The folder cannot be written.
    """
    data, page = folder / "crosscheck.json", folder / "crosscheck.html"
    write_json(data, document(result), allow_nan=False)
    with atomic_path(page) as part:
        part.write_text(render(result), encoding="utf-8")
    return data, page
