"""Text of a file of measured data (decoded_text): its encoding, given or found."""

from __future__ import annotations

import codecs
from pathlib import Path

from porocore.core.echo import echo, echo_path
from porocore.core.files.reading import LARGEST_TEXT, require_ordinary
from porocore.errors import ConfigurationError

#: First bytes of a text, and its encoding; those of UTF-32 begin like those of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
#: First bytes of files that are no text, and what they are.
_OTHERS = (
    (b"PK\x03\x04", "an Excel workbook or another ZIP archive"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook"),
    (b"%PDF", "a PDF"),
    (b"\x89HDF", "an HDF5 file"),
)
#: Latin-1 with the quotation marks of Windows, taken where a text is no UTF-8.
GUESS = "Windows-1252"


def decoded_text(path: Path, encoding: str | None = None) -> tuple[str, str]:
    """Return the text of a file without a mark of its encoding, and the encoding where it is a guess.

    Without ``encoding`` it is that of the mark at the beginning, or UTF-16 where every other byte is zero, or UTF-8,
    or else Windows-1252, of which Latin-1 is a part. Digits, signs and separators are the same in all encodings of one
    byte a letter, so a wrong guess changes letters of headings and units, and no number.

    Parameters
    ----------
    path
        The file.
    encoding
        Python's name of the encoding; None: it is found.

    Returns
    -------
    text, guess
        ``guess`` is empty where the encoding is certain.

    Raises
    ------
    ConfigurationError
        The file cannot be read, is no text, or is not in the encoding.
    """
    data = _data(path)
    for begin, kind in _OTHERS:
        if data.startswith(begin):
            raise ConfigurationError(f"{path}: expected a CSV file, got {kind}; save the table as CSV")
    marked = next(((mark, name) for mark, name in _MARKS if data.startswith(mark)), None)
    if marked is not None:
        mark, name = marked
        if encoding is not None and not _is_same(encoding, name):
            raise ConfigurationError(
                f"encoding: expected {_family(name)}, by the first bytes of {path}, got {echo(encoding)}; "
                "remove the key"
            )
        return _decoded(path, data[len(mark) :], name), ""
    if encoding is not None:
        return _decoded(path, data, encoding), ""
    if b"\0" in data:
        return _decoded(path, data, _utf_16(path, data)), ""
    try:
        return data.decode("utf-8"), ""
    except UnicodeDecodeError:
        return _decoded(path, data, "cp1252"), GUESS


def _is_same(encoding: str, marked: str) -> bool:
    """Return whether a text in an encoding may begin with the mark of another, as utf-16 with that of utf-16-le."""
    name = codecs.lookup(encoding).name.removesuffix("-sig")
    return name in (marked, _family(marked))


def _family(name: str) -> str:
    """Return the name of an encoding without the order of its bytes."""
    return name.removesuffix("-le").removesuffix("-be")


def _data(path: Path) -> bytes:
    try:
        require_ordinary(path, LARGEST_TEXT)
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{echo_path(path)}: {error.strerror}; give the CSV file of the curve"
        ) from None
    except IsADirectoryError:
        raise ConfigurationError(f"{echo_path(path)}: expected a CSV file, got a folder") from None
    except OSError as error:
        raise ConfigurationError(f"{echo_path(path)}: cannot be read: {error.strerror or error}") from None


def _utf_16(path: Path, data: bytes) -> str:
    """Return the encoding of a text with zero bytes and no mark."""
    zeros = data[::2].count(0), data[1::2].count(0)
    if len(data) % 2 == 0 and min(zeros) == 0 and max(zeros) > 0.3 * len(data) / 2:
        return "utf-16-le" if zeros[0] == 0 else "utf-16-be"
    line = data[: data.index(b"\0")].count(b"\n") + 1
    raise ConfigurationError(
        f"{path}:{line}: expected text, got a null byte, which is part of no text; save the table as CSV again"
    )


def _decoded(path: Path, data: bytes, encoding: str) -> str:
    try:
        return data.decode(encoding).removeprefix("\ufeff")
    except UnicodeError as error:
        before = data[: getattr(error, "start", 0)].decode(encoding, errors="replace")
        line = len(f"{before}.".splitlines())
        wanted = (
            "UTF-8, UTF-16 or Windows-1252 (Latin-1)" if encoding == "cp1252" else f"the encoding {encoding}"
        )
        raise ConfigurationError(
            f"{path}:{line}: expected text in {wanted}, got bytes that are none; name the encoding with 'encoding:', "
            "such as cp850 or mac-roman, or save the file as UTF-8"
        ) from None
