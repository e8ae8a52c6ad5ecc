"""Pores of a segmented image (Voxels): faces, percolation, thin walls and channels, level set."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from porocore.cell.geometry.pore_geometry import CUBE, Sides, Unfolding, unit_sides
from porocore.cell.level_sets.cutting import SPECKS, LevelSetGeometry, mesh_level_set
from porocore.cell.level_sets.grey_values import HANDFUL, GreyValues, Parting, assumed, not_segmented, phases
from porocore.cell.level_sets.image import (
    SLICE_SUFFIXES,
    SMALLEST,
    Cleaned,
    SmoothImage,
    across,
    clean,
    open_image,
    read_image,
    remarks,
    reversed_by,
    stated_voxel,
)
from porocore.cell.meshing.connectivity import joined
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.cell.symmetry import group_of_voxels
from porocore.core.files.input_file import FromFile
from porocore.core.tensors import PointGroup
from porocore.core.units import Dimension, Unit, length_text
from porocore.errors import ConfigurationError
from porocore.states import Array, BoolArray, IntArray

#: Times the largest share of voxels that change between neighbouring layers inside of an image, above which that
#: between its opposite faces is a fault; flat walls change as much inside. Along n voxels it is FAULT + FEW/n, since
#: few layers scatter: of 1,900 periodic images of noise none is accused, of pieces of 24³ voxels or more all are.
FAULT, FEW = 1.5, 6.0


def mismatch_note(solid: BoolArray) -> tuple[str, ...]:
    """Return a sentence on faces that do not match, with the share of voxels that differ; none where all match."""
    faults = []
    for axis, name in enumerate("xyz"):
        changes = solid != np.roll(solid, -1, axis=axis)
        inside = changes.mean(axis=tuple(a for a in range(3) if a != axis))
        across, within = float(inside[-1]), float(inside[:-1].max())
        if across > (FAULT + FEW / len(inside)) * within:
            faults.append(f"{100 * across:.0f} % across {name} (inside at most {100 * within:.0f} %)")
    if not faults:
        return ()
    return (
        f"the image is not periodic: of the voxels of opposite faces differ {', '.join(faults)}; the cell has walls "
        "there that the sample has not; choose 'repeat: mirror', by which the image is an eighth of the cell, or "
        "'repeat: layer', which blends opposite sides",
    )


def blended(solid: BoolArray, width: int) -> tuple[BoolArray, str]:
    """Return a periodic image, smaller by ``width`` voxels along each axis, and a sentence on it.

    Its first layers are blended from those of the image and from the last layers, which are left out: the signed
    distances from the wall are weighed, from those of the last layers at the face to those of the first ones inside.

    Raises
    ------
    ConfigurationError
        The layer takes more than half of an edge, or leaves too few voxels.
    """
    most = min(min(solid.shape) // 2, min(solid.shape) - SMALLEST)
    if width > most:
        raise ConfigurationError(
            f"cell.geometry.layer: expected at most {most} voxels, half of the shortest edge of the image, got {width}"
        )
    distance = _signed_distance(solid)
    weights = (np.arange(width) + 0.5) / width
    for axis in range(3):
        along = np.moveaxis(distance, axis, 0)
        kept = along[:-width].copy()
        w = weights[:, None, None]
        kept[:width] = w * along[:width] + (1 - w) * along[-width:]
        distance = np.moveaxis(kept, 0, axis)
    found = distance > 0
    before, after = (1 - float(mask.mean()) for mask in (solid, found))
    note = (
        f"opposite sides are blended in a layer of {width} voxels, {100 * _share(found.shape, width):.0f} % of the "
        f"cell; the porosity of the image is {before:.4g}, that of the cell {after:.4g}"
    )
    return found, note


def _share(shape: tuple[int, ...], width: int) -> float:
    return 1 - float(np.prod([1 - width / n for n in shape]))


def _signed_distance(solid: BoolArray) -> Array:
    """Return the distance of each voxel from the other phase, less half a voxel, negative in the pores."""
    from scipy.ndimage import distance_transform_edt  # slow to import

    inside, outside = distance_transform_edt(solid), distance_transform_edt(~solid)
    return np.asarray(np.where(solid, inside - 0.5, 0.5 - outside))


#: Errors of K and of shear moduli by the smoothing, measured in ``benchmarks/channels_of_voxels.py``.
ROUNDED = (
    "K and moduli of an image: its smoothing rounds corners, by which straight square channels of 10, 20 and 40 voxels "
    "conduct 5.8, 1.9 and 0.6 % more than they should with 'smoothing: 1', and 2.2, 0.9 and 0.4 % with 0; round ones "
    "of 8, 16 and 32 voxels that cross 7.1, 5.3 and 2.4 % with 1, and 3.4, 1.8 and 2.1 % with 0; the shear modulus "
    "across square ones is too large by 21, 11 and 5 % with 'smoothing: 1', and by 11, 5 and 2 % with 0. A smaller "
    "cell.mesh.size does not change this; for pores with corners or edges write 'smoothing: 0', take smaller voxels, "
    "or mesh the cell (kind: mesh-file) (docs/cell.md, Round and square channels)"
)
#: Units of lengths in image files: other names, and metres.
UNITS = {"micron": "um", "microns": "um", "µm": "um", "\\u00B5m": "um", "\u03bcm": "um", "inch": "in"}
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "m": 1.0}
#: Larger voxels [m] are most likely a number without a unit, in µm or mm.
HUGE = 1e-3
#: A given threshold that takes less than this share of the voxels for pores, or for solid, is most often a slip.
FEW_PORES = 0.01
#: Share by which the edges of a voxel may differ from those that its file states.
SAME = 0.01
#: First place of a part, and the place after its last.
Span = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)]]
Edge = Annotated[float, Field(ge=1e-12, le=1e3, allow_inf_nan=False)]


class Voxels(FromFile, LevelSetGeometry):
    """The pores of a segmented image, a box of equal voxels.

    With ``repeat: mirror`` the image is the eighth of the cell, and its mirror images make the cell periodic; with
    ``repeat: periodic`` it is the whole cell, and with ``repeat: layer`` the whole cell after its outer layers were
    blended into each other. The steps of the voxels are smoothed, with the same share of pores.
    """

    slice_suffixes: ClassVar[tuple[str, ...]] = SLICE_SUFFIXES
    kind: Literal["voxels"]
    """A segmented or grey image of equal voxels from a ``.npy``, TIFF, MetaImage, NIfTI or NRRD file, or from slices
    along z in files of their own, those of DICOM too: ``path`` is that of their folder, or a pattern such as
    ``slices/scan_*.tif``."""
    pore: int = 0
    """Value of the voxels in the pores; all others are solid."""
    threshold: Annotated[float, Field(allow_inf_nan=False)] | Literal["otsu"] | None = None
    """Of a grey image, in place of ``pore``: the voxels of at most this value are the pores. ``otsu``: it is chosen by
    Otsu's method from all voxels of the file."""
    bright_pores: bool = False
    """True: the voxels above ``threshold`` are the pores, and the others solid."""
    repeat: Literal["mirror", "periodic", "layer"] = "mirror"
    """``mirror``: the image is the eighth of the cell, ``periodic``: it is the whole cell, ``layer``: it becomes a cell
    by a layer at its faces in which opposite sides of the image are blended."""
    layer: Annotated[int, Field(ge=1), Unit("voxels")] = 8
    """Thickness of that layer; the cell is smaller than the image by it along each axis."""
    voxel_size: Annotated[Edge | tuple[Edge, Edge, Edge] | None, Dimension("displacement", si=True)] = None
    """Edge of a voxel, or its edges along x, y and z, such as 12 um; null: a cube of any size."""
    crop: Annotated[tuple[Span, Span, Span] | None, Unit("voxels")] = None
    """First voxel of the part that is used, and the one after its last, along x, y and z; null: all of the image."""
    drop_grains: bool = False
    """True: pieces of the solid apart from its largest one become pores, and so do islands that come loose in the mesh,
    of up to 2 % of the solid."""
    fill_pores: Annotated[int, Field(ge=0), Unit("voxels")] = 0
    """Pieces of the pores of at most so many voxels become solid."""
    smoothing: Annotated[float, Field(ge=0, le=10), Unit("voxels")] = 1.0
    """Standard deviation of the Gaussian that smooths the steps of the voxels."""

    @model_serializer(mode="wrap")
    def _only_what_is_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        if self.repeat != "layer":
            data.pop("layer", None)
        if self.threshold is None:
            data.pop("threshold", None)
            data.pop("bright_pores", None)
        else:
            data.pop("pore", None)
        if self.voxel_size is None:
            data.pop("voxel_size", None)
        return data

    @model_validator(mode="after")
    def _one_way_to_the_pores(self) -> Self:
        if self.threshold is None and self.bright_pores:
            raise ValueError(
                "bright_pores belongs to threshold, which is missing; give it, such as 'threshold: otsu'"
            )
        if self.threshold is not None and "pore" in self.model_fields_set:
            raise ValueError(
                "expected either pore, of a segmented image, or threshold, of a grey one, got both"
            )
        return self

    @property
    def level(self) -> float | None:
        """Value that parts pores and solid of a grey image; None: it is a segmented one.

        Raises
        ------
        ConfigurationError
            The file is no image of numbers.
        """
        return _grey(Path(self.path), self.sha256).otsu if self.threshold == "otsu" else self.threshold

    @property
    def parting(self) -> Parting | None:
        """Grey values and their threshold, that of Otsu where none is given; None for a segmented image."""
        grey = _grey(Path(self.path), self.sha256)
        if self.threshold is None:
            return None if len(grey.values) <= HANDFUL else Parting(grey, grey.otsu, "Otsu's, not used", None)
        name = "Otsu's" if self.threshold == "otsu" else "as given"
        return Parting(
            grey, grey.otsu if self.threshold == "otsu" else self.threshold, name, self.bright_pores
        )

    def pores_of(self, values: npt.NDArray[Any]) -> BoolArray:
        """Return True for those values of voxels that are pores."""
        level = self.level
        return np.asarray(values == self.pore if level is None else (values > level) == self.bright_pores)

    @property
    def solid(self) -> BoolArray:
        """True for solid voxels, (n₁, n₂, n₃), after cropping, blending and cleaning.

        Raises
        ------
        ConfigurationError
            The file is no segmented image, has changed, or has one phase only.
        """
        return _cleaned(self).solid

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the values of the voxels, on what was blended and removed, and on grains that float."""
        slices = () if self.slices is None else (self.slices.summary,)
        values = () if self.repeat != "layer" else (_periodic(self)[1],)
        return (*slices, *self._of_values, *values, *_cleaned(self).notes)

    @property
    def _of_values(self) -> tuple[str, ...]:
        grey, level = _grey(Path(self.path), self.sha256), self.level
        if level is None:
            told = "pore" in self.model_fields_set
            return phases(grey, self.pore) if told else (*assumed(grey, self.pore), *phases(grey, self.pore))
        how = "as given"
        if self.threshold == "otsu":
            how = (
                f"by Otsu's method{'' if self.crop is None else ' from the whole file, not from crop alone'}"
            )
        side = "above it" if self.bright_pores else "up to it"
        return (f"threshold {level:g}, {how}; values are {grey.extent}, and the voxels {side} are pores",)

    @property
    def value_warnings(self) -> tuple[str, ...]:
        """Sentences on a file of any size that is not segmented, lacks slices, or looks otherwise in a viewer."""
        grey = _grey(Path(self.path), self.sha256)
        found = not_segmented(grey, self.pore) if self.threshold is None else self._of_threshold(grey)
        return (*remarks(Path(self.path)), *self._of_view(grey), *found)

    def _of_threshold(self, grey: GreyValues) -> tuple[str, ...]:
        """Return a sentence on a given threshold that takes nearly all or nearly no voxels for pores."""
        if not isinstance(self.threshold, float):
            return ()
        dark, by_otsu = grey.share(self.threshold), grey.share(grey.otsu)
        if FEW_PORES <= dark <= 1 - FEW_PORES:
            return ()
        pores, others = (1 - dark, 1 - by_otsu) if self.bright_pores else (dark, by_otsu)
        return (
            f"cell.geometry.threshold: {self.threshold:g} makes pores of {100 * pores:.3g} % of the voxels, whose "
            f"values are {grey.extent}; 'threshold: otsu' parts them at {grey.otsu:g} and makes pores of "
            f"{100 * others:.3g} %",
        )

    def _of_view(self, grey: GreyValues) -> tuple[str, ...]:
        """Return a sentence on a file of which a viewer shows low values brighter than high ones."""
        low, high = grey.values[0], grey.values[-1]
        why = reversed_by(Path(self.path), low, high)
        if not why:
            return ()
        if self.threshold is not None:
            darker, pores = (
                self.bright_pores,
                f"the voxels {'above' if self.bright_pores else 'up to'} the threshold",
            )
            other = f"bright_pores: {str(not darker).lower()}"
        else:
            darker, pores = self.pore != low, f"the voxels of the value {self.pore}"
            other = f"pore: {low if darker else high:g}"
        taken, meant = ("dark", "bright") if darker else ("bright", "dark")
        then = (
            f"so the pores, {pores}, are what a viewer shows {taken}: if they are what it shows {meant}, write "
            f"'{other}'"
            if self.threshold is not None or self.pore in (low, high)
            else f"so check 'pore: {self.pore}'"
        )
        return (
            f"a viewer shows the value {low:g} of the file bright and {high:g} dark, since {why}; values are not "
            f"reversed when they are read, {then}",
        )

    @property
    def _of_edges(self) -> tuple[str, ...]:
        """A sentence on a file that states other edges of its voxels."""
        stated = stated_voxel(Path(self.path))
        if stated is None:
            return ()
        edges, unit = np.array(stated[0]), UNITS.get(stated[1], stated[1])
        given = np.broadcast_to(1.0 if self.voxel_size is None else self.voxel_size, 3)
        metres = METRES.get(unit)
        same = edges * metres if metres and self.voxel_size is not None else edges * given[0] / edges[0]
        known = np.isfinite(edges)
        if np.abs(same / given - 1)[known].max() <= SAME:
            return ()
        shown = f"[{', '.join(f'{edge:.6g} {unit}' for edge in edges[known])}]"
        taken = (
            "takes them for cubes" if self.voxel_size is None else f"has {length_text(*map(float, given))}"
        )
        then = (
            f"'voxel_size: {_edges_as_key(edges, unit)}'"
            if known.all()
            else "these as the first two of 'voxel_size: [x, y, z]', with the distance of the pages, which it does not "
            "state, as the third"
        )
        return (
            f"the file states that its voxels are {shown} along {', '.join('xyz'[: known.sum()])}, and "
            f"cell.geometry {taken}; if the file is right, write {then}",
        )

    @property
    def _of_huge_voxels(self) -> tuple[str, ...]:
        """A sentence on voxels of more than a millimetre."""
        if self.voxel_size is None or np.max(self.voxel_size) <= HUGE:
            return ()
        edges = length_text(*np.broadcast_to(self.voxel_size, 3).tolist())
        cell = length_text(*(self.length or 0.0) * np.array(self.sides))
        number = np.max(self.voxel_size)
        unit = f", such as '{number:g} um'" if number >= 1 else ""
        return (
            f"cell.geometry.voxel_size was read as {edges}, so that the cell is {cell} large; a number without a unit "
            f"is in metres: if another is meant, write it{unit}",
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        faces = mismatch_note(_periodic(self)[0]) if self.repeat == "periodic" else ()
        return (*self.value_warnings, *(self._of_edges or self._of_huge_voxels), *faces)

    @property
    def error_of_shape(self) -> str:
        return ROUNDED

    @property
    def porosity(self) -> float:
        """Share of pore voxels in the image."""
        return 1 - float(self.solid.mean())

    @property
    def sides(self) -> Sides:
        """Sides of the box of voxels."""
        return unit_sides(self._edges)

    @property
    def length(self) -> float | None:
        if self.voxel_size is None:
            return None
        return math.cbrt(math.prod(self._edges)) * (2 if self.repeat == "mirror" else 1)

    @property
    def _edges(self) -> Array:
        """Edges of the image along each axis, (3,), in metres if the size of a voxel is given, else in voxels."""
        return np.multiply(self.solid.shape, 1.0 if self.voxel_size is None else self.voxel_size)

    @property
    def unfolding(self) -> Unfolding:
        """The eighth with mirrors, else the whole cell."""
        return "eighth" if self.repeat == "mirror" else "whole"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the voxels, exactly."""
        return _point_group(self)

    @property
    def description(self) -> str:
        shape = self.solid.shape
        voxels = f"{shape[0]}³" if len(set(shape)) == 1 else " × ".join(map(str, shape))
        how = f"with a periodic layer of {self.layer}" if self.repeat == "layer" else self.repeat
        return f"image {self.file_name} of {voxels} voxels, {how}"

    def specification(self) -> dict[str, Any]:
        """Return all that the cell depends on; of the size of a voxel that is its shape."""
        data = super().specification()
        size = data.pop("voxel_size", None)
        if isinstance(size, list) and unit_sides(size) != CUBE:
            data["voxel_size"] = [round(edge / size[0], 9) for edge in size]
        if self.drop_grains:
            data["specks"] = SPECKS
        return data

    def level_set(self) -> SmoothImage:
        return _smooth(self)

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        return mesh_level_set(self, self.level_set(), size, element, drop_specks=self.drop_grains)


