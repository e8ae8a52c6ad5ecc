"""The command line: commands → configuration → pipeline. Only this package prints results or exits."""

from __future__ import annotations

import os
import sys
from contextlib import suppress


def main() -> None:
    """Entry point of the ``porocore`` command; its libraries are imported here, so that Ctrl-C finds it ready."""
    try:
        from porocore.cli.entry import main as command
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    try:
        command()
    except SystemExit as end:
        _leave_if_interrupted(end.code)
        raise


def _leave_if_interrupted(status: object) -> None:
    """End an interrupted command at once, unless MPI must be told.

    All files are closed and all workers ended by now; the libraries would take seconds to unload.
    """
    from porocore.cli.common import INTERRUPTED
    from porocore.core.parallel import launched

    if status != INTERRUPTED or launched()[1] > 1:
        return
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # nobody reads it any more
            stream.flush()
    os._exit(INTERRUPTED)


__all__ = ["main"]
