"""Reading of image files, their grey values, removal of islands; smooth level set (SmoothImage)."""

from __future__ import annotations

import logging
import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from porocore.cell.level_sets import volumes
from porocore.cell.level_sets.grey_values import whole
from porocore.core.files.slices import DICOM, NIFTI, NPY, TIFF, FileKind, Slices, foreign, renamed, told_by
from porocore.errors import ConfigurationError
from porocore.states import Array, BoolArray, IntArray

#: Sizes that a note names; further ones are counted.
NAMED = 4


@dataclass(frozen=True, eq=False)
class Cleaned:
    """An image without what was to be removed, and the sizes of that in voxels, the largest first.

    Attributes
    ----------
    solid
        True for solid voxels, after cleaning.
    grains, filled
        Grains of the solid that became pores, and closed pores that became solid.
    periodic
        True where opposite sides of the image touch, as pieces of one cell do.
    """

    solid: BoolArray
    grains: tuple[int, ...]
    filled: tuple[int, ...]
    periodic: bool

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was removed and on grains that float."""
        share = 100 / self.solid.size
        notes = []
        if self.grains:
            notes.append(
                f"{_pieces(self.grains, 'grain')} of the solid dropped, {sum(self.grains) * share:.3g} % of the image"
            )
        if self.filled:
            notes.append(
                f"{_pieces(self.filled, 'pore')} filled, {sum(self.filled) * share:.3g} % of the image"
            )
        if floating := _sizes(labelled(self.solid, periodic=self.periodic))[1:]:
            notes.append(
                f"{_pieces(floating, 'grain')} of the solid without contact to the rest, face to face; "
                "cell.geometry.drop_grains: true makes pores of them"
            )
        return tuple(notes)


def clean(solid: BoolArray, *, periodic: bool, drop_grains: bool, fill_pores: int) -> Cleaned:
    """Return an image without the grains that float, if wanted, and without pores of at most ``fill_pores`` voxels.

    Voxels with a common face belong to one piece, across the sides of a periodic image too.
    """
    grains: tuple[int, ...] = ()
    filled: tuple[int, ...] = ()
    if drop_grains:
        labels = labelled(solid, periodic=periodic)
        grains = _sizes(labels)[1:]
        if grains:
            solid = labels == 1 + int(np.bincount(labels.ravel())[1:].argmax())
    if fill_pores:
        labels = labelled(~solid, periodic=periodic)
        counts = np.bincount(labels.ravel())
        small = (counts <= fill_pores) & (np.arange(len(counts)) > 0)
        filled = tuple(sorted(map(int, counts[small]), reverse=True))
        solid = solid | small[labels]
    return Cleaned(solid, grains, filled, periodic)


def labelled(mask: BoolArray, *, periodic: bool) -> IntArray:
    """Return the number of the piece of each voxel, from 1; 0 outside of the mask."""
    from scipy.ndimage import label  # slow to import
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    labels, count = label(mask)
    if not periodic or count < 2:
        return np.asarray(labels)
    pairs = across(labels)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    return np.asarray(np.concatenate([[0], piece + 1])[labels])


def across(labels: IntArray) -> IntArray:
    """Return the pieces that meet across the sides of a periodic image, and the cell of the second, (L, 5)."""
    found = []
    for axis in range(3):
        pairs = np.stack([np.take(labels, -1, axis), np.take(labels, 0, axis)], axis=-1).reshape(-1, 2)
        pairs = np.unique(pairs[(pairs > 0).all(axis=1)], axis=0) - 1
        found.append(np.column_stack([pairs, np.tile(np.eye(3, dtype=np.int64)[axis], (len(pairs), 1))]))
    return np.concatenate(found)


def _sizes(labels: IntArray) -> tuple[int, ...]:
    """Return the voxels of each piece, the largest first."""
    return tuple(sorted(map(int, np.bincount(labels.ravel())[1:]), reverse=True))


def _pieces(sizes: tuple[int, ...], what: str) -> str:
    shown = ", ".join(f"{size:,}" for size in sizes[:NAMED]) + (", …" if len(sizes) > NAMED else "")
    voxels = "voxel" if sizes == (1,) else "voxels"
    return f"{len(sizes)} {what}{'s' if len(sizes) > 1 else ''} ({shown} {voxels})"


Crop = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
#: Limits on the voxels along an edge of the image.
SMALLEST, LARGEST = 4, 400
#: Limit on the voxels of an image of which a part is used.
MOST = 1_000_000_000
#: Voxels along an edge above which the share below a level is computed from one point a voxel instead of eight.
MANY = 96
KINDS = (NPY, TIFF, *volumes.KINDS)
SUFFIXES = tuple(suffix for kind in KINDS for suffix in kind.suffixes)
#: What voxels alone may look like by their first bytes.
BARE = ("text", "a file of zeros alone")
#: Of files that may be slices.
SLICE_SUFFIXES = (*NPY.suffixes, *TIFF.suffixes, *DICOM.suffixes)
#: Units of the resolution of a TIFF by their code; 1 is none.
RESOLUTION_UNITS = {2: "in", 3: "cm"}
#: Dots per inch that programs write for screens and paper, which say nothing about a voxel.
OF_PAGES = (72, 96, 100, 150, 200, 240, 300, 600)
#: Compressions of a TIFF that lose values, by tifffile's names.
JPEG = ("JPEG", "OJPEG", "JPEG_LOSSY", "JPEG_2000_LOSSY")
#: Pages of a TIFF that are looked at.
MOST_PAGES = 1_000_000
SAVE = "save the image as a TIFF stack, or by numpy.save as an array of numbers with the axes x, y, z"
_NUMBERS = "convert it, as by image.astype(numpy.uint8), and save it anew"
#: Types of values by numpy's letter of them, and what to do with those that are none of an image.
TYPES = {
    "c": "complex numbers", "O": "Python objects", "U": "texts", "S": "texts",
    "M": "dates", "m": "times", "V": "records",
}  # fmt: skip
REMEDIES = {
    "c": "save one real number for each voxel, such as numpy.abs(image)",
    "O": _NUMBERS, "U": _NUMBERS, "S": _NUMBERS, "V": "save one field of the records alone",
}  # fmt: skip


def read_image(path: Path, crop: Crop | None = None, *, grey: bool = False) -> npt.NDArray[Any]:
    """Return the values of the voxels, with indices along x, y and z, of a part of the image or of all of it.

    A .npy file holds this array; the pages of a TIFF stack lie along z, its rows along y and its columns along x. So
    do the files of a folder of slices, or of a pattern of names, by ascending numbers, those of DICOM by their
    positions. Of other files x is the axis that is stored fastest, and z the slowest, whatever directions they state.
    Values of a ``grey`` image may be any numbers, else they are whole.

    Raises
    ------
    ConfigurationError
        The file is no image with whole numbers, or the part is not within it.
    """
    found = _read(path, lambda shape, dtype: _check(path, shape, dtype, crop), crop)
    if not grey:
        _require_whole(path, found)
    exact = np.issubdtype(found.dtype, np.integer) or (grey and found.dtype != bool)
    return found if exact else found.astype(np.int64)


def open_image(path: Path, *, grey: bool = False) -> npt.NDArray[Any]:
    """Return the values of all voxels of an image of any size, any numbers where it is ``grey``.

    Those of a .npy file are read when they are looked at.

    Raises
    ------
    ConfigurationError
        As :func:`read_image`, but for the limits on the edges.
    """
    found = _read(path, lambda shape, dtype: _check_kind(path, shape, dtype), None)
    if not grey:
        _require_whole(path, found)
    return found


def kind_of(path: Path) -> FileKind | None:
    """Return the kind of an image that the ending of its name tells, and that of slices; None: it is none."""
    if (slices := _slices(path)) is not None:
        path = slices.files[0]
        if slices.by_position:
            return DICOM
    return next((kind for kind in KINDS if path.name.lower().endswith(kind.suffixes)), None)


def _read(path: Path, check: Callable[[tuple[int, ...], Any], None], crop: Crop | None) -> npt.NDArray[Any]:
    slices, kind = _slices(path), kind_of(path)
    if slices is not None and not slices.by_position:
        return _read_slices(path, slices.files, check, crop)
    if kind is None:
        told, suffix = told_by(path), path.suffix.lower()
        then = renamed(path, told, SUFFIXES) or SAVE
        if told is None or told.name in BARE:
            told = None
            then = (
                f"{then}, or, if its voxels stand in it one after the other, give the path of a text file "
                f"{path.stem}.mhd beside it, with the lines {volumes.header_for(path)}"
            )
        got = f"'{path.suffix}'" if suffix else "a file without a suffix"
        raise ConfigurationError(
            f"{path}: expected an image as {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, got {got}"
            + (f", {told.name} by its first bytes" if told else "")
            + f"; {then}"
        )
    # The header of a MetaImage is text, and what ends in .nii.gz is read whether it is packed or not.
    if slices is None and (
        complaint := foreign(
            path, kind.name, SUFFIXES, SAVE, ("text", NIFTI.name) if kind in volumes.KINDS else ()
        )
    ):
        raise ConfigurationError(f"{path}: {complaint}")
    try:
        if slices is not None:
            return _part(volumes.read_series(path, slices.files, check), crop)
        if kind in volumes.KINDS:
            return _part(volumes.read(path, kind, check), crop)
        return (_read_npy if kind is NPY else _read_tiff)(path, check, crop)
    except ConfigurationError:
        raise
    except Exception as error:  # readers raise any kind of error on a damaged file
        raise ConfigurationError(
            f"{path}: not an image that can be read: expected {kind.name}, got one that is damaged or cut short; copy "
            f"it again, or {SAVE}"
        ) from error


def _slices(path: Path) -> Slices | None:
    try:
        return Slices.at(path, SLICE_SUFFIXES)
    except ValueError as error:
        raise ConfigurationError(str(error)) from None


def _read_slices(
    path: Path, files: tuple[Path, ...], check: Callable[[tuple[int, ...], Any], None], crop: Crop | None
) -> npt.NDArray[Any]:
    """Read files of one slice each as the pages of a stack."""
    kinds: list[tuple[tuple[int, ...], str]] = []

    def check_slice(shape: tuple[int, ...], dtype: Any) -> None:
        name = files[len(kinds)].name
        if len(shape) != 2:
            raise ConfigurationError(
                f"{path}: expected one slice in each file, got {name} of the shape {' x '.join(map(str, shape))}; "
                "write the path of a file that is a whole stack itself"
            )
        kinds.append((shape, "values of an unknown type" if dtype is None else dtype.name))
        if kinds[-1] != kinds[0]:
            (got, kind), (expected, first) = kinds[-1], kinds[0]
            raise ConfigurationError(
                f"{path}: expected slices of one size and kind, got {name} of {got[0]} x {got[1]} {kind} along x, y, "
                f"where {files[0].name} has {expected[0]} x {expected[1]} {first}; export it anew, or leave it out"
            )
        check((*shape, len(files)), dtype)

    pages = []
    for file in files:
        try:
            pages.append(_read(file, check_slice, None).T)
        except ConfigurationError as error:
            raise ConfigurationError(str(error).replace(f"{file}: ", f"{path}: {file.name}: ", 1)) from None
    return np.asarray(_part(np.stack(pages).T, crop))


def _read_npy(
    path: Path, check: Callable[[tuple[int, ...], Any], None], crop: Crop | None
) -> npt.NDArray[Any]:
    """Read an array after a check of its header."""
    npy: Any = np.lib.format
    with path.open("rb") as file:
        version = npy.read_magic(file)
        if version not in ((1, 0), (2, 0)):
            raise ConfigurationError(
                f"{path}: expected a .npy file of version 1.0 or 2.0, got {version[0]}.{version[1]}; {SAVE}"
            )
        first = version == (1, 0)
        read = npy.read_array_header_1_0 if first else npy.read_array_header_2_0
        shape, _, dtype = read(file)
        begin = file.tell()
    check(shape, dtype)
    missing = begin + math.prod(shape) * dtype.itemsize - path.stat().st_size
    if missing > 0:
        raise ConfigurationError(
            f"{path}: the file is cut off, {missing:,} bytes of its {' x '.join(map(str, shape))} voxels are missing; "
            "copy it again"
        )
    return np.asarray(_part(np.load(path, mmap_mode="r", allow_pickle=False), crop))


def _read_tiff(
    path: Path, check: Callable[[tuple[int, ...], Any], None], crop: Crop | None
) -> npt.NDArray[Any]:
    """Read a stack of pages, z leading, after a check of its header."""
    import tifffile

    _require_all_pages(path)
    with _opened(path) as file:
        stacks = file.series
        first = stacks[0]
        # A stack of four columns is distinguished by its rows.
        if first.axes.endswith("S") and (first.ndim > 3 or max(first.shape) > first.shape[-1]):
            raise ConfigurationError(
                f"{path}: expected one value in every voxel, got an image in colour with {first.shape[-1]}; save it in "
                "grey, in ImageJ by Image > Type > 8-bit"
            )
        _require_equal_pages(path, stacks)
        shape = first.shape
        if len(stacks) > 1:
            if shape[2:] or any((each.shape, each.dtype) != (shape, first.dtype) for each in stacks):
                counts = Counter(" x ".join(map(str, each.shape)) for each in stacks)
                shapes = " and ".join(f"{n} of {shape}" for shape, n in counts.most_common(3))
                raise ConfigurationError(
                    f"{path}: expected one stack of pages of one size, got {len(stacks)} stacks, {shapes}; "
                    "save the one that is meant in a file of its own"
                )
            shape = (len(stacks), *shape)  # written page by page
        check(shape[::-1], first.dtype)
        compression = first.keyframe.compression
        if compression not in tifffile.TIFF.DECOMPRESSORS:
            lossy = "; JPEG changes the values beside the walls" if "JPEG" in compression.name else ""
            raise ConfigurationError(
                f"{path}: cannot be read, since it is compressed by {compression.name}: pip install imagecodecs, or "
                f"save it without compression or with Deflate{lossy}"
            )
        _require_data(path, stacks)
        pages = np.stack([each.asarray() for each in stacks]) if len(stacks) > 1 else first.asarray()
        return np.asarray(_part(np.asarray(pages).T, crop))


def _require_all_pages(path: Path) -> None:
    """Refuse a TIFF whose chain of pages leaves the file; tifffile reads those before the end as if they were all."""
    size = path.stat().st_size
    with path.open("rb") as file:
        begin = file.read(16)
        order: Literal["little", "big"] = "little" if begin[:2] == b"II" else "big"
        big = int.from_bytes(begin[2:4], order) == 43
        word, entry, first, count = (8, 20, 8, 8) if big else (4, 12, 4, 2)
        place, seen = int.from_bytes(begin[first : first + word], order), set[int]()
        while place and place not in seen and len(seen) <= MOST_PAGES:
            seen.add(place)
            file.seek(place)
            end = place + count + entry * int.from_bytes(file.read(count), order)
            if end + word > size:
                raise ConfigurationError(
                    f"{path}: the file is cut off: it ends at byte {size:,}, before page {len(seen)}; copy it again"
                )
            file.seek(end)
            place = int.from_bytes(file.read(word), order)
    if not seen:
        raise ConfigurationError(f"{path}: expected a TIFF image, got one without a page; {SAVE}")


def _require_equal_pages(path: Path, stacks: Any) -> None:
    """Refuse a TIFF with a page unlike the first one; within a stack tifffile takes the first one's size for all."""
    with _opened(path) as file:
        # Read one by one; those of a stack repeat what its first one says.
        whole = file.pages
        first = whole[0]
        for stack in stacks:
            pages = [
                whole[each.index] for each in stack.pages if isinstance(getattr(each, "index", None), int)
            ]
            for page in pages:
                if (page.shape, page.dtype) != (first.shape, first.dtype):
                    fault = f"with {_page(page)} where page 1 has {_page(first)}"
                elif page.photometric != first.photometric:
                    fault = "with another tag PhotometricInterpretation than page 1"
                elif page.hash != pages[0].hash:
                    fault = f"with another compression or layout than page {pages[0].index + 1}"
                else:
                    continue
                raise ConfigurationError(
                    f"{path}: expected pages of one size and kind, got page {page.index + 1} (of {len(whole)}) "
                    f"{fault}; export the stack anew, or leave that page out"
                )