def stated_size(path: Path) -> str:
    """Return what to write as ``voxel_size`` by what the file states; empty where it states no lengths."""
    if (stated := stated_voxel(path)) is None or not np.isfinite(stated[0]).all():
        return ""
    unit = UNITS.get(stated[1], stated[1])
    return _edges_as_key(np.array(stated[0]), unit) if unit in METRES else ""


def _edges_as_key(edges: Array, unit: str) -> str:
    if np.abs(edges / edges[0] - 1).max() <= SAME:
        return f"{edges[0]:.6g} {unit}"
    return f"[{', '.join(f'{edge:.6g} {unit}' for edge in edges)}]"


@lru_cache(maxsize=2)
def _grey(path: Path, sha256: str | None) -> GreyValues:
    """Return the values of all voxels of a file with this content."""
    found = GreyValues.of(open_image(path, grey=True))
    if not len(found.values):
        raise ConfigurationError(f"{path}: expected a number in every voxel, got none in any")
    return found


@lru_cache(maxsize=2)
def _periodic(geometry: Voxels) -> tuple[BoolArray, str]:
    """Return the solid voxels of the image as it is repeated, and a sentence on sides that were blended."""
    path = geometry.checked("cell.geometry")
    image = read_image(path, geometry.crop, grey=geometry.threshold is not None)
    if missing := image.size - np.count_nonzero(np.isfinite(image)):
        raise ConfigurationError(
            f"{path}: expected a number in every voxel, got {missing:,} of {image.size:,} that are infinite or no "
            "number; leave them out with cell.geometry.crop, or fill them"
        )
    pores = geometry.pores_of(image)
    if pores.all() or not pores.any():
        found = GreyValues.of(image)
        if len(found.values) == 1:
            key = "pore" if geometry.threshold is None else "threshold"
            why = (
                "so Otsu's method finds no two classes"
                if geometry.threshold == "otsu"
                else "so there is one phase"
            )
            raise ConfigurationError(
                f"cell.geometry.{key}: expected an image of pores and solid, got the value {found.values[0]:g} in "
                f"every voxel of {path}{'' if geometry.crop is None else ' within crop'}, {why}; check the file"
            )
        which = "every voxel" if pores.all() else "no voxel"
        level = geometry.level
        if level is None:
            if not_segmented(found, geometry.pore):
                hint = "; give 'threshold: otsu' in place of pore"
            else:
                hint = "; write " + " or ".join(f"'pore: {value:g}'" for value in found.values)
            default = (
                "" if "pore" in geometry.model_fields_set else ", which stands for pores where none is given"
            )
            raise ConfigurationError(
                f"cell.geometry.pore: {which} of {path} has the value {geometry.pore}{default}; its values are "
                f"{found.extent}{hint}"
            )
        side = "above" if geometry.bright_pores else "at or below"
        raise ConfigurationError(
            f"cell.geometry.threshold: {which} of {path} is {side} {level:g}; its values are {found.extent}; "
            f"'threshold: otsu' parts them at {found.otsu:g}"
        )
    if geometry.repeat == "layer":
        return blended(~pores, geometry.layer)
    return ~pores, ""


