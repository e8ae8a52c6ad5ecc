"""Results as plain data: JSON and CSV files, hashes, settings laid over others."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from porocore.core.files.atomic import write_text


def json_ready(value: Any) -> Any:
    """Return plain data: lists for arrays, None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, document: Any, **how: Any) -> None:
    """Write a JSON file atomically; ``how`` goes to :func:`json.dumps`.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    write_text(path, json.dumps(document, **how) + "\n")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write one table atomically, floats with eight digits, and return the path.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([f"{x + 0.0:.8g}" if isinstance(x, float) else x for x in row])  # no -0
    write_text(path, text.getvalue())
    return path


def stable_hash(*parts: str | bytes, length: int = 64) -> str:
    """Return the first digits of the SHA-256 of texts in UTF-8 and of bytes, joined without anything between them."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else part)
    return digest.hexdigest()[:length]


def json_hash(value: Any, **how: Any) -> str:
    """Return sixteen digits of the SHA-256 of a value as JSON; ``how`` goes to :func:`json.dumps`."""
    return stable_hash(json.dumps(value, **how), length=16)


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested settings in which those of ``above`` win.

    An empty section, or one of another ``kind`` or ``backend``, replaces the whole section.
    """
    found = dict(below)
    for key, value in above.items():
        old = found.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            other = any(name in value and value[name] != old.get(name) for name in ("kind", "backend"))
            found[key] = dict(value) if other or not value else merged(old, value)
        else:
            found[key] = value.tolist() if hasattr(value, "tolist") else value
    return found
