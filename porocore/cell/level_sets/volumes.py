"""Images of scanners, read through SimpleITK: MetaImage, NIfTI, NRRD, DICOM; their lengths, axes and faults."""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from glob import escape
from os.path import commonprefix
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.echo import joined
from porocore.core.files.metaimage import data_file, header_fault, ignored_keys, read_header
from porocore.core.files.slices import DICOM, META, NIFTI, NRRD, FileKind
from porocore.errors import ConfigurationError
from porocore.states import Array

KINDS = (META, NIFTI, NRRD, DICOM)
#: Readers of SimpleITK, so that none looks at a file of another kind.
_READERS = {META: "MetaImageIO", NIFTI: "NiftiImageIO", NRRD: "NrrdImageIO", DICOM: "GDCMImageIO"}
#: Lengths of these files are in it.
UNIT = "mm"
#: Transfer syntaxes of DICOM that lose values: JPEG baseline and extended, JPEG-LS near-lossless.
_LOSSY = re.compile(rb"1\.2\.840\.10008\.1\.2\.4\.(50|51|81)\0")
LOSSY = (
    "the file was compressed with loss, which changes values beside the walls; export it anew without loss"
)
#: Bytes within which a DICOM file names its transfer syntax.
_BEGIN = 2048
#: Share of the distance of two slices by which another one may differ.
EVEN = 0.01
#: Voxels on either side of the middle that are looked at for the order of their bytes.
MIDDLE = 64
#: Series, and slices, that a message names.
NAMED = 4
Check = Callable[[tuple[int, ...], Any], None]


@dataclass(frozen=True, eq=False)
class Head:
    """Facts of a file on its voxels, known before they are read.

    Attributes
    ----------
    shape, spacing
        Voxels, and their edges [mm], along the axes as they are stored, the fastest one first.
    dtype
        Of the values, after the scale that the file states.
    components
        Values in each voxel.
    direction : (n, n)
        Columns are the directions of the stored axes.
    tags
        Further facts by their names in the file.
    """

    shape: tuple[int, ...]
    spacing: tuple[float, ...]
    dtype: np.dtype[Any]
    components: int
    direction: Array
    tags: dict[str, str]

    def numbers(self, tag: str) -> Array | None:
        """Return the numbers of a tag of DICOM; None: there are none."""
        try:
            return np.array(self.tags[tag].split("\\"), dtype=float)
        except (KeyError, ValueError):
            return None


def read(path: Path, kind: FileKind, check: Check) -> npt.NDArray[Any]:
    """Return the values of a file (n₁, n₂, n₃) along its axes as they are stored, after a check of shape and type.

    Raises
    ------
    ConfigurationError
        SimpleITK is missing, or the file has several values in each voxel, axes that are not at right angles, or an end
        before its last voxel.
    RuntimeError
        It is damaged.
    """
    head = _head(path, kind)
    _require_one_value(path, head)
    shape = head.shape
    while len(shape) > 3 and shape[-1] == 1:  # the only time
        shape = shape[:-1]
    check(shape, head.dtype)
    _require_all(path, kind, head)
    itk = _itk(path)
    with _as_stored((path,), kind) as (file,):
        return np.asarray(itk.GetArrayFromImage(_reader(file, kind).Execute()).T.reshape(shape, order="F"))


def read_series(path: Path, files: tuple[Path, ...], check: Check) -> npt.NDArray[Any]:
    """Return the values of the slices of one DICOM series, (n₁, n₂, n₃), by their positions; see :func:`read`.

    Raises
    ------
    ConfigurationError
        As :func:`read`, or the files are several series, or slices that are no stack.
    """
    series = _series_of(path, files)
    first = series.heads[0]
    _require_one_value(path, first)
    check((*first.shape[:2], len(files)), first.dtype)
    itk = _itk(path)
    reader = itk.ImageSeriesReader()
    reader.SetImageIO(_READERS[DICOM])
    with _as_stored(series.files, DICOM) as stored:
        reader.SetFileNames([str(file) for file in stored])
        return np.asarray(itk.GetArrayFromImage(reader.Execute()).T)


