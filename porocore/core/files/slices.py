"""Stacks of slices in a folder, and kinds of files by their first bytes."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Container
from dataclasses import dataclass
from fnmatch import fnmatchcase
from glob import escape
from itertools import pairwise
from pathlib import Path

from porocore.core.echo import echo_path
from porocore.core.files import metaimage
from porocore.core.files.reading import obstacle

_NUMBER = re.compile("([0-9]+)")
#: Names that are listed of many.
MOST_NAMES = 5


@dataclass(frozen=True)
class Slices:
    """Files of one stack.

    Attributes
    ----------
    files
        By ascending numbers, such that 2 is before 10.
    left_out
        Names of other files at the same place.
    by_position
        True for DICOM files, which state where they are; their names need to have no numbers.
    """

    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    by_position: bool = False

    @classmethod
    def at(cls, path: Path, suffixes: tuple[str, ...]) -> Slices | None:
        """Return the slices of a folder, or those whose names match a pattern such as ``slices/*.tif``.

        None: the path leads to neither.

        Raises
        ------
        ValueError
            There is no file with one of the suffixes, or those that are there are not one stack.
        """
        whole = os.path.isdir(path)
        if not whole and (os.path.lexists(path) or not has_signs(path)):
            return None
        folder, place = path if whole else path.parent, echo_path(path)
        try:
            present = sorted(name for name in os.listdir(folder) if not name.startswith("."))
        except OSError as error:
            fault = obstacle(folder) or "no such folder" if not folder.is_dir() else error.strerror
            raise ValueError(f"{echo_path(folder)}: {fault}") from None
        matching = [name for name in present if whole or fnmatchcase(name, path.name)]
        ordinary = [name for name in matching if (folder / name).is_file()]
        found = [name for name in ordinary if name.lower().endswith(suffixes)]
        if not found and DICOM.suffixes[0] in suffixes:  # scanners often write names without a suffix
            found = [name for name in ordinary if _is_dicom(folder / name)]
        by_position = bool(found) and not any(
            name.lower().endswith((*NPY.suffixes, *TIFF.suffixes)) for name in found
        )
        if not found:
            expected = f"expected slices as {', '.join(suffixes)}"
            kinds = _kinds(folder, matching or present)
            if whole or matching:
                whole_image = next((name for name in ordinary if name.lower().endswith(WHOLE)), None)
                then = f"write the path of {whole_image} itself" if whole_image else "save the slices as TIFF"
                raise ValueError(f"{place}: {expected}, got {kinds}; {then}")
            raise ValueError(
                f"{place}: {expected}, got no name of this pattern in a folder of {kinds}; check the pattern"
            )
        if not by_position:
            _require_one_stack(place, folder, found)
        files = tuple(folder / name for name in sorted(found, key=_numbers))
        return cls(files, tuple(name for name in matching if name not in set(found)), by_position)

    @property
    def gaps(self) -> str:
        """A sentence on numbers that are missing between the first and the last; empty where none are."""
        if self.by_position:
            return ""
        columns = [set(column) for column in zip(*(_numbers(file.name) for file in self.files), strict=True)]
        # Of a name with two numbers that change, such as a time and a count, neither needs to be without gaps.
        changing = [sorted(column) for column in columns if len(column) > 1]
        if len(changing) != 1:
            return ""
        step = min(following - number for number, following in pairwise(changing[0]))
        jumps = [(n + step, m - step) for n, m in pairwise(changing[0]) if m - n > step]
        if not jumps:
            return ""
        told = ", ".join(f"{n} to {m}" if n < m else f"{n}" for n, m in jumps[:MOST_NAMES])
        return (
            f"slices are missing between {self.files[0].name} and {self.files[-1].name}, numbered {told}"
            f"{', …' if jumps[MOST_NAMES:] else ''}; those beside a gap are taken for neighbours: add what is missing"
        )

    @property
    def summary(self) -> str:
        """A sentence on the slices along z, and on files that are left out."""
        order = (
            "by their positions"
            if self.by_position
            else f"from {self.files[0].name} to {self.files[-1].name}"
        )
        told = f"{len(self.files)} slices along z, {order}"
        if not self.left_out:
            return told
        names = ", ".join(self.left_out[:MOST_NAMES]) + (", …" if self.left_out[MOST_NAMES:] else "")
        return f"{told}; left out: {names}"


def has_signs(path: Path) -> bool:
    """Return True if a name has signs of a pattern."""
    return any(sign in path.name for sign in "*?[")


def _require_one_stack(place: str, folder: Path, names: list[str]) -> None:
    """Refuse names that differ in more than their numbers, or in no number."""
    kinds = Counter(_NUMBER.sub("#", name) for name in names)
    if len(kinds) > 1:
        told = ", ".join(f"{kind} ({count})" for kind, count in kinds.most_common(MOST_NAMES))
        first = next(name for name in names if _NUMBER.sub("#", name) == kinds.most_common(1)[0][0])
        pattern = "[0-9]*".join(map(escape, _NUMBER.split(first)[::2]))
        then = (
            f"choose by a pattern of names, such as 'path: {folder}/{pattern}'"
            if max(kinds.values()) > 1
            else "number them along z, such as slice_001.tif"
        )
        raise ValueError(
            f"{place}: expected the slices of one stack, whose names differ in their numbers alone, got "
            f"{told}{', …' if len(kinds) > MOST_NAMES else ''}; {then}"
        )
    by_number: dict[tuple[int, ...], str] = {}
    for name in names:
        if (other := by_number.setdefault(_numbers(name), name)) != name:
            raise ValueError(
                f"{place}: expected one slice of each number, got {other} and {name}; remove one"
            )


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(map(int, _NUMBER.findall(name)))


def _is_dicom(path: Path) -> bool:
    try:
        return path.name.upper() != "DICOMDIR" and told_by(path) is DICOM
    except OSError:
        return False


def _kinds(folder: Path, names: list[str]) -> str:
    """Return how many files of each kind there are."""
    counts = Counter(
        "folder" if (folder / n).is_dir() else Path(n).suffix or "without a suffix" for n in names
    )
    return ", ".join(f"{count} {kind}" for kind, count in counts.most_common(MOST_NAMES)) or "no files"


@dataclass(frozen=True)
class FileKind:
    """A kind of files.

    Attributes
    ----------
    name
        In a message, such as "a PNG picture".
    suffixes
        Of the names of such files; empty where no suffix belongs to the content.
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
DICOM = FileKind("a DICOM file", (".dcm",))
META = FileKind("a MetaImage", metaimage.SUFFIXES)
NIFTI = FileKind("a NIfTI image", (".nii", ".nii.gz"))
NRRD = FileKind("an NRRD image", (".nrrd",))
#: Endings of files that are whole images of three dimensions, read by SimpleITK.
WHOLE = (*META.suffixes, *NIFTI.suffixes, *NRRD.suffixes)
#: Kinds by bytes at a place inside.
_WITHIN: tuple[tuple[int, bytes, FileKind], ...] = ((128, b"DICM", DICOM), (344, b"n+1\0", NIFTI))
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
    (b"NRRD", NRRD),
    (b"ObjectType", META),
    (b"PK\x03\x04", _ZIP),
    (b"PK\x05\x06", _ZIP),
    (b"\x1f\x8b", FileKind("a file packed by gzip", (".gz",), _UNPACK)),
    (b"BZh", FileKind("a file packed by bzip2", (".bz2",), _UNPACK)),
    (b"\xfd7zXZ", FileKind("a file packed by xz", (".xz",), _UNPACK)),
    (b"7z\xbc\xaf", FileKind("a 7-Zip archive", (".7z",), _UNPACK)),
    (b"\x89HDF", FileKind("an HDF5 file", (".h5", ".hdf5", ".med", ".h5m", ".cgns", ".nc"))),
    (b"MATLAB 5.0", FileKind("a file of MATLAB", (".mat",))),
    (b"%PDF", FileKind("a PDF document", (".pdf",))),
    (b"\xd0\xcf\x11\xe0", FileKind("a document of an older Office", (".xls", ".doc"))),
    (b"\x7fELF", FileKind("a program")),
    (b"MZ", FileKind("a program")),
    (b"version https://git-lfs", FileKind("a pointer of Git LFS", (), "fetch the file by 'git lfs pull'")),
    (b"$MeshFormat", FileKind("a mesh of gmsh", (".msh",))),
    (
        b'<VTKFile type="Collection"',
        FileKind("a collection of ParaView", (".pvd",), "give a file that it names"),
    ),
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
    for place, magic, kind in _WITHIN:
        if begin[place : place + len(magic)] == magic:
            return kind
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