def _page(page: Any) -> str:
    values = "an unknown type" if page.dtype is None else page.dtype.name
    return f"{' x '.join(map(str, page.shape))} values of {values}"


def _require_data(path: Path, stacks: Any) -> None:
    """Refuse a TIFF whose values lie beyond its end."""
    size = path.stat().st_size
    ends = [
        place + length
        for stack in stacks
        for page in stack.pages
        if page is not None and hasattr(page, "dataoffsets")
        for place, length in zip(page.dataoffsets, page.databytecounts, strict=False)
    ]
    ends += [each.dataoffset + each.nbytes for each in stacks if each.dataoffset is not None]
    if (missing := max(ends, default=0) - size) > 0:
        raise ConfigurationError(
            f"{path}: the file is cut off, {missing:,} bytes of its voxels are missing; copy it again"
        )


def _opened(path: Path) -> Any:
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # its messages are also raised
    return tifffile.TiffFile(path)


def stated_voxel(path: Path) -> tuple[tuple[float, float, float], str] | None:
    """Return the edges of a voxel along x, y, z and their unit, as a file states them.

    A TIFF of ImageJ or OME states all three, another one and a slice the first two with z NaN. None: it states none.
    """
    kind = kind_of(path)
    if kind in volumes.KINDS:
        try:
            edges_read = volumes.edges(path, kind, _series(path))
        except (ConfigurationError, RuntimeError, OSError):
            return None
        return None if edges_read is None else (edges_read, volumes.UNIT)
    if kind is not TIFF:
        return None
    slices = _slices(path)
    try:
        with _opened(path if slices is None else slices.files[0]) as file:
            if (ome := file.ome_metadata) is not None:
                edges = [re.search(rf'PhysicalSize{axis}="([\d.eE+-]+)"', ome) for axis in "XYZ"]
                unit = re.search(r'PhysicalSizeXUnit="([^"]+)"', ome)
                found = tuple(float(edge[1]) for edge in edges if edge)
                name = unit[1] if unit else "µm"
            else:
                stated, tags = file.imagej_metadata, file.pages[0].tags
                x, y = (n / m for m, n in (tags[f"{axis}Resolution"].value for axis in "XY"))
                if stated is None:
                    name = RESOLUTION_UNITS[tags["ResolutionUnit"].value]
                    inch = 1.0 if name == "in" else 2.54
                    if any(abs(inch / (x * dpi) - 1) < 0.01 for dpi in (inch, *OF_PAGES)):
                        return None
                found = (x, y, math.nan if stated is None else float(stated["spacing"]))
                name = name if stated is None else str(stated["unit"])
    except (KeyError, ValueError, ZeroDivisionError, TypeError, AttributeError, IndexError, OSError):
        return None
    if (
        len(found) < 3
        or any(edge <= 0 or edge == math.inf for edge in found)
        or name.startswith(("pixel", "px"))
    ):
        return None
    return (found[0], found[1], found[2] if slices is None else math.nan), name


