"""Named arrays and a header in one HDF5 file with a checksum: write and read.

Layout: attributes ``format``, ``version``, ``checksum``; ``header``, a text in JSON; every array a dataset of
float64 under its name. The checksum is the SHA-256 of the header and of all names, shapes and numbers.
Reading executes nothing.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.files.reading import set_aside
from porocore.core.hdf5 import atomic_hdf5, opened
from porocore.errors import DataError
from porocore.states import Array


def write_archive(
    path: Path, form: str, version: int, header: dict[str, Any], arrays: dict[str, Array]
) -> None:
    """Write one file, whole or not at all.

    Parameters
    ----------
    path
        Its folder is made if it does not exist.
    form, version
        Kind and version of the file.
    header
        Anything that JSON can hold; floats are kept to the last bit.
    arrays
        Float64 arrays by name; a ``/`` in a name makes a group.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    text = json.dumps(header, ensure_ascii=False)
    with atomic_hdf5(path) as file:
        file.attrs.update(format=form, version=version, checksum=_checksum(text, arrays))
        file.create_dataset("header", data=text, dtype=h5py.string_dtype())
        for name, array in arrays.items():
            file[name] = array


def read_archive(path: Path, form: str, version: int, then: str) -> tuple[dict[str, Any], dict[str, Array]]:
    """Read what :func:`write_archive` wrote: the header and the arrays.

    Raises
    ------
    DataError
        There is no such file, or it is of another kind or version, truncated or edited; the message says
        what to do ``then``.
    """
    with opened(path, f"file of format {form}", then) as file:
        found = file.attribute("format", str) if "format" in file.attributes else "another"
        if found != form:
            raise DataError(
                f"{path}: expected a file of format {form}, got {found[:40]}; move it elsewhere and {then}"
            )
        if (number := file.attribute("version", int)) != version:
            raise DataError(
                f"{path}: expected version {version} of {form}, got {number}; use the porocore that wrote it,"
                f" or move it elsewhere and {then}"
            )
        checksum, text = file.attribute("checksum", str), file.text("header")
        arrays = {name: file.array_of_any_shape(name) for name in file.arrays_below("") if name != "header"}
        if checksum != _checksum(text, arrays):
            raise DataError(
                f"{path}: its numbers do not match its checksum, so it was damaged or edited; {set_aside(path, then)}"
            )
        header = json.loads(text)
        if not isinstance(header, dict):
            raise ValueError(f"its header is a {type(header).__name__}")
    return header, arrays


def _checksum(text: str, arrays: dict[str, Array]) -> str:
    parts: list[str | bytes] = [text]
    for name, array in sorted(arrays.items()):
        parts += [f"\0{name}\0{array.shape}\0", np.asarray(array, dtype=np.float64).tobytes()]
    return stable_hash(*parts)