@contextmanager
def _as_stored(files: tuple[Path, ...], kind: FileKind) -> Iterator[tuple[Path, ...]]:
    """Give files from which SimpleITK reads the values that are stored; it reverses those of MONOCHROME1."""
    with TemporaryDirectory() as folder:
        yield tuple(
            _unreversed(file, Path(folder) / str(k)) if kind is DICOM and shown_reversed(file) else file
            for k, file in enumerate(files)
        )


def _unreversed(file: Path, copy: Path) -> Path:
    """Write a copy of a DICOM file that is MONOCHROME2, so that SimpleITK does not reverse its values."""
    copy.write_bytes(file.read_bytes().replace(b"MONOCHROME1", b"MONOCHROME2"))
    if shown_reversed(copy):  # the tags are packed, too
        raise ConfigurationError(
            f"{file}: expected MONOCHROME2 as PhotometricInterpretation, got MONOCHROME1 in a file with packed tags, "
            "of which the stored values cannot be read; export it anew without compression"
        )
    return copy


def edges(path: Path, kind: FileKind, files: tuple[Path, ...] = ()) -> tuple[float, float, float] | None:
    """Return the edges of a voxel [mm] as the file states them, (3,), or as its series does; None: it states none.

    Edges of 1 are what is written where nobody knew them. z is NaN where slices state no positions.

    Raises
    ------
    ConfigurationError
        As :func:`read` or :func:`read_series`.
    RuntimeError
        The file is damaged.
    """
    if files:
        series = _series_of(path, files)
        found = (*series.heads[0].spacing[:2], series.distance)
    else:
        found = _head(path, kind).spacing[:3]
    if len(found) < 3 or all(edge == 1 or math.isnan(edge) for edge in found) or min(found) <= 0:
        return None
    return found[0], found[1], found[2]


def remarks(
    path: Path, kind: FileKind, files: tuple[Path, ...], read_values: Callable[[], npt.NDArray[Any]]
) -> tuple[str, ...]:
    """Return sentences on what makes an image doubtful: gaps, losses, turned axes, an order of bytes.

    Parameters
    ----------
    path, kind, files
        Of the image; ``files`` are those of a series.
    read_values
        Gives its values, where they are needed.
    """
    found: list[str] = []
    if files:
        series = _series_of(path, files)
        found += series.gaps
        head = series.heads[0]
    else:
        head = _head(path, kind)
    if kind is DICOM and any(map(_is_lossy, files or (path,))):
        found.append(LOSSY)
    axes = head.direction[:3, :3]
    if len(axes) == 3 and np.abs(np.abs(axes) - np.eye(3)).max() > EVEN:
        lie = [
            f"{name} along [{', '.join(f'{c:.3g}' for c in axes[:, k] + 0.0)}]"
            for k, name in enumerate("xyz")
        ]
        found.append(
            f"the file states that its axes lie {joined(lie)} of the scanner (LPS); the axes of the cell are those of "
            "the voxels as they are stored, so loads and stiffness count along these"
        )
    if kind is META and (ignored := ignored_keys(path)):
        found.append(
            f"{', '.join(ignored[:NAMED])} in {path.name} {'is' if len(ignored) == 1 else 'are'} ignored below "
            "ElementDataFile, which is the last key of a header; write above it what counts"
        )
    if kind is META and head.dtype.itemsize > 1 and (doubt := _swapped(read_values())):
        found.append(
            f"{doubt} if their bytes stood in the other order; if they do, set 'ElementByteOrderMSB' in {path.name} to "
            "the other value, above ElementDataFile"
        )
    return tuple(found)


def shown_reversed(path: Path) -> bool:
    """Return True for a DICOM file of which viewers show low values bright."""
    return _head(path, DICOM).tags.get("0028|0004", "").strip() == "MONOCHROME1"


