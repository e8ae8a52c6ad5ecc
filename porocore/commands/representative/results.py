"""Results of a study of sub-volumes (RepresentativeVolume): files, record, which size suffices."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.representative.outlook import SizeOutlook
from porocore.commands.representative.plan import SubvolumePlan
from porocore.commands.representative.scan import LOST, SOLVED, Scan, Subvolume
from porocore.core.files.plain_data import json_hash, write_json
from porocore.core.files.reading import complete, read_json
from porocore.errors import DataError
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.series import require_own


@dataclass(frozen=True)
class ScalarResult:
    """A result of a sub-volume as one number.

    Attributes
    ----------
    title, symbol
        Words, and the formula for figures.
    unit
        Quantity of :mod:`porocore.core.units`; permeability has a unit of its own.
    judged
        True if it counts in the choice of a size.
    """

    title: str
    symbol: str
    unit: str
    judged: bool = True


#: By the names in :meth:`Subvolume.scalars`.
QUANTITIES: dict[str, ScalarResult] = {
    "porosity": ScalarResult("porosity", r"\varphi_f", ""),
    "permeability": ScalarResult("permeability", r"\mathrm{tr}\,\mathbf{k}/3", "permeability"),
    "anisotropy": ScalarResult("anisotropy", r"(k_{max} - k_{min})\,/\,\bar{k}", "", judged=False),
    "modulus": ScalarResult("drained modulus", r"E_d", "stress"),
    "biot": ScalarResult("Biot coefficient", r"\mathrm{tr}\,\mathbf{\alpha}/3", ""),
    "storage": ScalarResult("storage", r"1/M_B", "compliance"),
}
JUDGED = tuple(name for name, quantity in QUANTITIES.items() if quantity.judged)
#: Standard errors that the mean of several sub-volumes may be off.
ERRORS = 2.0


@dataclass(frozen=True, eq=False)
class SizeStatistics:
    """One quantity over the sub-volumes of each of n sizes; NaN where it is not known.

    Attributes
    ----------
    sizes
        Those that have a value, increasing.
    count, mean : (n,)
        Number of values and their mean.
    deviation : (n,)
        Standard deviation of single sub-volumes, of two at least.
    """

    sizes: tuple[int, ...]
    count: Array
    mean: Array
    deviation: Array

    @classmethod
    def of(cls, values: Mapping[int, Sequence[float]]) -> SizeStatistics:
        """Return the statistics of values by size, of which those that are not finite are left out."""
        known = {size: np.array([v for v in given if math.isfinite(v)]) for size, given in values.items()}
        known = {size: given for size, given in sorted(known.items()) if len(given)}
        count = np.array([float(len(given)) for given in known.values()])
        mean = np.array([float(given.mean()) for given in known.values()])
        several = [float(given.std(ddof=1)) if len(given) > 1 else np.nan for given in known.values()]
        return cls(tuple(known), count, mean, np.array(several))

    @property
    def relative(self) -> Array:
        """Standard deviation of single sub-volumes over their mean, (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.deviation == 0, 0.0, self.deviation / np.abs(self.mean))

    def at(self, size: int) -> tuple[float, float, float]:
        """Return count, mean and standard deviation at a size; NaN and no count where there is none."""
        if size not in self.sizes:
            return 0.0, math.nan, math.nan
        i = self.sizes.index(size)
        return float(self.count[i]), float(self.mean[i]), float(self.deviation[i])

    def settled(self, tolerance: float) -> int | None:
        """Return the least size from which all means lie within a share of that of the largest size; None: none."""
        if len(self.sizes) < 2:
            return None
        near = np.abs(self.mean - self.mean[-1]) <= tolerance * abs(self.mean[-1])
        first = len(near) - int(np.argmin(near[::-1])) if not near.all() else 0
        return self.sizes[first] if first < len(near) - 1 else None

    def suffices(self, size: int, tolerance: float) -> bool:
        """Return whether the means are settled at a size, and one sub-volume scatters no more than a share."""
        settled = self.settled(tolerance)
        known = settled is not None and settled <= size and size in self.sizes[:-1]
        return known and bool(self.relative[self.sizes.index(size)] <= tolerance)

    def needed(self, size: int, tolerance: float) -> float:
        """Return how many sub-volumes of a size have a mean that is known to a share, by two standard errors."""
        return float(
            max(1, math.ceil((ERRORS * self.relative[self.sizes.index(size)] / tolerance) ** 2 - 1e-9))
        )


@dataclass(frozen=True, eq=False)
class Settling:
    """Sizes at which the quantities settle.

    Attributes
    ----------
    tolerance
        Share by which they may differ.
    scatter
        Of each quantity by name, such as ``permeability``.
    settled
        Size from which the means of each judged quantity stay, None where they do not.
    settled_all
        The largest of these; None if one is missing.
    enough
        Size of which one sub-volume suffices for all; None if there is none.
    """

    tolerance: float
    scatter: dict[str, SizeStatistics]
    settled: dict[str, int | None]
    settled_all: int | None
    enough: int | None