@lru_cache(maxsize=2)
def _cleaned(geometry: Voxels) -> Cleaned:
    found = clean(
        _periodic(geometry)[0],
        periodic=geometry.repeat != "mirror",
        drop_grains=geometry.drop_grains,
        fill_pores=geometry.fill_pores,
    )
    if found.solid.all() or not found.solid.any():
        what = "solid" if found.solid.all() else "pores"
        raise ConfigurationError(
            f"cell.geometry: only {what} are left of {geometry.path} after its pores were filled or its faces blended; "
            "give smaller values of fill_pores or layer"
        )
    found.solid.setflags(write=False)
    return found


@lru_cache(maxsize=2)
def _point_group(geometry: Voxels) -> PointGroup:
    return group_of_voxels(geometry.solid, mirror=geometry.repeat == "mirror", sides=geometry.sides)


@lru_cache(maxsize=2)
def _smooth(geometry: Voxels) -> SmoothImage:
    mirror, high = geometry.repeat == "mirror", np.array(geometry.sides) / 2
    return SmoothImage(
        geometry.solid, geometry.smoothing, np.zeros(3) if mirror else -high, high, mirror=mirror
    )


def runs(phase: BoolArray, *, periodic: bool, corners: bool = False) -> tuple[IntArray, list[str]]:
    """Return the number of the piece of each voxel, 0 outside of the phase, and by number the axes out of "xyz".

    Along these axes the piece, with its mirror or periodic images, runs through; "" for one that is closed in itself.
    Of a periodic image parts that meet across its sides have a number each, and the same axes.

    Parameters
    ----------
    phase : (n₁, n₂, n₃)
        True for the voxels of the phase.
    periodic
        True if the image repeats, else it is continued by mirrors at its sides.
    corners
        True: voxels with a common corner are joined, else those with a common face.
    """
    from scipy.ndimage import label  # slow to import

    labels, count = label(phase, np.ones((3, 3, 3)) if corners else None)
    if not periodic:
        ends = [[set(np.unique(np.take(labels, side, axis))) for side in (0, -1)] for axis in range(3)]
        # A path between two mirrors goes on in the next cell.
        through = [low & high for low, high in ends]
        return labels, [
            "",
            *(
                "".join(a for a, who in zip("xyz", through, strict=True) if i + 1 in who)
                for i in range(count)
            ),
        ]
    roots, windings = joined(count, across(labels))
    axes = {
        root: "".join(axis for axis, moves in zip("xyz", np.any(ways, axis=0), strict=True) if moves)
        for root, ways in windings.items()
    }
    return labels, ["", *(axes.get(root, "") for root in roots)]


