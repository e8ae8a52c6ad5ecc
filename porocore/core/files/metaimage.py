"""Header of a MetaImage (.mhd, .mha): its keys, and the file that holds the voxels."""

from __future__ import annotations

import re
from pathlib import Path

from porocore.core.echo import echo, echo_path

SUFFIXES = (".mhd", ".mha")
#: Bytes within which a header ends.
_LONGEST = 1 << 16
_LAST = "elementdatafile"


def read_header(path: Path) -> tuple[dict[str, str], int]:
    """Return the keys of a header, in small letters, and its length [bytes], after which voxels of the same file begin.

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
            keys[key.strip().lower()] = "".join(value).strip()
            if _LAST in keys:
                break
    return keys, length


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
