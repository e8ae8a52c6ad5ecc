"""What the platform of a run of the tests cannot have; what POSIX alone has, and Windows not."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Mapping

import pytest

#: A test that sends signals to processes, makes pipes or looks into ``/proc``.
POSIX = pytest.mark.skipif(
    sys.platform == "win32", reason="POSIX alone: Windows has no such signals and files"
)
#: The signal that ends a process at once; on Windows any does.
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


def without(text: str, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a text names what this platform cannot have, by POROCORE_WITHOUT, such as ``dolfinx,mpirun``."""
    words = filter(None, environment.get("POROCORE_WITHOUT", "").lower().split(","))
    return any(word in text.lower() for word in words)
