"""Kinds of files by their first bytes (told_by), whatever their names; the advice to rename one (foreign)."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FileKind:
    """A kind of files.

    Attributes
    ----------
    name
        In a message, such as "a PNG picture".
    suffixes
        Of the names of such files; empty where the content is none that a suffix tells.
    advice
        What to do with it where it cannot be used; empty: nothing is known.
    """

    name: str
    suffixes: tuple[str, ...] = ()
    advice: str = ""


_UNPACK = "unpack it first"
_DOWNLOAD = "fetch the file itself again"
TIFF = FileKind("a TIFF image", (".tif", ".tiff"))
NPY = FileKind("a .npy file of NumPy", (".npy",))
_ZIP = FileKind("a ZIP archive", (".zip", ".npz"), _UNPACK)
_KINDS: tuple[tuple[bytes, FileKind], ...] = (
    (b"\x93NUMPY", NPY),
    (b"II*\0", TIFF),
    (b"MM\0*", TIFF),
    (b"II+\0", TIFF),
    (b"MM\0+", TIFF),
    (b"\x89PNG", FileKind("a PNG picture", (".png",))),
    (b"\xff\xd8\xff", FileKind("a JPEG picture", (".jpg", ".jpeg"))),
    (b"GIF8", FileKind("a GIF picture", (".gif",))),
    (b"NRRD", FileKind("an NRRD image", (".nrrd",))),
    (b"ObjectType", FileKind("a MetaImage", (".mha", ".mhd"))),
    (b"PK\x03\x04", _ZIP),
    (b"PK\x05\x06", _ZIP),
    (b"\x1f\x8b", FileKind("a file packed by gzip", (".gz",), _UNPACK)),
    (b"BZh", FileKind("a file packed by bzip2", (".bz2",), _UNPACK)),
    (b"\xfd7zXZ", FileKind("a file packed by xz", (".xz",), _UNPACK)),
    (b"7z\xbc\xaf", FileKind("a 7-Zip archive", (".7z",), _UNPACK)),
    (b"\x89HDF", FileKind("an HDF5 file", (".h5", ".hdf5", ".med", ".h5m", ".cgns", ".nc"))),
    (b"MATLAB 5.0", FileKind("a file of MATLAB", (".mat",))),
    (b"%PDF", FileKind("a PDF document", (".pdf",))),
    (b"version https://git-lfs", FileKind("a pointer of Git LFS", (), "fetch the file by 'git lfs pull'")),
    (b"$MeshFormat", FileKind("a mesh of gmsh", (".msh",))),
    (b"<VTKFile", FileKind("an XML file of VTK", (".vtu",))),
    (b"# vtk DataFile", FileKind("a legacy file of VTK", (".vtk",))),
    (b"<Xdmf", FileKind("an XDMF file", (".xdmf",))),
    (b"MeshVersionFormatted", FileKind("a mesh of Medit", (".mesh",))),
    (b"ISO-10303-21", FileKind("a STEP geometry", (".step", ".stp"))),
    (b"solid ", FileKind("an STL surface", (".stl",))),
    (b"solid\n", FileKind("an STL surface", (".stl",))),
    (b"ply\n", FileKind("a PLY surface", (".ply",))),
    (b"<!doctype html", FileKind("a web page", (), _DOWNLOAD)),
    (b"<html", FileKind("a web page", (), _DOWNLOAD)),
)
#: Bytes that are looked at.
_LENGTH = 512


def told_by(path: Path) -> FileKind | None:
    """Return the kind of a file that its first bytes tell; None: they tell none.

    Raises
    ------
    OSError
        It cannot be read.
    """
    with path.open("rb") as file:
        begin = file.read(_LENGTH)
    lines = begin.removeprefix(b"\xef\xbb\xbf").lstrip()
    if lines.startswith(b"<?xml"):
        lines = lines.partition(b"?>")[2].lstrip()
    for magic, kind in _KINDS:
        if begin.startswith(magic) or (magic.startswith(b"<") and lines.lower().startswith(magic.lower())):
            return kind
    if begin and not begin.strip(b"\0"):
        return FileKind("a file of zeros alone", (), "copy it again")
    # XML of any kind may begin with comments.
    if begin and not lines.startswith(b"<") and _is_text(begin):
        return FileKind("text")
    return None


def foreign(
    path: Path, wanted: str, usable: Container[str], advice: str, ignored: Container[str] = ()
) -> str | None:
    """Return the complaint about a file whose first bytes contradict its name; None: they do not.

    Parameters
    ----------
    path
        The file.
    wanted
        What its name promises, such as "a TIFF image".
    usable
        Suffixes, such as ".npy", of files that can be used in its place.
    advice
        What to do where the file can neither be renamed nor helped in another way.
    ignored
        Names of kinds that contradict no name.
    """
    if not path.stat().st_size:
        return f"expected {wanted}, got an empty file; {advice}"
    kind = told_by(path)
    if kind is None or kind.name in ignored or path.suffix.lower() in kind.suffixes:
        return None
    then = renamed(path, kind, usable) or kind.advice or advice
    return f"expected {wanted}, got {kind.name} by its first bytes; {then}"


def renamed(path: Path, kind: FileKind | None, usable: Container[str]) -> str:
    """Return the advice to give a file the suffix of its kind; empty where that is not among those that are usable."""
    if kind is None or not kind.suffixes or kind.suffixes[0] not in usable:
        return ""
    return f"rename it to {path.with_suffix(kind.suffixes[0]).name}"


def _is_text(begin: bytes) -> bool:
    try:
        text = begin.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(begin) - 3:
            return False
        text = begin[: error.start].decode("utf-8")
    return all(c.isprintable() or c in "\t\r\n\f" for c in text)
