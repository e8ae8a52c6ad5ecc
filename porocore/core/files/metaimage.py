"""Header of a MetaImage (.mhd, .mha): its keys, and the file that holds the voxels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path

from porocore.core.echo import echo, echo_path

SUFFIXES = (".mhd", ".mha")
#: Bytes within which a header ends.
_LONGEST = 1 << 16
_LAST = "ElementDataFile"
_REQUIRED = ("NDims", "DimSize", "ElementType", _LAST)
#: Numbers of keys, as powers of the number of axes.
_LISTS = {
    "DimSize": 1, "ElementSpacing": 1, "ElementSize": 1, "Offset": 1, "Position": 1, "Origin": 1, "CenterOfRotation": 1,
    "TransformMatrix": 2, "Rotation": 2, "Orientation": 2,
}  # fmt: skip
_TYPES = (
    "MET_UCHAR", "MET_CHAR", "MET_USHORT", "MET_SHORT", "MET_UINT", "MET_INT", "MET_ULONG", "MET_LONG",
    "MET_ULONG_LONG", "MET_LONG_LONG", "MET_FLOAT", "MET_DOUBLE",
)  # fmt: skip


def read_header(path: Path) -> tuple[dict[str, str], int]:
    """Return the keys of a header, and its length [bytes], after which voxels of the same file begin.

    Capitals count, as for the libraries that read it.

    Raises
    ------
    OSError
        It cannot be read.
    """
    keys: dict[str, str] = {}
    length = 0
    with path.open("rb") as file:
        for line in file.read(_LONGEST).splitlines(keepends=True):
            length += len(line)
            key, *value = re.split("[=:]", line.decode("utf-8", "surrogateescape"), maxsplit=1)
            keys[key.strip()] = "".join(value).strip()
            if _LAST in keys:
                break
    return keys, length


def header_fault(keys: Mapping[str, str]) -> str:
    """Return what a header lacks, or says in a wrong way; empty: no fault was found."""
    for key in _REQUIRED:
        if key not in keys:
            near = get_close_matches(key, keys, 1)
            return f"expected the key {key} in its header, got {echo(near[0]) if near else 'none'}; write '{key} = …'"
    if list(keys).index("NDims") > list(keys).index("DimSize"):
        return "expected NDims above DimSize in its header, got it below; exchange the lines"
    if not re.fullmatch("[1-9]", keys["NDims"]):
        return f"NDims: expected the number of axes, such as 'NDims = 3', got {echo(keys['NDims'])}"
    for key, power in _LISTS.items():
        number, count = "[1-9][0-9]*" if key == "DimSize" else "[-+.0-9eE]+", int(keys["NDims"]) ** power
        if key in keys and not re.fullmatch(rf"({number}(\s+|$)){{{count},}}", keys[key]):
            kind = "whole numbers above 0" if key == "DimSize" else "numbers"
            return f"{key}: expected {count} {kind} with blanks between them, got {echo(keys[key])}"
    if keys["ElementType"].removesuffix("_ARRAY") not in _TYPES:
        return f"ElementType: expected one of {', '.join(_TYPES)}, got {echo(keys['ElementType'])}"
    return ""


def ignored_keys(path: Path) -> list[str]:
    """Return the keys below the one that names the file of the voxels, which the format ignores."""
    if data_file(path) is None:
        return []
    rest = path.read_bytes()[read_header(path)[1] :].decode("utf-8", "replace")
    return re.findall(r"^\s*(\w+)\s*[=:]", rest, re.MULTILINE)


def data_file(path: Path) -> Path | None:
    """Return the file of the voxels; None: they stand behind the header, or the path is that of another kind of file.

    Raises
    ------
    ValueError
        The header names no file, or several.
    """
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return None
    name = read_header(path)[0].get(_LAST)
    if name == "LOCAL":
        return None
    if not name or name.startswith("LIST") or "%" in name:
        raise ValueError(
            f"{echo_path(path)}: expected the header of a MetaImage whose last key names one file, such as "
            f"'ElementDataFile = {path.stem}.raw', got {echo(name) if name else 'none'}; write all voxels into one file"
        )
    return path.parent / name
