"""Results of ``porocore verify`` as a JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import porocore.commands.verify.cases as ladder
from porocore.core.files.plain_data import json_ready, write_json

FORMAT, VERSION = "porocore-verification", 1


def document(rows: Sequence[ladder.CaseResult], *, long: bool) -> dict[str, Any]:
    """Return all results as plain data; a number that is not finite is null."""
    found = {
        "format": FORMAT,
        "version": VERSION,
        "form": "long" if long else "short",
        "passed": all(row.passed for row in rows),
        "rows": [_row(row) for row in rows],
    }
    ready: dict[str, Any] = json_ready(found)
    return ready


def text(rows: Sequence[ladder.CaseResult], *, long: bool) -> str:
    """Return the document as JSON text."""
    return json.dumps(document(rows, long=long), indent=1, ensure_ascii=False)


def write(path: Path, rows: Sequence[ladder.CaseResult], *, long: bool) -> None:
    """Write the document atomically."""
    write_json(path, document(rows, long=long), indent=1, ensure_ascii=False)


def _row(row: ladder.CaseResult) -> dict[str, Any]:
    case = ladder.CASES.get(row.case)
    found: dict[str, Any] = {
        "case": row.case,
        "item": row.item,
        "backend": row.backend,
        "passed": row.passed,
        "seconds": round(row.seconds, 3),
        "source": case.source if case else "",
    }
    if row.check is None:
        return found | {"reason": row.reason}
    names = ("quantity", "reference", "ours", "error", "allowed", "order", "note")
    return found | {name: getattr(row.check, name) for name in names}
