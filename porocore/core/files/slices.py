"""Numbered files that make one stack, of a folder or a pattern of names (Slices): their order, what is missing."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass
from fnmatch import fnmatchcase
from glob import escape
from itertools import pairwise
from pathlib import Path

from porocore.core.echo import echo_path
from porocore.core.files.reading import obstacle

_NUMBER = re.compile("([0-9]+)")
#: Names that are told of many.
MOST_NAMES = 5


@dataclass(frozen=True)
class Slices:
    """Files of one stack.

    Attributes
    ----------
    files
        By ascending numbers, such that 2 is before 10.
    left_out
        Names of other files at the same place.
    """

    files: tuple[Path, ...]
    left_out: tuple[str, ...]

    @classmethod
    def at(cls, path: Path, suffixes: tuple[str, ...]) -> Slices | None:
        """Return the slices of a folder, or those whose names match a pattern such as ``slices/*.tif``.

        None: the path leads to neither.

        Raises
        ------
        ValueError
            There is no file with one of the suffixes, or those that are there are not one stack.
        """
        whole = os.path.isdir(path)
        if not whole and (os.path.lexists(path) or not has_signs(path)):
            return None
        folder, place = path if whole else path.parent, echo_path(path)
        try:
            present = sorted(name for name in os.listdir(folder) if not name.startswith("."))
        except OSError as error:
            fault = obstacle(folder) or "no such folder" if not folder.is_dir() else error.strerror
            raise ValueError(f"{echo_path(folder)}: {fault}") from None
        matching = [name for name in present if whole or fnmatchcase(name, path.name)]
        found = [name for name in matching if name.lower().endswith(suffixes) and (folder / name).is_file()]
        if not found:
            expected = f"expected slices as {', '.join(suffixes)}"
            kinds = _kinds(folder, matching or present)
            if whole or matching:
                raise ValueError(f"{place}: {expected}, got {kinds}; save the slices as TIFF")
            raise ValueError(
                f"{place}: {expected}, got no name of this pattern in a folder of {kinds}; check the pattern"
            )
        _require_one_stack(place, folder, found)
        files = tuple(folder / name for name in sorted(found, key=_numbers))
        return cls(files, tuple(name for name in matching if name not in set(found)))

    @property
    def gaps(self) -> str:
        """A sentence on numbers that are missing between the first and the last; empty where none are."""
        columns = [set(column) for column in zip(*(_numbers(file.name) for file in self.files), strict=True)]
        # Of a name with two numbers that change, such as a time and a count, neither needs to be without gaps.
        changing = [sorted(column) for column in columns if len(column) > 1]
        if len(changing) != 1:
            return ""
        step = min(following - number for number, following in pairwise(changing[0]))
        jumps = [(n + step, m - step) for n, m in pairwise(changing[0]) if m - n > step]
        if not jumps:
            return ""
        told = ", ".join(f"{n} to {m}" if n < m else f"{n}" for n, m in jumps[:MOST_NAMES])
        return (
            f"slices are missing between {self.files[0].name} and {self.files[-1].name}, numbered {told}"
            f"{', …' if jumps[MOST_NAMES:] else ''}; those beside a gap are taken for neighbours: add what is missing"
        )

    @property
    def summary(self) -> str:
        """A sentence on the slices along z, and on files that are left out."""
        told = f"{len(self.files)} slices along z, from {self.files[0].name} to {self.files[-1].name}"
        if not self.left_out:
            return told
        names = ", ".join(self.left_out[:MOST_NAMES]) + (", …" if self.left_out[MOST_NAMES:] else "")
        return f"{told}; left out: {names}"


def has_signs(path: Path) -> bool:
    """Return True if a name has signs of a pattern."""
    return any(sign in path.name for sign in "*?[")


def _require_one_stack(place: str, folder: Path, names: list[str]) -> None:
    """Refuse names that differ in more than their numbers, or in no number."""
    kinds = Counter(_NUMBER.sub("#", name) for name in names)
    if len(kinds) > 1:
        told = ", ".join(f"{kind} ({count})" for kind, count in kinds.most_common(MOST_NAMES))
        first = next(name for name in names if _NUMBER.sub("#", name) == kinds.most_common(1)[0][0])
        pattern = "[0-9]*".join(map(escape, _NUMBER.split(first)[::2]))
        raise ValueError(
            f"{place}: expected the slices of one stack, whose names differ in their numbers alone, got "
            f"{told}{', …' if len(kinds) > MOST_NAMES else ''}; choose by a pattern of names, such as "
            f"'path: {folder.name}/{pattern}'"
        )
    by_number: dict[tuple[int, ...], str] = {}
    for name in names:
        if (other := by_number.setdefault(_numbers(name), name)) != name:
            raise ValueError(
                f"{place}: expected one slice of each number, got {other} and {name}; remove one"
            )


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(map(int, _NUMBER.findall(name)))


def _kinds(folder: Path, names: list[str]) -> str:
    """Return how many files of each kind there are."""
    counts = Counter(
        "folder" if (folder / n).is_dir() else Path(n).suffix or "without a suffix" for n in names
    )
    return ", ".join(f"{count} {kind}" for kind, count in counts.most_common(MOST_NAMES)) or "no files"