def through_axes(axes: list[str]) -> str:
    """Return the axes along which any piece runs through."""
    return "".join(axis for axis in "xyz" if any(axis in each for each in axes))


def necks(phase: BoolArray, voxel: Array, widest: float, *, periodic: bool) -> dict[str, float]:
    """Return by axis the width of the narrowest neck on the widest way through, where it is below ``widest``.

    That is the diameter of the largest ball that gets through, to about a voxel, of which ``voxel`` holds the edges.
    """
    found: dict[str, float] = {}
    open_axes = through_axes(runs(phase, periodic=periodic)[1])
    step = float(np.min(voxel))
    for width, deep in _thinned(phase, voxel, widest + step, periodic=periodic):
        still = through_axes(runs(deep, periodic=periodic, corners=True)[1])
        found |= {axis: width for axis in open_axes if axis not in still and axis not in found}
        if len(found) == len(open_axes):
            break
    widths = {axis: max(width - step, step) for axis, width in found.items()}
    return {axis: width for axis, width in widths.items() if width < widest - 1e-9 * step}


def way_out(
    phase: BoolArray, voxel: Array, start: tuple[IntArray, ...], widest: float, *, periodic: bool
) -> float:
    """Return the width, up to ``widest``, of the narrowest neck on the widest way from a voxel through the cell."""
    step = float(np.min(voxel))
    for width, deep in _thinned(phase, voxel, widest, periodic=periodic):
        labels, axes = runs(deep, periodic=periodic, corners=True)
        if not axes[labels[start]]:
            return max(width - step, step)
    return widest


