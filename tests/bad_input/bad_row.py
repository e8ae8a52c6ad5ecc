"""Rows of the table of bad input: what is given to the command line, and what it must answer."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from porocore.cli.entry import whole_program

#: A text, bytes, or what makes the file (or folder, link, pipe, …) at the path that it is given.
Content = str | bytes | Callable[[Path], object]

#: A study that loads and is checked in a tenth of a second, and runs in seconds.
STUDY: dict[str, Any] = {
    "title": "A small study",
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.25, "axes": "xyz"},
        "material": {"kind": "neo-hookean", "poisson_ratio": 0.35},
        "viscosity": 1e-3,
        "mesh": {"size": 0.5, "fluid_size": 0.4},
    },
    "fem": {"backend": "skfem"},
    "sampling": {
        "inputs": {
            "p": {"range": [-0.02, 0.06], "step": 0.04},
            "H22": {"range": [-0.1, 0.02], "step": 0.06},
        },
        "tolerance": 0.05,
        "workers": 1,
        "test": {"count": 2, "seed": 7},
    },
    "surrogate": {"backend": "polynomial", "options": {"degree": 2}},
    "closure": "mean-gradient",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 2, 1]},
        "boundary": {
            **{side: {"displacement": [0, None, 0]} for side in ("x-", "x+", "z-", "z+")},
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-0.04],
        "time": {"end": 12, "step": 6, "ramp_increments": 2, "ramp_step": 3, "profiles": [10]},
    },
}
#: Hundreds of studies are written while the tests are collected: in C, where PyYAML has it.
FAST_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
#: The name under which most rows give their configuration.
CONFIG = "study.yaml"


@dataclass(frozen=True)
class Row:
    """One input that must be refused.

    Attributes
    ----------
    name
        Tells the row from all others.
    words
        The command line behind ``porocore``. Paths are relative to the working folder.
    expected
        Words that the message must contain; white space counts as one blank.
    files
        By relative path, what is made in the empty working folder before.
    status
        The exit status; 1 where a check is made and fails (``data check``).
    prints
        Standard output may hold something, as what ``check`` tells before it comes to a fault.
    own_process
        For what ends the process, closes its streams or kills it.
    slow
        For the slow suite.
    """

    name: str
    words: tuple[str, ...]
    expected: tuple[str, ...] = ()
    files: Mapping[str, Content] = field(default_factory=dict)
    status: int = 2
    prints: bool = False
    own_process: bool = False
    slow: bool = False

    def make_files(self, folder: Path) -> None:
        """Make ``files`` in ``folder``, in their order."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, str):
                path.write_text(content, encoding="utf-8")
            elif isinstance(content, bytes):
                path.write_bytes(content)
            else:
                content(path)

    @property
    def command(self) -> str:
        """The command that is called, such as ``data check``; empty where the words name none."""
        words = list(self.words)
        if words[:1] == ["cell"] and " ".join(words[:2]) not in commands():
            words.insert(1, "state")
        return next((name for n in (2, 1) if (name := " ".join(words[:n])) in commands()), "")


def study(changes: Mapping[str, Any] | None = None, **others: Any) -> str:
    """The text of :data:`STUDY` with changed values by dotted key (in ``others`` ``__`` for the dot); None removes.

    A list is indexed by number: ``macro.loads.0``.
    """
    data = copy.deepcopy(STUDY)
    for key, value in {**(changes or {}), **{k.replace("__", "."): v for k, v in others.items()}}.items():
        *above, last = key.split(".")
        part: Any = data
        for name in above:
            part = part[int(name)] if isinstance(part, list) else part.setdefault(name, {})
        if isinstance(part, list):
            part[int(last)] = value
        elif value is None:
            part.pop(last, None)
        else:
            part[last] = value
    return yaml.dump(data, Dumper=FAST_DUMPER, allow_unicode=True, sort_keys=False)


def faulty(
    name: str, changes: Mapping[str, Any], *expected: str, command: str = "check", **others: Any
) -> Row:
    """A row that gives :func:`study` with ``changes`` to ``command``; ``others`` are attributes of the row."""
    files = {CONFIG: study(changes), **others.pop("files", {})}
    others.setdefault("prints", command == "check")
    return Row(name, (*command.split(), CONFIG), expected, files, **others)


@cache
def commands() -> frozenset[str]:
    """Every command, such as ``run`` and ``data check``."""
    found = set()
    for name, command in whole_program().commands.items():
        below = getattr(command, "commands", None)
        found |= {name} if below is None else {f"{name} {inner}" for inner in below}
    return frozenset(found)
