"""The benchmark configuration that comes with the package."""

from __future__ import annotations

from pathlib import Path

NAME = "dehghani2022.yaml"


def benchmark_path() -> Path:
    """The file in an installed package, or in the repository when porocore runs from there."""
    package = Path(__file__).parent
    installed = package / "data" / NAME
    return installed if installed.is_file() else package.parent / "examples" / NAME