def _thinned(
    phase: BoolArray, voxel: Array, widest: float, *, periodic: bool
) -> Iterator[tuple[float, BoolArray]]:
    """Yield widths of whole voxels up to ``widest``, and the centres of the balls of that diameter in the phase."""
    from scipy.ndimage import distance_transform_edt  # slow to import

    step = float(np.min(voxel))
    # Solid beyond mirrors is never closer than that before them.
    margin = [
        min(int(widest / edge) + 1, n) if periodic else 0 for edge, n in zip(voxel, phase.shape, strict=True)
    ]
    around = np.pad(phase, [(m, m) for m in margin], mode="wrap")
    # Distances are between centres of voxels, and half a voxel less to the boundary.
    depth = (
        distance_transform_edt(around, sampling=voxel)[
            tuple(slice(m, m + n) for m, n in zip(margin, phase.shape, strict=True))
        ]
        - step / 2
    )
    for width in step * np.arange(2, max(int(np.ceil(widest / step - 1e-9)), 2) + 1):
        # The axis of a channel of an even number of voxels lies between their centres.
        yield float(width), depth >= (width - step) / 2 - 1e-9 * step


#: Voxels of a wall that lie at least at this share of half its thickness. At edges and corners of thick parts, which
#: balls do not fill either, the uncovered voxels lie at less than 0.42 of the radius of the ball.
DEEP = 0.5
#: Share of the voxels of this depth from which they are a wall and not the roughness of an image.
ROUGH = 0.01


