"""Results of one sub-volume and of a study (RepresentativeVolume): record, tables, size that suffices."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.materials.material import voigt_moduli
from porocore.commands.representative.plan import Corner, Scan, SizeOutlook, SubvolumePlan
from porocore.core.echo import joined
from porocore.core.files.plain_data import json_hash, json_ready, write_csv, write_json
from porocore.core.files.reading import complete, read_json
from porocore.core.units import length_text, length_unit, units_now
from porocore.errors import DataError
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.series import require_own

#: Statuses: all results; permeability alone, of a solid that is not connected; none, for the reason in the message;
#: none, since its process ended.
SOLVED, LOOSE, FAILED, LOST = "solved", "no stiffness", "failed", "lost"
#: Results by name, with their shapes.
SHAPES: dict[str, tuple[int, ...]] = {
    "porosity": (),
    "permeability": (3, 3),
    "stiffness": (3, 3, 3, 3),
    "biot": (3, 3),
    "storage": (),
    "M": (3, 3, 3, 3),
    "Q": (3, 3),
}


@dataclass(frozen=True, eq=False)
class Subvolume:
    """Results of one sub-volume; NaN where there are none.

    Attributes
    ----------
    size, corner
        Edge, and first voxel along x, y, z.
    cell
        Identity of its cell.
    status, message
        One of ``solved``, ``no stiffness``, ``failed`` and ``lost``, and why it is not solved.
    seconds
        Time that it took, whenever that was.
    porosity : ()
        φ_f of the mesh of the solid.
    permeability : (3, 3)
        K μ_f [voxel²].
    stiffness : (3, 3, 3, 3)
        Drained, C_eff [E].
    biot : (3, 3)
        α.
    storage : ()
        1/M_B [1/E].
    M : (3, 3, 3, 3)
        ∂<∇u¹>_s/∂H at rest.
    Q : (3, 3)
        ∂<∇u¹>_s/∂p at rest [1/E].
    """

    size: int
    corner: Corner
    cell: str
    status: str
    message: str
    seconds: float
    porosity: Array
    permeability: Array
    stiffness: Array
    biot: Array
    storage: Array
    M: Array
    Q: Array

    def scalars(self) -> dict[str, float]:
        """Return the results as averages over all directions; see ``settling.QUANTITIES``."""
        k = (
            np.linalg.eigvalsh(self.permeability)
            if np.isfinite(self.permeability).all()
            else np.full(3, np.nan)
        )
        mean = float(k.mean())
        return {
            "porosity": float(self.porosity),
            "permeability": mean,
            "anisotropy": float(np.ptp(k)) / mean if mean > 0 else float("nan"),
            "modulus": voigt_moduli(self.stiffness)[0],
            "biot": float(np.trace(self.biot)) / 3,
            "storage": float(self.storage),
        }

    def as_data(self) -> dict[str, Any]:
        """Return plain data."""
        found: dict[str, Any] = json_ready({each.name: getattr(self, each.name) for each in fields(self)})
        return found

    @classmethod
    def unsolved(cls, size: int, corner: Corner, cell: str) -> Subvolume:
        """Return a sub-volume without results."""
        nothing = {name: np.full(shape, np.nan) for name, shape in SHAPES.items()}
        return cls(size, corner, cell, LOST, "", 0.0, **nothing)

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Subvolume:
        """Return what :meth:`as_data` was made of.

        Raises
        ------
        KeyError, TypeError, ValueError
            It was not.
        """
        arrays = {
            # None within becomes NaN.
            name: np.array(np.nan if data[name] is None else data[name], dtype=float).reshape(shape)
            for name, shape in SHAPES.items()
        }
        a, b, c = map(int, data["corner"])
        cell, status, message = (str(data[name]) for name in ("cell", "status", "message"))
        return cls(int(data["size"]), (a, b, c), cell, status, message, float(data["seconds"]), **arrays)


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

    def share(self, size: int) -> float:
        """Return the standard deviation of single sub-volumes of a size over their mean; infinite if it is unknown."""
        known = float(self.relative[self.sizes.index(size)]) if size in self.sizes else math.inf
        return known if math.isfinite(known) else math.inf

    def suffices(self, size: int, tolerance: float) -> bool:
        """Return whether the means are settled at a size, and one sub-volume scatters no more than a share."""
        settled = self.settled(tolerance)
        return settled is not None and settled <= size < self.sizes[-1] and self.share(size) <= tolerance

    def needed(self, size: int, tolerance: float) -> float:
        """Return how many sub-volumes of a size have a mean that is known to a share, by two standard errors."""
        return float(max(1, math.ceil((ERRORS * self.share(size) / tolerance) ** 2 - 1e-9)))


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
    """

    plan: SubvolumePlan
    scan: Scan
    outlooks: tuple[SizeOutlook, ...]
    subvolumes: tuple[Subvolume, ...]
    settling: Settling
    record: Path

    @property
    def tables(self) -> tuple[Path, Path]:
        """The tables ``sizes.csv`` and ``subvolumes.csv``."""
        return self.record.parent / "sizes.csv", self.record.parent / "subvolumes.csv"

    @property
    def pictures(self) -> tuple[Path, Path]:
        """The picture as ``rev.png`` and ``rev.svg``."""
        return self.record.parent / "rev.png", self.record.parent / "rev.svg"

    @property
    def sizes(self) -> list[int]:
        """Edges of the sub-volumes [voxels], increasing."""
        return [each.size for each in self.outlooks]

    @cached_property
    def voxels(self) -> SizeStatistics:
        """Porosity by the voxels of many sub-volumes of each size."""
        return SizeStatistics.of({each.size: list(each.porosities) for each in self.outlooks})

    def statistics(self, size: int) -> dict[str, tuple[float, float, float]]:
        """Return count, mean and standard deviation of the porosity of voxels, and of each quantity, at a size."""
        scatter = {"porosity of voxels": self.voxels, **self.settling.scatter}
        return {name: each.at(size) for name, each in scatter.items()}

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