def remarks(path: Path) -> tuple[str, ...]:
    """Return sentences on slices that are missing, and on other doubts about a file."""
    slices, kind = _slices(path), kind_of(path)
    if kind not in volumes.KINDS:
        gaps = "" if slices is None else slices.gaps
        lossy = (
            volumes.LOSSY if kind is TIFF and _is_jpeg(path if slices is None else slices.files[0]) else ""
        )
        return tuple(text for text in (gaps, lossy) if text)
    return volumes.remarks(path, kind, _series(path), lambda: open_image(path, grey=True))


def _is_jpeg(path: Path) -> bool:
    with _opened(path) as file:
        return file.pages[0].compression.name in JPEG


def _series(path: Path) -> tuple[Path, ...]:
    """Return the files of a DICOM series; none for one file."""
    slices = _slices(path)
    return () if slices is None else slices.files


def reversed_by(path: Path, low: float, high: float) -> str:
    """Return the property of a file by which a viewer shows its low values brighter than its high ones.

    Empty: it has none, as every other file. Values are never reversed when they are read. The first one counts for
    a stack of slices.
    """
    kind, slices = kind_of(path), _slices(path)
    if slices is not None:
        path = slices.files[0]
    if kind is DICOM and volumes.shown_reversed(path):
        return "its tag PhotometricInterpretation is MONOCHROME1"
    if kind is not TIFF:
        return ""
    with _opened(path) as file:
        page = file.pages[0]
        if page.photometric == 0:
            return "its tag PhotometricInterpretation is WhiteIsZero"
        colours = page.colormap if page.photometric == 3 else None
    if colours is None or not 0 <= low < high < colours.shape[1]:
        return ""
    # Luma of ITU-R BT.601.
    brightness = np.array([0.299, 0.587, 0.114]) @ colours[:, [int(low), int(high)]]
    return "its palette descends" if brightness[0] > brightness[1] else ""


