"""What the platform of a run of the tests cannot have."""

from __future__ import annotations

import os
from collections.abc import Mapping


def without(text: str, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a text names what this platform cannot have, by POROCORE_WITHOUT, such as ``dolfinx,mpirun``."""
    words = filter(None, environment.get("POROCORE_WITHOUT", "").lower().split(","))
    return any(word in text.lower() for word in words)
