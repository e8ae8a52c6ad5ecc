"""The command line: commands → configuration → pipeline. Only this package prints results or exits."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of the ``porocore`` command; its libraries are imported here, so that Ctrl-C finds it ready."""
    try:
        from porocore.cli.entry import main as command
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    command()


__all__ = ["main"]