def header_for(path: Path) -> str:
    """Return the lines of a MetaImage header for a file of voxels alone, with what its name and size tell."""
    size = path.stat().st_size
    types = {1: "MET_UCHAR", 2: "MET_USHORT", 4: "MET_FLOAT"}
    named = re.search(r"(\d+)x(\d+)x(\d+)", path.name)
    edge = {width: round((size / width) ** (1 / 3)) for width in types}
    shapes = [(tuple(map(int, named.groups())), width) for width in types] if named else []
    shapes += [((n, n, n), width) for width, n in edge.items()]
    shape, width = next(((s, w) for s, w in shapes if math.prod(s) * w == size), (None, 0))
    dimensions = " ".join(map(str, shape)) if shape else "NX NY NZ"
    kind = types.get(width, " or ".join(types.values()))
    return (
        f"'ObjectType = Image', 'NDims = 3', 'DimSize = {dimensions}', 'ElementType = {kind}', 'ElementDataFile = "
        f"{path.name}'"
    )


@dataclass(frozen=True, eq=False)
class _Series:
    """Slices of one series in the order of their positions.

    Attributes
    ----------
    files, heads
        Of the slices.
    places
        Their positions [mm] along the normal of the slices; None: not stated.
    """

    files: tuple[Path, ...]
    heads: tuple[Head, ...]
    places: Array | None

    @cached_property
    def distance(self) -> float:
        """Distance of neighbouring slices [mm], that of most; NaN: not stated."""
        return (
            math.nan
            if self.places is None or len(self.places) < 2
            else float(np.median(np.diff(self.places)))
        )

    @cached_property
    def gaps(self) -> tuple[str, ...]:
        """A sentence on slices whose distance is another one."""
        if self.places is None or len(self.places) < 3:
            return ()
        steps = np.diff(self.places)
        odd = np.flatnonzero(np.abs(steps / self.distance - 1) > EVEN)
        if not len(odd):
            return ()
        told = ", ".join(
            f"{steps[k]:.4g} mm between {self.files[k].name} and {self.files[k + 1].name}"
            for k in odd[:NAMED]
        )
        return (
            f"slices lie {self.distance:.4g} mm apart, but {told}{', …' if len(odd) > NAMED else ''}; they are taken "
            "for equally distant ones: add what is missing",
        )


def _series_of(path: Path, files: tuple[Path, ...]) -> _Series:
    return _series(path, files, tuple(file.stat().st_mtime_ns for file in files))


@lru_cache(maxsize=2)
def _series(path: Path, files: tuple[Path, ...], changed: tuple[int, ...]) -> _Series:
    """Return the slices of the only series among files by their positions, else by their numbers."""
    heads = {}
    for file in files:
        try:
            heads[file] = _head(file, DICOM)
        except RuntimeError as error:
            raise ConfigurationError(
                f"{path}: {file.name}: expected a DICOM image, got none, or a damaged one; copy it again, or leave it "
                "out by a pattern of names"
            ) from error
    series: dict[str, list[Path]] = {}
    for file, head in heads.items():
        series.setdefault(head.tags.get("0020|000e", "").strip(), []).append(file)
    if len(series) > 1:
        groups = sorted(series.values(), key=len, reverse=True)
        told = [
            f"'{heads[group[0]].tags.get('0008|103e', '').strip()}' ({len(group)} file{'s'[: len(group) - 1]}, such as "
            f"{group[0].name})"
            for group in groups
        ]
        begins = [commonprefix([file.name for file in group]) for group in groups]  # noqa: RUF071 - of letters
        own = [
            begin
            for begin, group in zip(begins, groups, strict=True)
            if begin and sum(file.name.startswith(begin) for file in files) == len(group)
        ]
        pattern = (
            f"choose one by a pattern of names, such as 'path: {files[0].parent}/{escape(own[0])}*', or "
            if own
            else ""
        )
        raise ConfigurationError(
            f"{path}: expected one DICOM series, got {len(series)}: {', '.join(told[:NAMED])}"
            f"{', …' if len(told) > NAMED else ''}; {pattern}move the files of one to a folder of their own"
        )
    planes = {file: (head.shape, *np.round(head.direction, 2).ravel()) for file, head in heads.items()}
    (usual, _), *others = Counter(planes.values()).most_common()
    first = next(file for file in files if planes[file] == usual)
    if others or usual[0][2:] not in ((), (1,)):
        odd = next((file for file in files if planes[file] != usual), first)
        raise ConfigurationError(
            f"{path}: expected slices of one size and direction, got {odd.name} of {_product(heads[odd])}, where "
            f"{first.name} has {_product(heads[first])}, or is turned against it; leave it out by a pattern of names"
        )
    positions = [head.numbers("0020|0032") for head in heads.values()]
    if any(position is None or position.shape != (3,) for position in positions):
        order = sorted(files, key=lambda file: _number(heads[file]))
        return _Series(tuple(order), tuple(heads[file] for file in order), None)
    places = np.array(positions) @ heads[first].direction[:, 2]
    by_place = np.argsort(places, kind="stable")
    places, ordered = places[by_place], tuple(files[k] for k in by_place)
    if len(same := np.flatnonzero(np.diff(places) <= 0)):
        raise ConfigurationError(
            f"{path}: expected one slice at each position, got {ordered[same[0]].name} and {ordered[same[0] + 1].name} "
            "at one; choose one image by a pattern of names"
        )
    return _Series(ordered, tuple(heads[file] for file in ordered), places)