#: Components of symmetric tensors.
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def factor(name: str, voxel: float | None) -> float:
    """Return the factor of a quantity of the record, of voxels of so many metres, to the units of the study."""
    unit = QUANTITIES[name].unit
    if unit == "permeability":
        return 1.0 if voxel is None else (voxel * length_unit(voxel)[1]) ** 2
    return units_now().factor(unit)


def titled(name: str, voxel: float | None, words: str | None = None) -> str:
    """Return the words for a quantity with its unit in brackets, such as µm² or voxels², kPa or E."""
    quantity = QUANTITIES[name]
    if quantity.unit == "permeability":
        unit = "voxels²" if voxel is None else f"{length_unit(voxel)[0]}²"
    elif quantity.unit and units_now().given:
        unit = units_now().name(quantity.unit)
    else:
        unit = {"stress": "E", "compliance": "1/E"}.get(quantity.unit, "")
    words = quantity.title if words is None else words
    return f"{words} [{unit}]" if unit else words


def edge_columns(scan: Scan, sizes: list[int]) -> tuple[str, dict[str, float]]:
    """Return the unit of the edges of sub-volumes, and its factor of voxels by the name of the edge.

    There are three edges where voxels are no cubes, and none where they have no length.
    """
    if not scan.voxel_edges:
        return "", {}
    unit, per_metre = length_unit(max(sizes) * max(scan.voxel_edges))
    names = ("edge",) if len(scan.voxel_edges) == 1 else ("edge along x", "along y", "along z")
    return unit, {name: per_metre * edge for name, edge in zip(names, scan.voxel_edges, strict=True)}


