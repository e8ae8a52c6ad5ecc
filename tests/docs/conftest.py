"""Tests that the documents say what the code does, and that what they show works."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
from tests.docs.services import service  # noqa: F401