def judge(subvolumes: Sequence[Subvolume], tolerance: float) -> Settling:
    """Judge which size suffices.

    Means settle at the least size from which they stay within ``tolerance`` of that of the largest size. One sub-volume
    suffices of the least size at which moreover the standard deviation is within it. The largest size settles nothing,
    since there is none to compare it with.

    References
    ----------
    Kanit, Forest, Galliet, Mounoury & Jeulin (2003), Determination of the size of the representative volume element for
    random composites: statistical and numerical approach, International Journal of Solids and Structures 40, 3647.
    """
    values: dict[str, dict[int, list[float]]] = {name: {} for name in QUANTITIES}
    for each in subvolumes:
        for name, value in each.scalars().items():
            values[name].setdefault(each.size, []).append(value)
    scatter = {name: SizeStatistics.of(by_size) for name, by_size in values.items()}
    settled = {name: scatter[name].settled(tolerance) for name in JUDGED}
    sizes = [value for value in settled.values() if value is not None]
    settled_all = max(sizes) if len(sizes) == len(settled) else None
    enough = [
        size
        for size in sorted({each.size for each in subvolumes})
        if all(scatter[name].suffices(size, tolerance) for name in JUDGED)
    ]
    return Settling(tolerance, scatter, settled, settled_all, enough[0] if enough else None)


def typical(subvolumes: Sequence[Subvolume], settling: Settling, size: int) -> Subvolume | None:
    """Return the sub-volume of a size whose judged results lie closest to their means; None if none is solved."""

    def distance(each: Subvolume) -> float:
        found = each.scalars()
        means = [settling.scatter[name].at(size)[1] for name in JUDGED]
        return sum(
            abs(found[name] / mean - 1) if mean else 0.0 for name, mean in zip(JUDGED, means, strict=True)
        )

    known = [(distance(each), each) for each in subvolumes if each.size == size]
    known = [(far, each) for far, each in known if math.isfinite(far)]
    return min(known, key=lambda pair: pair[0])[1] if known else None


@dataclass(frozen=True, eq=False)
class RepresentativeVolume:
    """Results of a study and the files that show them.

    Attributes
    ----------
    plan
        What was asked for.
    scan
        The image and how cells are made of it.
    outlooks
        Sizes with the porosities of their voxels, expected costs, and why some were not solved.
    subvolumes
        Results of single sub-volumes, by size.
    settling
        Sizes at which the results settle.
    record
        ``rev.json``, dimensionless, with all tensors.
    tables
        ``sizes.csv`` and ``subvolumes.csv``.
    pictures
        ``rev.png`` and ``rev.svg``.
    """

    plan: SubvolumePlan
    scan: Scan
    outlooks: tuple[SizeOutlook, ...]
    subvolumes: tuple[Subvolume, ...]
    settling: Settling
    record: Path
    tables: tuple[Path, ...] = ()
    pictures: tuple[Path, ...] = ()

    @cached_property
    def voxels(self) -> SizeStatistics:
        """Porosity by the voxels of many sub-volumes of each size."""
        return SizeStatistics.of({each.size: list(each.porosities) for each in self.outlooks})

    def solved(self, size: int) -> tuple[int, int]:
        """Return how many sub-volumes of a size have all results, and how many were tried."""
        tried = [each for each in self.subvolumes if each.size == size]
        return sum(each.status == SOLVED for each in tried), len(tried)


FILE = "rev.json"
FORMAT, VERSION = "porocore-representative-volume", 1


def identity_of(config: RunConfig, scan: Scan) -> str:
    """Return the hash of all that the sub-volumes have in common: image, making of cells, elements, backend."""
    cell = {
        **config.cell.specification(),
        "mesh": {**config.cell.mesh.model_dump(), "size": 0, "fluid_size": 0},
    }
    geometry = {**cell["geometry"], "crop": None}
    parts = [{**cell, "geometry": geometry}, scan.elements, config.fem.model_dump()]
    return json_hash(parts, sort_keys=True, default=str)


def holds_results(path: Path) -> bool:
    """Return whether a record is there that must not be replaced: any but one of the porosity alone."""
    if not path.exists():
        return False
    try:
        return bool(read_json(path)["subvolumes"])
    except (OSError, ValueError, KeyError, TypeError):
        return True


def load(path: Path, identity: str) -> dict[str, Subvolume]:
    """Return the sub-volumes of a record by the identities of their cells, but those that were lost.

    Raises
    ------
    DataError
        The file is damaged, or of another image, way to make cells, or backend.
    """
    with complete(path, "record of sub-volumes", "start again"):
        document = read_json(path)
        if (document["format"], document["version"]) != (FORMAT, VERSION):
            raise DataError(
                f"{path}: expected {FORMAT} version {VERSION}; choose another --out, or move it elsewhere"
            )
        what = "sub-volumes of another image, cell, element size or backend"
        require_own(path, document["identity"], identity, what)
        known = [Subvolume.from_data(each) for each in document["subvolumes"]]
    return {each.cell: each for each in known if each.status != LOST}


def save(path: Path, identity: str, subvolumes: Iterable[Subvolume], **more: Any) -> None:
    """Write the record, dimensionless: permeability in voxels², moduli in E.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    document = {"format": FORMAT, "version": VERSION, "identity": identity, **more}
    write_json(path, {**document, "subvolumes": [each.as_data() for each in subvolumes]}, allow_nan=False)
