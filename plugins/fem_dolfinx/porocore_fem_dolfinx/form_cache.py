"""Folder of the compiled forms, and the lock by which one process compiles at a time.

FFCx marks a form that is being compiled by its C file. Whoever finds the mark waits ten seconds and gives up, so two
processes on a busy machine fail each other, and one that is killed while it compiles fails all that come after it.
Here one process compiles at a time, under a lock that dies with it, in a folder that no other program uses: a mark
that is found under the lock was left by the dead.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cffi import VerificationError
from filelock import FileLock

from porocore.errors import PluginError

if TYPE_CHECKING:
    from mpi4py import MPI


def folder(version: str) -> Path:
    """Return the folder of forms for this version of dolfinx and this Python, which FFCx 0.5 does not tell apart."""
    above = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return above / "porocore" / f"dolfinx-{version}-{sys.implementation.cache_tag}"


@contextmanager
def compiling(forms: Path, comm: MPI.Intracomm) -> Iterator[None]:
    """Guard a block that may compile into the folder ``forms``, on all processes of the communicator.

    Raises
    ------
    PluginError
        The folder cannot be written, or the C compiler or Python's headers are missing.
    """
    with ExitStack() as stack:
        # dolfinx compiles on the first process while the others wait: all must be here, and all learn of a failure.
        comm.Barrier()
        refusal = ""
        if comm.rank == 0:
            try:
                stack.enter_context(_locked(forms))
            except OSError as error:
                refusal = str(error)
        if refusal := comm.bcast(refusal, root=0):
            raise PluginError(
                f"compiled forms cannot be kept in {forms} ({refusal}); "
                "set XDG_CACHE_HOME to a folder that can be written"
            )
        try:
            yield
        except (VerificationError, RuntimeError) as error:
            if not isinstance(error, VerificationError) and "just-in-time" not in str(error):
                raise
            raise PluginError(
                f"dolfinx could not compile a form ({str(error).splitlines()[0]}); a C compiler and Python's headers "
                "are needed: on Debian apt-get install gcc python3-dev"
            ) from error


@contextmanager
def _locked(forms: Path) -> Iterator[None]:
    forms.mkdir(parents=True, exist_ok=True)
    with FileLock(forms / "lock"):
        for mark in forms.glob("*.c"):
            if not mark.with_suffix(".c.cached").exists():
                mark.unlink()
        yield
