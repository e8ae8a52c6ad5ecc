"""File of a sampler's decisions beside the dataset, so that a resumed one chooses the same.

A decision is found by a hash of the run and of all that it was made on. So one of another run, or one that was made on
other responses, is never found; a file whose checksum does not fit is passed over. What is not found is decided again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json

FORMAT, VERSION = "porocore-decisions", 1


class DecisionRecord:
    """The decisions of one run; an implementation of :class:`porocore.interfaces.sampler.Remember`.

    Parameters
    ----------
    path
        The file; it need not exist.
    owner
        Identity of the run.
    """

    def __init__(self, path: Path, owner: str) -> None:
        self.path, self._owner = path, owner
        self._known: dict[str, Any] | None = None

    def __call__(self, grounds: str, decide: Callable[[], Any]) -> Any:
        """Return the decision that was made on these grounds; where there is none, make it and keep it.

        Raises
        ------
        RunFolderError
            The file cannot be written.
        """
        if self._known is None:
            self._known = _read(self.path)
        key = hashlib.sha256(f"{self._owner} {grounds}".encode()).hexdigest()
        if key not in self._known:
            # As it will be read, so that a decision is the same now and later.
            self._known[key] = json.loads(json.dumps(decide(), allow_nan=False))
            document = {"format": FORMAT, "version": VERSION, "checksum": _checksum(self._known)}
            write_json(self.path, document | {"decisions": self._known})
        return self._known[key]


def _read(path: Path) -> dict[str, Any]:
    """Return the decisions by their keys; none where the file is missing, damaged or foreign."""
    try:
        document = read_json(path)
        known = document["decisions"]
        whole = (document["format"], document["version"], document["checksum"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return known if isinstance(known, dict) and whole == (FORMAT, VERSION, _checksum(known)) else {}


def _checksum(decisions: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(decisions, sort_keys=True).encode()).hexdigest()
