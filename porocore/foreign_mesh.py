"""Meshes of other programs, read by meshio."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from porocore.errors import ConfigurationError


def read_mesh(path: Path) -> Any:
    """What meshio makes of a file.

    Raises
    ------
    ConfigurationError
        It cannot be read; the message begins with the path.
    """
    import meshio  # heavy, and needed here only

    try:
        with redirect_stdout(io.StringIO()) as said:
            return meshio.read(path)
    # meshio's readers raise whatever the file makes them stumble over; some of them print and end the process.
    except (Exception, SystemExit) as error:
        reason = str(error) if not isinstance(error, SystemExit) else " ".join(said.getvalue().split())
        raise ConfigurationError(
            f"{path}: not a mesh that meshio can read ({reason or type(error).__name__}); expected .msh, .vtu, .mesh "
            "or another of its formats"
        ) from error