def _part(image: npt.NDArray[Any], crop: Crop | None) -> npt.NDArray[Any]:
    return image if crop is None else image[tuple(slice(first, end) for first, end in crop)]


def _require_whole(path: Path, image: npt.NDArray[Any]) -> None:
    """Refuse an image with decimals, which is no segmented one."""
    if np.issubdtype(image.dtype, np.floating) and not all(map(whole, image)):
        raise ConfigurationError(
            f"{path}: expected a segmented image, of whole numbers or of true and false, got numbers with decimals; "
            "segment it first, or write 'threshold: otsu' in place of 'pore'"
        )


def _check_kind(path: Path, shape: tuple[int, ...], dtype: Any) -> None:
    """Refuse what is no image in three dimensions before it is read."""
    if dtype is None or not any(np.issubdtype(dtype, kind) for kind in (np.bool_, np.integer, np.floating)):
        kind = "" if dtype is None else dtype.kind
        raise ConfigurationError(
            f"{path}: expected an image of numbers, got {TYPES.get(kind, 'values of an unknown type')}; "
            f"{REMEDIES.get(kind, SAVE)}"
        )
    got = " x ".join(map(str, shape))[:80]
    if len(shape) != 3:
        name = {0: "a single number", 1: f"a line of {got} values", 2: f"one slice of {got} pixels"}.get(
            len(shape), f"an array of {len(shape)} axes, {got}"
        )
        then = (
            "give the folder of all slices as path, or stack all slices into one file: a TIFF stack with a page for "
            "each z, or numpy.save of "
            "numpy.stack(slices, axis=2)"
            if len(shape) < 3
            else "save one channel at one time, with the axes x, y, z"
        )
        raise ConfigurationError(f"{path}: expected an image in three dimensions, got {name}; {then}")
    if math.prod(shape) > MOST:
        raise ConfigurationError(
            f"{path}: expected an image in three dimensions of at most {MOST:,} voxels, got {got}; save a part of it"
        )


