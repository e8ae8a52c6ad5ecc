"""The distributions that are tested: those of a folder that is given, or built here."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "tools")]
from build import build  # noqa: E402


@pytest.fixture(scope="session")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the sdists and wheels.

    With the variable ``POROCORE_DIST``, as ``make dist`` sets it, the files there, so that what is uploaded is what was
    tested.
    """
    given = os.environ.get("POROCORE_DIST")
    if given:
        return ROOT / given
    folder = tmp_path_factory.mktemp("dist")
    build(folder, isolated=False)
    return folder
