"""The command line: commands → configuration → pipeline. Only this package prints results or exits."""

from __future__ import annotations

import atexit
import codecs
import io
import os
import sys


def program() -> None:
    """Run the command line as a program of its own, on one thread, which an interrupted one leaves at once."""
    from porocore.core.parallel.memory import one_thread_from_now

    one_thread_from_now()
    try:
        main()
    except SystemExit as end:
        _leave(end.code)
        raise


def main() -> None:
    """Run the command line; its libraries are imported here, so that Ctrl-C finds it ready.

    Raises
    ------
    SystemExit
        Always, with the status of the command.
    """
    _open_streams()
    _write_any_text()
    _require_a_folder()
    try:
        from porocore.cli.entry import main as command
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    command()


def _open_streams() -> None:
    """Lead closed standard streams to the null device, so that no file takes their place.

    Messages that are written there are lost. Results are not: the place of standard output takes none, so that a
    command that prints one ends with an error, as on a full disk.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            access = os.O_RDONLY if name == "stdout" else os.O_RDWR
            # The lowest number that is free: that of the stream, unless something has taken it already.
            setattr(sys, name, os.fdopen(os.open(os.devnull, access), mode, encoding="utf-8"))
            os.set_inheritable(number, True)


def _write_any_text() -> None:
    """Let standard streams in an encoding without some sign, as pipes of Windows, have another in its place."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and codecs.lookup(stream.encoding).name != "utf-8":
            codecs.register_error("porocore", _without_the_sign)
            stream.reconfigure(errors="porocore")


def _without_the_sign(error: UnicodeError) -> tuple[str | bytes, int]:
    if isinstance(error, UnicodeEncodeError) and error.object[error.start] == "−":
        return "-", error.start + 1
    return codecs.backslashreplace_errors(error)


def _require_a_folder() -> None:
    """Refuse a current folder that was removed, before a library ends the process for it."""
    try:
        os.getcwd()
    except OSError:
        print("error: the current folder was removed; change to another one (cd)", file=sys.stderr)
        sys.exit(2)


def _leave(status: object) -> None:
    """End a command that is done or interrupted at once, unless MPI must be told.

    All files are closed and all workers ended by now; the libraries would take seconds to unload, many on a busy
    machine.
    """
    from porocore.cli.common import INTERRUPTED, TERMINATED
    from porocore.core.parallel import launched

    status = status or 0
    if status not in (0, INTERRUPTED, TERMINATED) or launched()[1] > 1:
        return
    if status == 0:
        if "mpi4py" in sys.modules:  # mpirun -n 1 misses its word
            return
        atexit._run_exitfuncs()  # such as remove temporary files
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):
        return  # which Python reports as it does
    os._exit(int(str(status)))


__all__ = ["main", "program"]
