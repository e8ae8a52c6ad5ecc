"""Keeping the memory of one prediction for the next."""

from __future__ import annotations

import numpy as np

#: Bytes; glibc adapts up to 32 MiB.
_SIZE = 24 << 20


def keep_freed_memory() -> None:
    """Let glibc keep what predictions free, instead of giving it back to the system and asking anew each time.

    It raises its thresholds to the largest block that was ever freed, so freeing one that was never touched is
    enough. The page faults that this saves can cost more than a prediction of thousands of states.
    """
    block = np.empty(_SIZE, dtype=np.uint8)
    del block