def write_tables(study: RepresentativeVolume) -> None:
    """Write ``sizes.csv`` and ``subvolumes.csv``.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    _write_sizes(study)
    _write_subvolumes(study)


def _write_sizes(study: RepresentativeVolume) -> None:
    voxel = study.scan.voxel
    unit, edges = edge_columns(study.scan, study.sizes)
    head = ["size [voxels]", *(f"{name} [{unit}]" for name in edges), "solved", "sub-volumes"]
    head += [f"porosity of voxels, {what}" for what in ("sub-volumes", "mean", "standard deviation")]
    for name, quantity in QUANTITIES.items():
        of = quantity.title
        head += [f"{of}, sub-volumes", titled(name, voxel, f"{of}, mean")]
        head += [titled(name, voxel, f"{of}, standard deviation")]
    rows = []
    for size in study.sizes:
        row: list[Any] = [size, *(size * by for by in edges.values()), *study.solved(size)]
        for name, (count, mean, deviation) in study.statistics(size).items():
            by = factor(name, voxel) if name in QUANTITIES else 1.0
            row += [int(count), mean * by, deviation * by]
        rows.append(row)
    write_csv(study.tables[0], head, rows)


def _write_subvolumes(study: RepresentativeVolume) -> None:
    voxel = study.scan.voxel
    head = ["size [voxels]", "x", "y", "z", "status", "seconds"]
    head += [titled(name, voxel) for name in QUANTITIES]
    head += [titled("permeability", voxel, f"k_{i + 1}{j + 1}") for i, j in PAIRS]
    pairs = [(a, b) for n, a in enumerate(PAIRS) for b in PAIRS[n:]]
    head += [titled("modulus", voxel, f"C_{i + 1}{j + 1}{k + 1}{m + 1}") for (i, j), (k, m) in pairs]
    head += [f"alpha_{i + 1}{j + 1}" for i, j in PAIRS]
    rows = []
    for each in study.subvolumes:
        row: list[Any] = [each.size, *each.corner, each.status, each.seconds]
        row += [value * factor(name, voxel) for name, value in each.scalars().items()]
        row += [float(each.permeability[at]) * factor("permeability", voxel) for at in PAIRS]
        row += [float(each.stiffness[*a, *b]) * factor("modulus", voxel) for a, b in pairs]
        row += [float(each.biot[at]) for at in PAIRS]
        rows.append([*row, each.message])
    write_csv(study.tables[1], [*head, "message"], rows)


def summary(study: RepresentativeVolume) -> dict[str, Any]:
    """Return sizes, means and scatter as plain data, dimensionless as the record."""
    settling, sizes = study.settling, []
    for each in study.outlooks:
        solved, tried = study.solved(each.size)
        found: dict[str, Any] = {"size": each.size, "solved": solved, "sub-volumes": tried}
        found |= {"left_out": each.left_out or None, "mesh": study.scan.mesh_sizes(each.size)}
        for name, (count, mean, deviation) in study.statistics(each.size).items():
            found[name] = {"count": int(count), "mean": mean, "deviation": deviation}
        sizes.append(found)
    ready: dict[str, Any] = json_ready(
        {
            "plan": study.plan.describe(),
            "voxel [m]": study.scan.voxel,
            "elements [voxels]": study.scan.elements,
            "tolerance": settling.tolerance,
            "settled": settling.settled,
            "settled, all": settling.settled_all,
            "enough": settling.enough,
            "sizes": sizes,
        }
    )
    return ready


def verdict(study: RepresentativeVolume) -> Iterator[str]:
    """Yield which size suffices, or why none does and what to do."""
    yield from _failures(study)
    settling, share = study.settling, f"{100 * study.settling.tolerance:g} %"
    sizes = sorted({size for name in JUDGED for size in settling.scatter[name].sizes})
    if len(sizes) < 2:
        yield from _porosity_alone(study, share)
        if study.plan.solve:
            yield "no size can be judged: sub-volumes of two sizes at least have to be solved; give more --sizes"
        return
    largest = sizes[-1]
    found = ", ".join(f"{QUANTITIES[name].title} {settling.settled[name] or '–'}" for name in JUDGED)
    yield f"means within {share} of those of {largest} voxels from this size on: {found} voxels"
    yield from _uncertain(study, largest, share)
    if settling.enough is not None:
        yield from _enough(study, settling.enough, share)
    elif settling.settled_all is not None:
        yield from _settled(study, settling.settled_all, share)
    else:
        moving = [QUANTITIES[name].title for name in JUDGED if settling.settled[name] is None]
        yield (
            f"no size suffices for {share}: {joined(moving)} still {'change' if len(moving) > 1 else 'changes'} up to "
            f"{largest} voxels; give larger --sizes, or a larger --count where single sub-volumes scatter"
        )


def _failures(study: RepresentativeVolume) -> Iterator[str]:
    failed = [each for each in study.subvolumes if each.status != SOLVED]
    for status in dict.fromkeys(each.status for each in failed):
        those = [each for each in failed if each.status == status]
        count = f"{len(those)} of {len(study.subvolumes)}"
        place = f"{list(those[0].corner)} of {those[0].size} voxels"
        yield f"{count} {status}, such as that at {place}: {those[0].message}"
    if failed:
        yield "means are those of the others, which may differ from these"


def _porosity_alone(study: RepresentativeVolume, share: str) -> Iterator[str]:
    """Yield the size from which the voxels' porosity stays; cheap, and no more than a lower bound."""
    voxels, tolerance = study.voxels, study.settling.tolerance
    if len(voxels.sizes) < 2:
        return
    enough = next((size for size in voxels.sizes if voxels.suffices(size, tolerance)), None)
    if enough is None:
        yield f"the porosity of single sub-volumes scatters by more than {share} up to {voxels.sizes[-1]} voxels"
        return
    yield (
        f"the porosity of single sub-volumes is within {share} from {enough} voxels on; permeability and stiffness "
        "need larger ones as a rule"
    )


