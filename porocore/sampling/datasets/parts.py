"""Reading of a dataset's file with the unmerged solves in the folder beside it; its inputs in one line."""

from __future__ import annotations

from pathlib import Path

from porocore.core.inputs.input_space import InputSpace
from porocore.errors import DataError
from porocore.sampling.datasets.layout import Block, Header, read_block

#: Times that a file is read again when another process replaces it meanwhile.
MOST_ATTEMPTS = 5


def read_with_parts(
    path: Path, inputs: InputSpace | None, identity: str | None, *, sound: bool, named: bool
) -> tuple[Header, list[Block]]:
    """Return the header and the rows of the file and of the parts beside it; see :meth:`Dataset.open`."""
    for _ in range(MOST_ATTEMPTS):
        seen = stamp(path)
        try:
            found = _read(path, inputs, identity, sound, named)
        except DataError:
            if stamp(path) == seen:
                raise
        else:
            # Parts may have been merged between the reading of the file and that of its parts.
            if stamp(path)[:1] == seen[:1]:
                return found
    raise DataError(f"{path}: is being written all the time; read it when its process is done")


def _read(
    path: Path, inputs: InputSpace | None, identity: str | None, sound: bool, named: bool
) -> tuple[Header, list[Block]]:
    header, block = read_block(path, None if named else "sample again", sound=sound)
    advice = "choose another --out, or move it elsewhere and sample again"
    if identity is not None and header.identity != identity:
        raise DataError(
            f"{path}: holds solved states of another cell or other settings (identity "
            f"{header.identity}, expected {identity}); {advice}"
        )
    if inputs is not None and header.inputs != inputs:
        raise DataError(
            f"{path}: holds states of other inputs ({describe(header.inputs)}, expected "
            f"{describe(inputs)}); {advice}"
        )
    blocks, seen = [block], set(block.keys)
    for part in sorted(parts_folder(path).glob("*.h5")):
        part_header, rows = read_block(part, "resume, which solves its state again", sound=sound)
        if (part_header.identity, part_header.inputs) != (header.identity, header.inputs):
            raise DataError(
                f"{part}: belongs to another dataset than {path.name}; move the folder "
                f"{part.parent.name} elsewhere, or choose another --out"
            )
        # Merged already, but killed before its removal.
        if seen.isdisjoint(rows.keys):
            blocks.append(rows)
    return header, blocks


def parts_folder(path: Path) -> Path:
    """Return the folder of the finished solves that are not merged into ``path`` yet."""
    return path.with_name(f"{path.name}.parts")


def stamp(path: Path) -> tuple[tuple[int, int] | None, ...]:
    """Return a mark that changes with the file and with the parts beside it."""
    found: list[tuple[int, int] | None] = []
    for place in (path, parts_folder(path)):
        try:
            stat = place.stat()
        except OSError:
            found.append(None)
        else:
            found.append((stat.st_ino, stat.st_mtime_ns))
    return tuple(found)


def describe(inputs: InputSpace) -> str:
    """Return names and ranges of the inputs in one line."""
    used = f", at {len(inputs.used)} values of the parameters that a body uses" if inputs.used else ""
    return ", ".join(f"{name} in {inputs.range_text(name)}" for name in inputs.names) + used
