"""Sessions of gmsh (gmsh_session): one at a time in a process, since gmsh has one state for all threads."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from porocore.errors import ConfigurationError, PorocoreError

SYSTEM_LIBRARIES = (
    "libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1 libgomp1"
)
_ONE_AT_A_TIME = threading.Lock()


def import_gmsh() -> Any:
    """Return the module gmsh, or raise an error that names the libraries it needs."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise PorocoreError(
            f"gmsh cannot be loaded ({error}); it needs some system libraries: on Debian or Ubuntu run "
            f"apt-get install {SYSTEM_LIBRARIES}"
        ) from error
    return gmsh


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """Yield gmsh with an empty model, on one thread and without output; other threads wait until it ends.

    gmsh reads no configuration of the user's and leaves signals alone, so that it runs off the main thread too.

    Raises
    ------
    PorocoreError
        gmsh cannot be loaded, or the program that calls porocore has a session of its own, whose options would change
        the mesh.
    """
    gmsh = import_gmsh()
    with _ONE_AT_A_TIME:
        if gmsh.isInitialized():
            raise PorocoreError(
                "gmsh is in use by this program already, and its options would change the mesh; call gmsh.finalize() "
                "before porocore makes or reads a mesh"
            )
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.option.setNumber("General.NumThreads", 1)
            yield gmsh
        finally:
            gmsh.finalize()


def open_file(gmsh: Any, path: Path) -> None:
    """Read a file into the current model.

    Raises
    ------
    ConfigurationError
        A file of options lies beside it, which gmsh reads as well, and whose commands it executes.
    Exception
        gmsh cannot read it; gmsh raises nothing else.
    """
    options = path.with_name(f"{path.name}.opt")
    if options.exists():
        raise ConfigurationError(
            f"gmsh would also read {options.name}, which lies beside {path.name}, and execute its commands; move it "
            "elsewhere"
        )
    gmsh.open(str(path))
