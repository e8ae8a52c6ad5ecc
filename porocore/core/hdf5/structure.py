"""Structure of an open HDF5 file: groups, arrays, storage and filters, complete and of possible size."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from h5py import h5d, h5g, h5l, h5o, h5t, h5z

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
