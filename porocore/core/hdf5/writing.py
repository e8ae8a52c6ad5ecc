"""Atomic writing of a sealed HDF5 file on a disk that may be full (atomic_hdf5).

When the operating system refuses a write, HDF5 keeps the half-written file open, tries again at every later
close, and may end in a segmentation fault. So a file is made in memory and reaches the disk as plain bytes, with a
checksum behind them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote
from uuid import uuid4

import h5py

from porocore.core.files.atomic import atomic_path
from porocore.core.hdf5.seal import seal_of

#: Files that any HDF5 since 1.10 reads; older layouts would double the size of small ones.
LIBVER = ("v110", "v110")


def link_to(name: str) -> str:
    """Return a name that a user gave as that of one member of a group: no path, printable, and never empty.

    ``/``, ``%``, what is not printable and a name of dots alone stand as in addresses of the web, ``a%2Fb``; an empty
    name is ``%``. All others are as they are. :func:`name_of_link` returns the name.
    """
    dots = not name.strip(".")
    hidden = (quote(c, safe="") if c in "/%" or not c.isprintable() else "%2E" if dots else c for c in name)
    return "".join(hidden) or "%"


def name_of_link(link: str) -> str:
    """Return the name that :func:`link_to` wrote."""
    return "" if link == "%" else unquote(link)


@contextmanager
def atomic_hdf5(path: Path) -> Iterator[Any]:
    """Yield an open HDF5 file; it replaces ``path``, complete, if the block succeeds.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    # HDF5 tells files in memory apart by their names.
    with h5py.File(f"{path.name}-{uuid4()}", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with atomic_path(path) as part, part.open("wb") as whole:
        whole.write(image)
        whole.write(seal_of(image))
