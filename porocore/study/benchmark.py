"""The configurations that come with the package."""

from __future__ import annotations

from pathlib import Path

NAME = "dehghani2022.yaml"


def packaged(name: str) -> Path:
    """The file in an installed package, or in the repository when porocore runs from there."""
    package = Path(__file__).parents[1]
    installed = package / "data" / name
    return installed if installed.is_file() else package.parent / "examples" / name


def benchmark_path() -> Path:
    """The benchmark of Dehghani & Zilian."""
    return packaged(NAME)


def as_stated_path() -> Path:
    """The same with the radius of the channels that the paper's text gives."""
    return packaged("dehghani2022-as-stated.yaml")


def crosscheck_path() -> Path:
    """The small case on which backends are held against each other."""
    return packaged("crosscheck.yaml")