def _number(head: Head) -> float:
    found = head.numbers("0020|0013")
    return 0.0 if found is None else float(found[0])


def _is_lossy(path: Path) -> bool:
    with path.open("rb") as file:
        stated = _LOSSY.search(file.read(_BEGIN))
    return stated is not None or _head(path, DICOM).tags.get("0028|2110", "").strip() == "01"


def _head(path: Path, kind: FileKind) -> Head:
    if kind is META and (fault := header_fault(read_header(path)[0])):
        raise ConfigurationError(f"{path}: {fault}")
    reader = _reader(path, kind)
    try:
        reader.ReadImageInformation()
    except RuntimeError as error:
        if "orthonormal" not in str(error):
            raise
        raise ConfigurationError(
            f"{path}: expected axes at right angles, got sheared ones by its sform and qform; resample the image"
        ) from error
    name, count = _itk(path).GetPixelIDValueAsString(reader.GetPixelID()), reader.GetDimension()
    # Such as "16-bit unsigned integer" or "vector of 32-bit float".
    bits = int(re.search("[0-9]+", name)[0])  # type: ignore[index]
    letter = "c" if "complex" in name else "f" if "float" in name else "u" if "unsigned" in name else "i"
    return Head(
        shape=reader.GetSize(),
        spacing=reader.GetSpacing(),
        dtype=np.dtype(f"{letter}{bits // 8 * (2 if letter == 'c' else 1)}"),
        components=1 if letter == "c" else reader.GetNumberOfComponents(),
        direction=np.reshape(reader.GetDirection(), (count, count)),
        tags={key: reader.GetMetaData(key) for key in reader.GetMetaDataKeys()},
    )


def _reader(path: Path, kind: FileKind) -> Any:
    reader = _itk(path).ImageFileReader()
    reader.SetImageIO(_READERS[kind])
    reader.SetFileName(str(path))
    return reader


def _itk(path: Path) -> Any:
    try:
        import SimpleITK  # slow to import
    except ImportError as error:
        raise ConfigurationError(
            f"{path}: images as {', '.join(s for kind in KINDS for s in kind.suffixes)} are read through SimpleITK, "
            f"which cannot be imported here ({error}); pip install SimpleITK, or save the image as a TIFF stack"
        ) from None
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)  # what matters is said by porocore
    return SimpleITK


def _require_one_value(path: Path, head: Head) -> None:
    if head.components > 1:
        raise ConfigurationError(
            f"{path}: expected one value in every voxel, got {head.components}, as of an image in colour; save it in "
            "grey, in ImageJ by Image > Type > 8-bit"
        )


