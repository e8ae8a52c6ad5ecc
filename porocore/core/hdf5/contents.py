"""Reading of arrays, attributes and texts of an HDF5 file by name, shape and kind; one error if damaged."""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
import numpy.typing as npt
from h5py import h5a, h5t

from porocore.core.echo import reason
from porocore.core.files.reading import require_ordinary, set_aside
from porocore.core.hdf5.guard import require_harmless
from porocore.core.hdf5.seal import NoHdf5Error, check_ends, use_elsewhere
from porocore.core.hdf5.structure import COMPRESSION, SPARE, Stored, Structure, examine
from porocore.errors import ConfigurationError, DataError

Kind = Literal["float", "int", "number"]
#: What h5py raises depends on where a file is damaged.
UNREADABLE = (
    OSError, KeyError, IndexError, ValueError, TypeError, AttributeError, RuntimeError, ArithmeticError, MemoryError,
    AssertionError, SystemError, struct.error, ConfigurationError,
)  # fmt: skip
_CLASSES = {"float": (h5t.FLOAT,), "int": (h5t.INTEGER,), "number": (h5t.FLOAT, h5t.INTEGER)}


class Contents:
    """An open file whose structure is sound.

    Shapes are given in numbers and in symbols, such as ``"n", 3, 3``: a symbol is the same number in all of a file.
    Everything raises ValueError or KeyError where the file does not hold what is asked for.
    """

    def __init__(self, file: Any, path: Path) -> None:
        self.path, self.sizes = path, dict[str, int]()
        self._file, self._structure = file, _examined(file, path)

    def __contains__(self, name: str) -> bool:
        return name in self._structure.datasets or name in self._structure.groups

    def is_of(self, form: str, version: int) -> bool:
        """Return whether the file says that it is of a format and version."""
        named = {"format", "version"} <= set(self.attributes)
        return named and (self.attribute("format", str), self.attribute("version", int)) == (form, version)

    @property
    def attributes(self) -> list[str]:
        """Names of the attributes of the file."""
        return [
            h5a.open(self._file.id, index=i).name.decode() for i in range(h5a.get_num_attrs(self._file.id))
        ]

    def members(self, group: str) -> list[str]:
        """Return the names in a group, sorted; none where there is no such group."""
        if group in self._structure.datasets:
            raise ValueError(f"'{group}' is an array, expected a group")
        return self._structure.groups.get(group, [])

    def arrays_below(self, group: str) -> list[str]:
        """Return the names, within a group, of all arrays in it and in its groups, sorted."""
        head = f"{group}/" if group else ""
        return sorted(name[len(head) :] for name in self._structure.datasets if name.startswith(head))

    def attribute(self, name: str, kind: type, size: int | None = None, *, finite: bool = True) -> Any:
        """Return an attribute of the file: a text, a number, or ``size`` numbers; infinite ones where they may be."""
        raw = name.encode()
        if not h5a.exists(self._file.id, raw):
            raise KeyError(f"attribute '{name}' is missing")
        found = h5a.open(self._file.id, raw)
        wanted = (h5t.STRING,) if kind is str else (h5t.FLOAT, h5t.INTEGER)
        if found.get_type().get_class() not in wanted or found.shape != (() if size is None else (size,)):
            raise ValueError(f"attribute '{name}' is no {'text' if kind is str else 'number'}")
        value = self._file.attrs[name]
        if kind is str:
            return _utf8(value, f"attribute '{name}'")
        numbers = np.asarray(value, dtype=float)
        if kind is float:
            wrong = ~np.isfinite(numbers) if finite else np.isnan(numbers)
        else:
            wrong = ~(np.abs(numbers) < 2.0**63) | (np.trunc(numbers) != numbers)
        if wrong.any():
            raise ValueError(f"attribute '{name}' is {str(value)[:40]}")
        return kind(value) if size is None else tuple(kind(x) for x in value)

    def array(
        self, name: str, *shape: int | str, kind: Kind = "float", finite: bool = True
    ) -> npt.NDArray[Any]:
        """Return an array of numbers; those of kind ``number`` keep their type, others are float64 or int64."""
        dataset = self._dataset(name, shape)
        code = dataset.code
        if code not in _CLASSES[kind]:
            raise ValueError(f"'{name}' holds no numbers of kind {kind}")
        value = np.asarray(self._file[name][()])
        whole = code == h5t.INTEGER
        if whole and value.dtype == np.uint64 and (value > np.iinfo(np.int64).max).any():
            raise ValueError(f"'{name}' holds numbers that are too large")
        if finite and not whole and not np.isfinite(value).all():
            raise ValueError(f"'{name}' holds numbers that are not finite")
        return value.astype(np.int64 if whole else np.float64, copy=False)

    def array_of_any_shape(self, name: str) -> npt.NDArray[np.float64]:
        """Return an array of float64 of which the caller knows the shape."""
        shape = self._structure.datasets[name].shape if name in self._structure.datasets else ()
        return self.array(name, *shape, finite=False)

    def rows(self, name: str, *shape: int | str) -> Any:
        """Return an array of float64 that is read by slices."""
        dataset = self._dataset(name, shape)
        if dataset.code != h5t.FLOAT:
            raise ValueError(f"'{name}' holds no numbers of kind float")
        return self._file[name]

    def texts(self, name: str, *shape: int | str) -> list[str]:
        """Return a list of texts, or of one where the shape is empty."""
        dataset = self._dataset(name, shape)
        if dataset.code != h5t.STRING:
            raise ValueError(f"'{name}' holds no texts")
        self._check_text_lengths(dataset, name)
        found = self._file[name][()]
        return [_utf8(text, f"'{name}'") for text in (found if shape else [found])]

    def text(self, name: str) -> str:
        """Return one text."""
        return self.texts(name)[0]

    def _dataset(self, name: str, shape: tuple[int | str, ...]) -> Stored:
        if name not in self._structure.datasets:
            raise KeyError(f"'{name}' is missing")
        dataset = self._structure.datasets[name]
        found = dataset.shape
        expected = [self.sizes.get(n, n) if isinstance(n, str) else n for n in shape]
        if len(found) != len(expected) or any(
            isinstance(n, int) and n != m for n, m in zip(expected, found, strict=True)
        ):
            wanted = ", ".join(map(str, expected))
            raise ValueError(f"'{name}' has shape {str(found)[:60]}, expected ({wanted})")
        self.sizes |= {n: m for n, m in zip(expected, found, strict=True) if isinstance(n, str)}
        return dataset

    def _check_text_lengths(self, dataset: Stored, name: str) -> None:
        """Check the lengths of texts: their array gives each length and may name one text many times."""
        count, offset = math.prod(dataset.shape), dataset.offset
        most = COMPRESSION * self._structure.size + SPARE
        if not count or not dataset.variable:
            return
        if offset is None:
            if count * self._structure.size > most:
                raise ValueError(f"'{name}' stores its texts as porocore does not")
            return
        with self.path.open("rb") as file:
            file.seek(offset)
            raw = np.frombuffer(file.read(16 * count), dtype=np.dtype("u4,u4,u4,u4"), count=count)
        if int(raw["f0"].astype(np.int64).sum()) > most:
            raise ValueError(f"'{name}' says that its texts are longer than the file")


