"""The configurations that come with the package."""

from __future__ import annotations

from pathlib import Path

NAME = "dehghani2022.yaml"


def packaged(name: str) -> Path:
    """Return the path of a configuration in the installed package, or in the repository."""
    package = Path(__file__).parents[1]
    installed = package / "data" / name
    return installed if installed.is_file() else package.parent / "examples" / name


def benchmark_path() -> Path:
    """Return the path of the benchmark of Dehghani & Zilian."""
    return packaged(NAME)


def as_stated_path() -> Path:
    """Return the path of the benchmark with the channel radius of the paper's text."""
    return packaged("dehghani2022-as-stated.yaml")


def crosscheck_path() -> Path:
    """Return the path of the small case on which backends are compared."""
    return packaged("crosscheck.yaml")
