"""The command line in processes of their own that need not import everything anew.

A server imports what most commands need and forks a child for each of them: as separate as a process that was
started from nothing, with its own exit status, streams and folder, and two seconds sooner. What is about the start of a
process, or about killing one, starts a real one.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

#: torch and scikit-fem, if they are there. Not jax and dolfinx, whose threads and MPI do not outlive a fork.
IMPORTED = (
    "porocore.study.run.pipeline",
    "porocore.report.page",
    "porocore.cli.entry",
    "porocore_fem_skfem.cell_solver",
    "porocore_fem_skfem.macro",
    "porocore_surrogate_torch.surrogate",
)


class WarmCommand:
    """Runs the command in forked processes; a context manager."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._server = subprocess.Popen(
            [sys.executable, __file__],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(
        self, words: Sequence[str], cwd: Path | None, timeout: float, drawn: bool
    ) -> subprocess.CompletedProcess[str]:
        """Like ``subprocess.run`` with captured streams; figures stay empty unless they are to be ``drawn``.

        Raises
        ------
        TimeoutError
            It took longer than ``timeout`` [s]; it was killed.
        """
        with TemporaryDirectory() as folder:
            out, err = Path(folder, "out"), Path(folder, "err")
            order = [list(words), str(cwd or Path.cwd()), str(out), str(err), timeout, drawn]
            assert self._server.stdin is not None
            assert self._server.stdout is not None
            print(json.dumps(order), file=self._server.stdin, flush=True)
            status = json.loads(self._server.stdout.readline())
            if status is None:
                raise TimeoutError(f"porocore {' '.join(words)} took longer than {timeout:g} s")
            return subprocess.CompletedProcess(
                ["porocore", *words], status, out.read_text(encoding="utf-8"), err.read_text(encoding="utf-8")
            )

    def close(self) -> None:
        """End the server."""
        self._server.communicate()


def serve(orders: IO[str], answers: IO[str]) -> None:
    """Fork a child for every line until there is none."""
    for name in IMPORTED:
        with suppress(ImportError):
            importlib.import_module(name)

    import typer.main
    from matplotlib.figure import Figure

    from porocore.cli.entry import app

    typer.main.get_command = cache(typer.main.get_command)
    typer.main.get_command(app)

    def too_late(number: int, frame: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, too_late)
    for line in orders:
        words, cwd, out, err, timeout, drawn = json.loads(line)
        child = os.fork()
        if child == 0:
            if not drawn:
                Figure.draw = lambda figure, renderer: None  # type: ignore[method-assign]
            command(words, cwd, out, err)
        signal.alarm(int(timeout))
        try:
            status: int | None = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        except TimeoutError:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            status = None
        signal.alarm(0)
        print(json.dumps(status), file=answers, flush=True)


def command(words: list[str], cwd: str, out: str, err: str) -> None:
    """Be the command; does not return."""
    from porocore.cli import main

    os.chdir(cwd)
    for number, path, mode in ((0, os.devnull, os.O_RDONLY), (1, out, os.O_WRONLY), (2, err, os.O_WRONLY)):
        os.dup2(os.open(path, mode | os.O_CREAT, 0o600), number)
    sys.stdin, sys.stdout, sys.stderr = os.fdopen(0, "r"), os.fdopen(1, "w"), os.fdopen(2, "w")
    sys.argv = ["porocore", *words]
    status = 0
    try:
        main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - shown as the interpreter does
        sys.excepthook(*sys.exc_info())
        status = 1
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(status)


if __name__ == "__main__":
    serve(sys.stdin, sys.stdout)
