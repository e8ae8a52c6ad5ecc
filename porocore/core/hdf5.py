"""HDF5 files: written whole or not at all, and read only as far as they are what they should be.

HDF5 may read for ever where a byte was changed, so damage is found here. A file that another program has written or
changed has no seal; HDF5 cuts off what lies behind its data when it writes.

When the operating system refuses a write, HDF5 keeps the half-written file open, tries again at every later
close, and may end in a segmentation fault. So a file is made in memory and reaches the disk as plain bytes, with a
checksum behind them.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import math
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, Literal
from urllib.parse import quote, unquote
from uuid import uuid4

import h5py
import numpy as np
import numpy.typing as npt
from h5py import h5a, h5d, h5g, h5l, h5o, h5t, h5z

from porocore.core.echo import reason
from porocore.core.files.atomic import atomic_path
from porocore.core.files.reading import require_ordinary, set_aside
from porocore.core.parallel.limits import OUT_OF_TIME
from porocore.core.parallel.memory import THREAD_VARIABLES
from porocore.errors import ConfigurationError, DataError

if sys.platform != "win32":
    import fcntl

#: It finds what this process finds, whatever the environment and the folder say.
_COMMAND = "import sys; sys.path[:] = sys.argv[1:]; from porocore.core.hdf5_trial import serve; serve()"
#: An HDF5 library for several processes would take the other one for a part of this run.
_OF_MPI = ("OMPI_", "PMI", "MPI_")


def require_harmless(path: Path) -> None:
    """Check in another process that HDF5 reads all of an ordinary file in bounded time and memory.

    Raises
    ------
    ValueError
        It does not, or the structure is not sound.
    OSError
        There is no such file, or no process can be started.
    """
    found = path.stat()
    if reason := _reason(os.path.abspath(path), found.st_ino, found.st_size, found.st_mtime_ns):
        raise ValueError(reason)


_CRASHED = "HDF5 crashes with it, so it is damaged"


@lru_cache(maxsize=4096)
def _reason(path: str, inode: int, size: int, changed: int) -> str:
    with _LOCK:
        trial = _trial()
        found = trial.ask(path)
        if found == _CRASHED and trial.answers > 1:  # a file before may have done the harm
            found = _trial().ask(path)
    return found


class _Trial:
    """The other process; it ends when this one does, whichever way, or when a file ends it."""

    def __init__(self) -> None:
        self.owner, self.answers = os.getpid(), 0
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-c", _COMMAND, *sys.path],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, encoding="ascii",
            env={name: value for name, value in os.environ.items() if not name.startswith(_OF_MPI)}
            | dict.fromkeys(THREAD_VARIABLES, "1"),
            start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )  # fmt: skip

    def ask(self, path: str) -> str:
        """Return what speaks against reading a file; empty if nothing does."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.answers += 1
        try:
            with suppress(OSError):  # it has ended
                self._process.stdin.write(json.dumps(path) + "\n")
                self._process.stdin.flush()
            if line := self._process.stdout.readline():
                return str(json.loads(line))
        except BaseException:
            # An answer that was not waited for would be taken for the next one.
            self.end()
            raise
        ended = self._process.wait() in OUT_OF_TIME
        self.end()
        return "HDF5 comes to no end with it, so it is damaged" if ended else _CRASHED

    def alive(self) -> bool:
        """Return whether it can be asked by this process, which may be a copy of the one that started it."""
        return self.owner == os.getpid() and self._process.poll() is None

    def end(self) -> None:
        """Stop the process, unless another one started it."""
        if self.owner == os.getpid():
            self._process.kill()
            self._process.communicate()


_LOCK = Lock()
_RUNNING: list[_Trial] = []


def _trial() -> _Trial:
    if not _RUNNING or not _RUNNING[0].alive():
        if not _RUNNING:
            atexit.register(lambda: _RUNNING[0].end())
        _RUNNING[:] = [_Trial()]
    return _RUNNING[0]


SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LABEL = b"\nporocore-sha256:"
_LENGTH = len(_LABEL) + 64
#: Where a superblock of a version says how long the file is: behind which byte.
_END_AT = {0: 40, 1: 44, 2: 28, 3: 28}
_BLOCK = 1 << 20
#: Mark of a file that is being written, in the flags of a superblock from version 2 on.
_WRITTEN = 1


class NoHdf5Error(ValueError):
    """A file that was never one of HDF5, in contrast to a damaged one."""


def seal_of(image: bytes) -> bytes:
    """Return what stands behind the bytes of an HDF5 file."""
    return _LABEL + hashlib.sha256(image).hexdigest().encode()


def check_ends(path: Path) -> bool:
    """Check length and seal of an ordinary file; return whether it has a seal.

    Raises
    ------
    ValueError
        It is no HDF5 file, is cut short or longer than it says, or was changed after it was sealed.
    OSError
        It cannot be read.
    """
    stat = path.stat()
    return _check_ends(str(path), stat.st_ino, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _check_ends(path: str, inode: int, size: int, changed: int) -> bool:
    with open(path, "rb") as file:
        head = file.read(64)
        end = _end_of_data(head)
        if size < end:
            raise ValueError(f"cut short: {size} of {end} bytes")
        if size == end:
            return False
        file.seek(end)
        seal = file.read(_LENGTH + 1)
        if len(seal) != _LENGTH or not seal.startswith(_LABEL):
            raise ValueError("bytes that do not belong to it lie behind its data")
        file.seek(0)
        digest, left = hashlib.sha256(), end
        while left:
            block = file.read(min(left, _BLOCK))
            if not block:
                raise ValueError("cut short while it was read")
            digest.update(block)
            left -= len(block)
    if digest.hexdigest().encode() != seal[len(_LABEL) :]:
        raise ValueError("its bytes do not match its checksum, so it was damaged")
    return True


def use_elsewhere(path: Path) -> Literal["", "open", "not closed"]:
    """Return whether another program has a file open for writing, or did not close it.

    HDF5 locks a file that it writes, and marks it until it is closed; old versions do neither, and some network file
    systems have no locks.
    """
    try:
        require_ordinary(path)  # a pipe would be waited for
        with open(path, "rb") as file:
            head = file.read(64)
            if not head.startswith(SIGNATURE):
                return ""
            if sys.platform != "win32":  # which keeps a locked file from all readers
                fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return "open"
    except OSError:
        return ""
    return "not closed" if len(head) == 64 and head[8] in (2, 3) and head[11] & _WRITTEN else ""


def _end_of_data(head: bytes) -> int:
    """Return the length of the file as its superblock has it."""
    if not head.startswith(SIGNATURE):
        raise NoHdf5Error("no HDF5 file" if head else "an empty file, no HDF5 file")
    version = head[8] if len(head) == 64 else -1
    if version not in _END_AT:
        raise ValueError("an HDF5 superblock that is cut short or of an unknown version")
    sizes = head[13:15] if version < 2 else head[9:11]
    base = _END_AT[version] - 16
    if sizes != b"\x08\x08" or any(head[base : base + 8]):
        raise ValueError("an HDF5 superblock as porocore does not write it")
    return int(struct.unpack_from("<Q", head, _END_AT[version])[0])


#: Groups within groups; bytes of the name of a member, which may stand for one that a user gave (``link_to``).
DEEPEST, LONGEST_NAME = 6, 2400
#: Filters that come with every HDF5 and read no more than they say.
FILTERS = (h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32)
#: What compressed numbers may become larger by; a file that says more is none of results.
COMPRESSION = 64
#: Bytes that even the smallest file may ask for.
SPARE = 1 << 20
#: Bytes in the file of one text of an array of texts: length and place.
_TEXT = 16


@dataclass(frozen=True)
class Stored:
    """An array or texts in a file.

    Attributes
    ----------
    shape
        Shape.
    code
        Class of the type, such as ``h5t.FLOAT``.
    variable
        Texts of any length, each apart from the array.
    offset
        Place of the first byte in the file; None where it lies in pieces.
    """

    shape: tuple[int, ...]
    code: int
    variable: bool
    offset: int | None


@dataclass
class Structure:
    """Members of a file, none of them external, with groups and arrays by path.

    Attributes
    ----------
    size
        Of the file [bytes].
    groups
        Path to the names of the members, sorted; the root is the empty path.
    datasets
        Path to what is known of an array.
    """

    size: int
    groups: dict[str, list[str]] = field(default_factory=dict)
    datasets: dict[str, Stored] = field(default_factory=dict)


def examine(root: Any, size: int) -> Structure:
    """Walk through an open file of ``size`` bytes and check everything that is in it; no number is read.

    Raises
    ------
    ValueError
        Something is external, linked twice, of a kind that porocore does not write, not whole, or larger than the file
        can hold.
    """
    found, seen, asked = Structure(size), set(), 0
    todo: list[tuple[str, Any]] = [("", h5o.open(root, b"/"))]
    while todo:
        path, node = todo.pop()
        place = h5o.get_info(node).addr
        if place in seen:
            raise ValueError(f"'{path}' is linked twice")
        seen.add(place)
        if isinstance(node, h5g.GroupID):
            if path.count("/") >= DEEPEST:
                raise ValueError(f"groups within groups: '{path}'")
            found.groups[path] = sorted(_members(node, path))
            for name in found.groups[path]:
                below = f"{path}/{name}" if path else name
                todo.append((below, h5o.open(node, name.encode())))
        elif isinstance(node, h5d.DatasetID):
            asked += _check_storage(node, path, size)
            if asked > COMPRESSION * size + SPARE:
                raise ValueError(f"its arrays ask for more memory than a file of {size} bytes can hold")
            kind = node.get_type()
            code = kind.get_class()
            variable = code == h5t.STRING and bool(kind.is_variable_str())
            found.datasets[path] = Stored(tuple(map(int, node.shape)), code, variable, node.get_offset())
        else:
            raise ValueError(f"'{path}' is neither a group nor an array")
    return found


def _members(group: Any, path: str) -> list[str]:
    raw: list[bytes] = []
    group.links.iterate(raw.append)
    names = []
    for name in raw:
        try:
            text = name.decode("utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"a name in '{path}' is no UTF-8: {name[:40]!r}") from None
        if len(name) > LONGEST_NAME or not text.isprintable():
            raise ValueError(f"a name in '{path}' is none that porocore writes: {text[:40]!r}")
        if group.links.get_info(name).type != h5l.TYPE_HARD:
            raise ValueError(f"'{path}/{text}' is a link to elsewhere".replace("'/", "'"))
        names.append(text)
    return names


def _check_storage(dataset: Any, path: str, size: int) -> int:
    """Check that an array lies in the file and is whole; return how many bytes it takes in memory."""
    created = dataset.get_create_plist()
    layout = created.get_layout()
    if layout == h5d.VIRTUAL or created.get_external_count():
        raise ValueError(f"'{path}' holds its numbers in other files")
    kind = dataset.get_type()
    if kind.get_class() not in (h5t.FLOAT, h5t.INTEGER, h5t.STRING):
        raise ValueError(f"'{path}' holds neither numbers nor texts")
    shape = dataset.shape
    if shape is None or len(shape) > 6:
        raise ValueError(f"'{path}' has no shape, or too many axes")
    text = kind.get_class() == h5t.STRING and kind.is_variable_str()
    item = _TEXT if text else int(kind.get_size())
    needed = math.prod(map(int, shape)) * item
    packed = _filters(created, path)
    stored = int(dataset.get_storage_size())
    if stored > size:
        raise ValueError(f"'{path}' says that it is larger than the file")
    if layout == h5d.CHUNKED:
        _check_chunks(dataset, created, path, shape, item, size)
    if needed > (COMPRESSION * stored if packed else stored):
        raise ValueError(f"'{path}' of shape {_short(shape)} is not whole: {stored} bytes of {needed}")
    return needed


def _check_chunks(dataset: Any, created: Any, path: str, shape: Any, item: int, size: int) -> None:
    chunk = created.get_chunk()
    if math.prod(chunk) * item > max(COMPRESSION * size, SPARE):
        raise ValueError(f"'{path}' is stored in pieces larger than the file")
    pieces = math.prod(-(-int(n) // int(c)) for n, c in zip(shape, chunk, strict=True))
    if pieces != dataset.get_num_chunks():
        raise ValueError(f"'{path}' of shape {_short(shape)} is not whole: pieces are missing")


def _filters(created: Any, path: str) -> bool:
    """Return whether an array is compressed; refuse filters that are not everywhere."""
    found = [created.get_filter(i)[0] for i in range(created.get_nfilters())]
    if any(code not in FILTERS for code in found):
        raise ValueError(f"'{path}' is stored with a filter that porocore does not use")
    return h5z.FILTER_DEFLATE in found


def _short(shape: Any) -> str:
    return str(tuple(map(int, shape)))[:80]


#: By format, what a file is that porocore writes, and what reads it.
KINDS = {
    "porocore-dataset": ("a data set of solved states", "'porocore data' reads it"),
    "porocore-surrogate": (
        "a trained surrogate",
        "'porocore solve RUN' reads it in its run folder, and the report has its accuracy",
    ),
    "porocore-surrogate-training": (
        "the checkpoint of a training",
        "'porocore train RUN' reads it in its run folder",
    ),
    "porocore-solution": (
        "the solution of a body",
        "'porocore report RUN' reads it in its run folder, as does porocore.MacroSolution.load_file",
    ),
    "porocore-macro-checkpoint": (
        "the checkpoint of a solve",
        "'porocore solve RUN' reads it in its run folder",
    ),
    "porocore-stability": ("a stability map", "'porocore stability --resume' reads it in its folder"),
    "porocore-sensitivity": (
        "a sensitivity study",
        "'porocore sensitivity' and porocore.commands.sensitivity.results.load read it",
    ),
}
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

    def __init__(self, file: Any, path: Path, stat: os.stat_result) -> None:
        self.path, self.sizes = path, dict[str, int]()
        self._file, self._structure = file, _examined(file, path, stat)

    def __contains__(self, name: str) -> bool:
        return name in self._structure.datasets or name in self._structure.groups

    def require_kind(self, form: str) -> None:
        """Refuse a file that porocore wrote for something else, of which nothing has to be made anew.

        Raises
        ------
        DataError
            It is of another format of :data:`KINDS`; the message says what it is and what reads it.
        """
        found = self.attribute("format", str) if "format" in self.attributes else ""
        if found != form and {found, form} <= KINDS.keys():
            kind, reader = KINDS[found]
            raise DataError(
                f"{self.path}: expected {KINDS[form][0]}, got {kind}, which is undamaged; {reader}"
            )

    def is_of(self, form: str, version: int) -> bool:
        """Return whether the file says that it is of a format and version; see :meth:`require_kind`."""
        self.require_kind(form)
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

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array; () where there is none."""
        return self._structure.datasets[name].shape if name in self._structure.datasets else ()

    def array_of_any_shape(self, name: str) -> npt.NDArray[np.float64]:
        """Return an array of float64 of which the caller knows the shape."""
        return self.array(name, *self.shape(name), finite=False)

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


def _examined(file: Any, path: Path, stat: os.stat_result) -> Structure:
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
        stat = path.stat()  # not that of HDF5's handle, which has no meaning here on Windows
        with h5py.File(path, "r") as file:
            yield Contents(file, path, stat)
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
    # HDF5 distinguishes files in memory by their names.
    with h5py.File(f"{path.name}-{uuid4()}", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with atomic_path(path) as part, part.open("wb") as whole:
        whole.write(image)
        whole.write(seal_of(image))


__all__ = ["UNREADABLE", "Contents", "Kind", "atomic_hdf5", "damaged", "opened"]