#: What was found sound before, by path and state of the file: data sets are opened often.
_KNOWN: dict[tuple[Any, ...], Structure] = {}
_MOST_KNOWN = 256


def _examined(file: Any, path: Path) -> Structure:
    stat = os.fstat(file.id.get_vfd_handle())
    key = (str(path), stat.st_ino, stat.st_size, stat.st_mtime_ns)
    if key not in _KNOWN:
        found = examine(file.id, stat.st_size)
        if len(_KNOWN) >= _MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[key] = found
    return _KNOWN[key]


def _utf8(value: Any, where: str) -> str:
    if isinstance(value, bytes):
        try:
            return value.decode("utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"{where} is no UTF-8: {value[:40]!r}") from None
    text = str(value)
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise ValueError(f"{where} is no UTF-8: {text[:40]!r}") from error
    return text


@contextmanager
def opened(path: str | Path, what: str, then: str | None, missing: str | None = None) -> Iterator[Contents]:
    """Open an HDF5 file to read it, after its structure was checked.

    Parameters
    ----------
    path
        Anything: it is opened only if it is an ordinary file.
    what
        What the file should be, such as ``dataset of porocore``.
    then
        What makes it anew, such as ``sample again``; a damaged one is moved out of the way before. None: a user named
        the file, and porocore does not know who made it.
    missing
        What to do if there is none; None: the same.

    Raises
    ------
    DataError
        The file is missing, truncated, damaged or foreign, lacks what is asked for within the block, or is open in
        another program.
    """
    path = Path(path)
    try:
        require_ordinary(path)
        if not check_ends(path):
            require_harmless(path)
        with h5py.File(path, "r") as file:
            yield Contents(file, path)
    except FileNotFoundError as error:
        raise DataError(f"{path}: {error.strerror}; {missing or then or f'expected a {what}'}") from None
    except UNREADABLE as error:
        raise damaged(path, what, error, then) from error


def damaged(path: Path, what: str, error: BaseException, then: str | None) -> DataError:
    """Return the error of a file that does not hold what it should, with the reason in at most 160 characters.

    A file that another program has open, or did not close, is not called damaged; ``then`` is that of :func:`opened`.
    """
    again = "copy it again from where it was made" if then is None else set_aside(path, then)
    if (use := use_elsewhere(path)) == "open":
        return DataError(f"{path}: open in another program, which may write it; close it there and try again")
    if use == "not closed":
        return DataError(
            f"{path}: the program that last wrote it did not close it; if it is open nowhere, {again}"
        )
    no_file = isinstance(error, OSError) and error.strerror  # h5py's own errors have none
    if then is None and (no_file or isinstance(error, NoHdf5Error)):
        return DataError(f"{path}: {reason(error)}; expected a {what}")
    if then is None:
        return DataError(f"{path}: damaged, {reason(error)}; {again}")
    return DataError(f"{path}: not a complete {what} ({reason(error)}); {again}")


def numbered(file: Contents, group: str) -> list[str]:
    """Return the paths of the members ``0``, ``1``, … of a group in this order.

    Raises
    ------
    ValueError
        They are named otherwise, or one is missing.
    """
    names = file.members(group)
    if set(names) != {str(i) for i in range(len(names))}:
        raise ValueError(f"'{group}' holds {', '.join(names)[:80]}, expected 0 … {len(names) - 1}")
    return [f"{group}/{i}" for i in range(len(names))]
