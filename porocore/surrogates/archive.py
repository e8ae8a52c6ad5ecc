"""Named arrays and a header in one HDF5 file that cannot be mistaken, cut short or edited unnoticed.

Layout: attributes ``format``, ``version``, ``checksum``; ``header``, a text in JSON; every array a dataset of
float64 under its name. The checksum is the SHA-256 of the header and of all names, shapes and numbers.
Reading executes nothing.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from porocore.errors import DataError
from porocore.hdf5 import atomic_hdf5
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
        What kind of file it is.
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


def read_archive(path: Path, form: str, version: int, advice: str) -> tuple[dict[str, Any], dict[str, Array]]:
    """Read what :func:`write_archive` wrote: the header and the arrays.

    Raises
    ------
    DataError
        There is no such file, or it is of another kind or version, truncated or edited; the message ends with
        ``advice``.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file; {advice}")
    try:
        with h5py.File(path, "r") as file:
            found = file.attrs.get("format"), file.attrs.get("version")
            if found[0] != form:
                raise DataError(
                    f"{path}: expected a file of format {form}, got {found[0] or 'another'}; {advice}"
                )
            if found[1] != version:
                raise DataError(
                    f"{path}: expected version {version} of {form}, got {found[1]}; use the porocore that wrote it,"
                    f" or {advice}"
                )
            checksum = file.attrs["checksum"]
            text = file["header"].asstr()[()]
            arrays: dict[str, Array] = {}
            file.visititems(lambda name, item: _collect(arrays, name, item))
        if checksum != _checksum(text, arrays):
            raise DataError(
                f"{path}: its numbers do not match its checksum, so it was damaged or edited; {advice}"
            )
        header = json.loads(text)
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        # What h5py raises depends on where a file is cut.
        raise DataError(f"{path}: not a complete file of format {form} ({error}); {advice}") from error
    return header, arrays


def _collect(arrays: dict[str, Array], name: str, item: Any) -> None:
    if isinstance(item, h5py.Dataset) and name != "header":
        if item.dtype != np.float64:
            raise ValueError(f"{name} holds {item.dtype}")
        arrays[name] = item[()]


def _checksum(text: str, arrays: dict[str, Array]) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name], dtype=np.float64)
        digest.update(f"\0{name}\0{arrays[name].shape}\0".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