def _require_all(path: Path, kind: FileKind, head: Head) -> None:
    """Refuse a file that ends before its last voxel, for which SimpleITK gives any values, or goes on behind it."""
    voxels = math.prod(head.shape)
    if kind is NIFTI:
        begin, width = float(head.tags["vox_offset"]), int(head.tags["bitpix"]) // 8
        excess = _length(path) - int(begin) - voxels * width
    elif kind is META:
        keys, length = read_header(path)
        data = data_file(path) or path
        if keys.get("BinaryData", "true").lower() == "false":
            raise ConfigurationError(
                f"{path}: expected voxels as binary data, got text by 'BinaryData'; save it anew"
            )
        within = length if data == path else max(int(keys.get("HeaderSize", 0)), 0)
        size = data.stat().st_size - within
        packed = keys.get("CompressedData", "false").lower() == "true"
        if packed:
            wanted = int(keys.get("CompressedDataSize", size))
        else:
            wanted = voxels * head.dtype.itemsize
        excess = size - wanted
        if data != path and (excess < 0 or (excess > 0 and keys.get("HeaderSize") != "-1")):
            width = head.dtype.itemsize
            then = (
                f"write 'HeaderSize = {excess + within}' if its voxels stand at its end"
                if excess > 0
                else "copy it again if it is cut off"
            )
            each = f"{width} byte{'s' if width > 1 else ''}{', compressed' if packed else ''}"
            raise ConfigurationError(
                f"{path}: expected {data.name} of {wanted + within:,} bytes, for {_product(head)} voxels of {each}, "
                f"got {abs(excess):,} {'more' if excess > 0 else 'fewer'}; check DimSize and ElementType, or {then}"
            )
        if packed and excess >= 0 and _unpacked(data, within) != voxels * head.dtype.itemsize:
            raise ConfigurationError(
                f"{path}: expected {_product(head)} voxels of {head.dtype} in {data.name}, got compressed values that "
                "are damaged or of another number; copy it again, or check DimSize and ElementType"
            )
    elif kind is NRRD:
        with path.open("rb") as file:
            if re.search(rb"^data ?file:", file.read(_BEGIN).partition(b"\n\n")[0], re.MULTILINE):
                raise ConfigurationError(
                    f"{path}: expected voxels behind the header, got the name of another file by 'data file'; save "
                    "both in one file"
                )
        return
    else:
        return
    if excess < 0:
        raise ConfigurationError(
            f"{path}: the file is cut off, {-excess:,} bytes of its {_product(head)} voxels are missing; copy it again"
        )


def _unpacked(path: Path, begin: int) -> int:
    """Return the length of compressed values; -1 where they are damaged, which SimpleITK does not tell."""
    reader, length = zlib.decompressobj(47), 0  # of zlib or gzip
    with path.open("rb") as file:
        file.seek(begin)
        try:
            while part := file.read(1 << 16):
                length += len(reader.decompress(part))
        except zlib.error:
            return -1
    return length


def _product(head: Head) -> str:
    return " x ".join(map(str, head.shape))


def _length(path: Path) -> int:
    """Return the length of a file, of one that is packed that of its content as far as it goes."""
    with path.open("rb") as begin:
        packed = begin.read(2) == b"\x1f\x8b"
    if not packed:
        return path.stat().st_size
    length = 0
    with gzip.open(path) as file:
        try:
            while part := file.read(1 << 22):
                length += len(part)
        except EOFError:
            pass
    return length


def _swapped(values: npt.NDArray[Any]) -> str:
    """Return what speaks for the other order of bytes: neighbours that differ as in noise, or no low bytes.

    The measure is von Neumann's ratio, the mean square of the differences of neighbours by twice the variance: 1 for
    noise, nearly 0 for an image. An image in the right order only gets rougher where its bytes are exchanged.
    """
    middle = tuple(slice(max(n // 2 - MIDDLE, 0), n // 2 + MIDDLE) for n in values.shape)
    if (
        values.dtype.kind in "iu"
        and values.dtype.itemsize == 2
        and values.any()
        and not (values & 0xFF).any()
    ):
        return "the values of the image are multiples of 256, and would be of 8 bits"
    values = values[middle]
    rough, other = (_roughness(each) for each in (values, values.byteswap()))
    if rough > 2 * other and rough > 0.5:
        return "the values of the image jump from voxel to voxel, and would not"
    return ""


def _roughness(values: npt.NDArray[Any]) -> float:
    with np.errstate(all="ignore"):
        lines = values.astype(float)
        lines = lines / np.abs(lines).max()
        found = np.mean(np.diff(lines, axis=0) ** 2) / (2 * np.var(lines))
    return float(found) if np.isfinite(found) else 1.0