def _uncertain(study: RepresentativeVolume, largest: int, share: str) -> Iterator[str]:
    """Yield a note where the means of the largest size, with which the others are compared, are not known."""
    doubtful = []
    for name in JUDGED:
        count, mean, deviation = study.settling.scatter[name].at(largest)
        if count < 2:
            yield (
                f"note: of {largest} voxels, with which the others are compared, one sub-volume was solved, and its "
                "scatter is not known"
            )
            return
        error = ERRORS * deviation / math.sqrt(count) / abs(mean)
        if error > study.settling.tolerance:
            doubtful.append((error, QUANTITIES[name].title))
    if doubtful:
        error, title = max(doubtful)
        yield (
            f"note: the means of {largest} voxels are known to {_percent(error)} only ({title}, two standard errors), "
            f"so that {share} may be met by chance; a larger --count tells"
        )


def _enough(study: RepresentativeVolume, size: int, share: str) -> Iterator[str]:
    scatter, name = _worst(study, size)
    yield (
        f"{size} voxels{_metres(study, size)} suffice for {share}: the means have settled, and single sub-volumes "
        f"scatter by {_percent(scatter)} at most ({QUANTITIES[name].title})"
    )
    yield from _settings(study, size)


def _settled(study: RepresentativeVolume, size: int, share: str) -> Iterator[str]:
    scatter, name = _worst(study, size)
    if not math.isfinite(scatter):
        yield (
            f"no size suffices for {share} as far as is known: the means have settled at {size} voxels, where one "
            "sub-volume alone was solved; a larger --count tells its scatter"
        )
        return
    needed = max(study.settling.scatter[each].needed(size, study.settling.tolerance) for each in JUDGED)
    yield (
        f"no single sub-volume suffices for {share}: the means have settled at {size} voxels{_metres(study, size)}, "
        f"but single sub-volumes scatter by {_percent(scatter)} there ({QUANTITIES[name].title}); the mean of "
        f"{needed:.0f} of them is known to {share}, or a larger one may suffice"
    )
    yield from _settings(study, size)


def _settings(study: RepresentativeVolume, size: int) -> Iterator[str]:
    """Yield the lines of a configuration with the sub-volume of a size that is closest to the means."""
    chosen = typical(study.subvolumes, study.settling, size)
    if chosen is None:
        return
    crop = ", ".join(f"[{first}, {first + size}]" for first in chosen.corner)
    solid, fluid = study.scan.mesh_sizes(size)
    yield (
        f"the one closest to the means: cell.geometry.crop: [{crop}] with cell.mesh: {{size: {solid:g}, fluid_size: "
        f"{fluid:g}}}"
    )


def _worst(study: RepresentativeVolume, size: int) -> tuple[float, str]:
    """Return the largest scatter of single sub-volumes of a size, and of which quantity; infinite if one is unknown."""
    return max((study.settling.scatter[name].share(size), name) for name in JUDGED)


def _metres(study: RepresentativeVolume, size: int) -> str:
    extents = study.scan.extents_of(size)
    return f", {length_text(*extents)}," if extents else ""


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
