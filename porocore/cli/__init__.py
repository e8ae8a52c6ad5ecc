"""The command line: commands → configuration → pipeline. Only this package prints results or exits."""

from porocore.cli.entry import main

__all__ = ["main"]