def _check(path: Path, shape: tuple[int, ...], dtype: Any, crop: Crop | None) -> None:
    """Refuse an image of which the part that is used can be no cell, before it is read."""
    _check_kind(path, shape[:2] if shape[2:] == (1,) else shape, dtype)
    got = f"got the shape {str(tuple(shape))[:80]}"
    if crop is not None:
        if any(not first < end <= length for (first, end), length in zip(crop, shape, strict=True)):
            raise ConfigurationError(
                f"cell.geometry.crop: expected along each axis a first voxel and a larger end within {path}, {got} and "
                f"the part {[list(span) for span in crop]}"
            )
        shape = tuple(end - first for first, end in crop)
        got = f"got a part of the shape {shape}"
    begin = (0, 0, 0) if crop is None else tuple(first for first, _ in crop)
    if min(shape) < SMALLEST or max(shape) > LARGEST:
        spans = [((length - min(length, LARGEST)) // 2, min(length, LARGEST)) for length in shape]
        part = [[k + first, k + first + length] for k, (first, length) in zip(begin, spans, strict=True)]
        advice = (
            f"cell.geometry.crop: {part} takes the middle" if min(shape) >= SMALLEST else "take a larger one"
        )
        place = (
            f"{path}: expected an image" if crop is None else f"cell.geometry.crop: expected a part of {path}"
        )
        raise ConfigurationError(
            f"{place} of {SMALLEST} to {LARGEST} voxels along each edge, {got}; {advice}"
        )


class SmoothImage:
    """Cubic B-spline with the smoothed solid voxels as coefficients, less a level that preserves their share.

    Positive in the solid. The splines themselves smooth with a standard deviation of 0.58 voxels.

    Parameters
    ----------
    solid : (n₁, n₂, n₃)
        True for solid voxels.
    smoothing
        Standard deviation in voxels of a Gaussian filter that is applied first.
    low, high : (3,)
        Extent of the image along each axis.
    mirror
        True to continue the image by mirrors at its sides, else periodically.
    """

    def __init__(self, solid: BoolArray, smoothing: float, low: Array, high: Array, *, mirror: bool) -> None:
        from scipy.ndimage import gaussian_filter  # slow to import

        self.n, self.low, self.mirror = np.array(solid.shape), low, mirror
        self.voxel = (high - low) / self.n
        mode = "reflect" if mirror else "wrap"
        self._coefficients: Array = solid.astype(np.float64)
        if smoothing > 0:
            self._coefficients = gaussian_filter(self._coefficients, smoothing, mode=mode)
        self._level = 0.0
        self._level = self._level_for(1 - float(solid.mean()))

    def value(self, points: Array) -> Array:
        return self._sums(points, ())[0]

    def gradient(self, points: Array) -> Array:
        return np.stack(self._sums(points, (0, 1, 2))[1:], axis=1)

    def at_voxels(self) -> Array:
        """Return the values at the centres of the voxels, (n₁, n₂, n₃)."""
        return self._everywhere((0.0, 0.0, 0.0), None) - self._level

    def _sums(self, points: Array, slopes: tuple[int, ...]) -> list[Array]:
        """Return the spline, and its derivatives by some of the coordinates."""
        place = (points - self.low) / self.voxel - 0.5
        first = np.floor(place).astype(np.int64)
        weights, rates = _spline(place - first)
        index = self._folded(first[:, :, None] + np.arange(-1, 3), self.n[:, None])
        around = self._coefficients[
            index[:, 0, :, None, None], index[:, 1, None, :, None], index[:, 2, None, None, :]
        ]
        found = []
        for slope in (None, *slopes):
            by_axis = [(rates if axis == slope else weights)[:, axis] for axis in range(3)]
            total = np.einsum("nijk,ni,nj,nk->n", around, *by_axis, optimize=True)
            found.append(total - self._level if slope is None else total / self.voxel[slope])
        return found

    def _folded(self, index: IntArray, n: IntArray) -> IntArray:
        """Return the indices of the voxels, along axes of n voxels, that voxels beyond the image repeat."""
        if not self.mirror:
            return index % n
        within = index % (2 * n)
        return np.where(within < n, within, 2 * n - 1 - within)

    def _level_for(self, share: float) -> float:
        """Return the level with the given share of the image below it.

        The share of a small cube that the level cuts is that of a plane normal to the gradient; the error cancels to
        second order.
        """
        from scipy.optimize import brentq  # slow to import

        parts = 1 if self.n.prod() > MANY**3 else 2
        offsets = (np.arange(parts) + 0.5) / parts - 0.5
        values, widths = [], []
        for offset in product(offsets, repeat=3):
            sums = [self._everywhere(offset, slope) for slope in (None, 0, 1, 2)]
            values.append(sums[0].ravel())
            # These derivatives are by coordinates in voxels.
            widths.append(np.sqrt(sums[1] ** 2 + sums[2] ** 2 + sums[3] ** 2).ravel() / parts)
        value, width = np.concatenate(values), np.maximum(np.concatenate(widths), 1e-12)
        # Far from the wall the value is that of a pure phase, which no level is close to.
        pure = width < 1e-9
        low, count = float((value[pure] < 0.5).sum()), len(value)
        value, width = value[~pure], width[~pure]

        def excess(level: float) -> float:
            return (low + float(np.clip(0.5 + (level - value) / width, 0, 1).sum())) / count - share

        return float(brentq(excess, 0.0, 1.0, xtol=1e-12))

    def _everywhere(self, offset: tuple[float, ...], slope: int | None) -> Array:
        """Return the spline, or its derivative by one coordinate in voxels, at an offset from the voxels' centres."""
        found = self._coefficients
        for axis in range(3):
            first = int(np.floor(offset[axis]))
            weights, rates = _spline(np.array(offset[axis] - first))
            taken = rates if axis == slope else weights
            n = self.n[axis]
            places = self._folded(np.arange(n)[:, None] + first + np.arange(-1, 3), n)
            found = np.asarray(sum(taken[k] * np.take(found, places[:, k], axis=axis) for k in range(4)))
        return found


def _spline(t: Array) -> tuple[Array, Array]:
    """Return the weights (..., 4) of the coefficients around 0 ≤ t < 1 after the second one, and their derivatives."""
    s = 1 - t
    weights = np.stack([s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3], axis=-1) / 6
    rates = np.stack([-(s**2), 3 * t**2 - 4 * t, 4 * s - 3 * s**2, t**2], axis=-1) / 2
    return weights, rates