def least_thickness(phase: BoolArray, voxel: Array, *, periodic: bool) -> float:
    """Return the thickness of the thinnest walls, struts or channels of a phase, to about a voxel.

    It is the diameter of the smallest ball that does not cover all of the phase but its edges and its roughness, while
    it lies in the phase; infinite where there is one phase only. One and two voxels are not told from each other.

    Parameters
    ----------
    phase : (n₁, n₂, n₃)
        True for the voxels of the phase.
    voxel : (3,)
        Edges of a voxel, which are the units of the result.
    periodic
        True if the image repeats, else it is continued by mirrors at its sides.

    References
    ----------
    Hildebrand & Rüegsegger (1997), A new method for the model-independent assessment of thickness in three-dimensional
    images, Journal of Microscopy 185, 67.
    """
    from scipy.ndimage import distance_transform_edt, zoom  # slow to import

    if phase.all() or not phase.any():
        return float("inf")
    step = float(np.min(voxel))
    cubes = zoom(phase, voxel / step, order=0, grid_mode=True, mode="grid-constant")
    margin = [(n // 4 + 1,) * 2 for n in cubes.shape]
    around = np.pad(cubes, margin, mode="wrap" if periodic else "symmetric")
    inner = tuple(slice(m, -m) for m, _ in margin)
    # In voxels. Distances are between their centres, and half a voxel less to the boundary.
    depth = distance_transform_edt(around) - 0.5
    for radius in np.arange(1.5, depth[inner].max(), 0.5):
        deep = (depth >= DEEP * radius)[inner]
        covered = (distance_transform_edt(depth < radius) < radius + 0.5)[inner]
        if np.count_nonzero(deep & ~covered) > ROUGH * np.count_nonzero(deep):
            return step * float(2 * radius - 0.5)
    return step * float(2 * depth[inner].max() + 0.5)
