"""Tables of a study of sub-volumes, and its outcome in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from porocore.commands.representative.results import (
    ERRORS,
    JUDGED,
    QUANTITIES,
    RepresentativeVolume,
    typical,
)
from porocore.commands.representative.scan import SOLVED, Scan, Subvolume
from porocore.core.echo import joined
from porocore.core.files.plain_data import json_ready, write_csv
from porocore.core.units import length_text, length_unit, spoken

#: Components of symmetric tensors.
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def factor(name: str, voxel: float | None) -> float:
    """Return the factor of a quantity of the record, of voxels of so many metres, to the units of the study."""
    unit = QUANTITIES[name].unit
    if unit == "permeability":
        return 1.0 if voxel is None else (voxel * length_unit(voxel)[1]) ** 2
    return spoken().factor(unit)


def unit_name(name: str, voxel: float | None) -> str:
    """Return the unit of a quantity, such as µm² or voxels², kPa or E; empty for a plain number."""
    unit = QUANTITIES[name].unit
    if unit == "permeability":
        return "voxels²" if voxel is None else f"{length_unit(voxel)[0]}²"
    if unit and spoken().given:
        return spoken().name(unit)
    return {"stress": "E", "compliance": "1/E"}.get(unit, "")


def titled(name: str, voxel: float | None, words: str | None = None) -> str:
    """Return the words for a quantity with its unit in brackets."""
    unit, words = unit_name(name, voxel), QUANTITIES[name].title if words is None else words
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


def write_tables(folder: Path, study: RepresentativeVolume) -> tuple[Path, Path]:
    """Write ``sizes.csv`` and ``subvolumes.csv``, and return their paths.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    return _write_sizes(folder / "sizes.csv", study), _write_subvolumes(folder / "subvolumes.csv", study)


def _write_sizes(path: Path, study: RepresentativeVolume) -> Path:
    voxel, settling = study.scan.voxel, study.settling
    unit, edges = edge_columns(study.scan, [each.size for each in study.outlooks])
    head = ["size [voxels]", *(f"{name} [{unit}]" for name in edges), "solved", "sub-volumes"]
    head += [f"porosity of voxels, {what}" for what in ("sub-volumes", "mean", "standard deviation")]
    for name in QUANTITIES:
        of = QUANTITIES[name].title
        head += [f"{of}, sub-volumes", titled(name, voxel, f"{of}, mean")]
        head += [titled(name, voxel, f"{of}, standard deviation")]
    rows = []
    for each in study.outlooks:
        count, mean, deviation = study.voxels.at(each.size)
        row: list[Any] = [each.size, *(each.size * by for by in edges.values()), *study.solved(each.size)]
        row += [int(count), mean, deviation]
        for name in QUANTITIES:
            count, mean, deviation = settling.scatter[name].at(each.size)
            row += [int(count), mean * factor(name, voxel), deviation * factor(name, voxel)]
        rows.append(row)
    return write_csv(path, head, rows)


def _write_subvolumes(path: Path, study: RepresentativeVolume) -> Path:
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
    return write_csv(path, [*head, "message"], rows)


def summary(study: RepresentativeVolume) -> dict[str, Any]:
    """Return sizes, means and scatter as plain data, dimensionless as the record."""
    settling, sizes = study.settling, []
    for each in study.outlooks:
        count, mean, deviation = study.voxels.at(each.size)
        solved, tried = study.solved(each.size)
        found: dict[str, Any] = {"size": each.size, "solved": solved, "sub-volumes": tried}
        found |= {"left_out": each.left_out or None, "mesh": study.scan.mesh_sizes(each.size)}
        found["porosity of voxels"] = {"count": int(count), "mean": mean, "deviation": deviation}
        for name, scatter in settling.scatter.items():
            count, mean, deviation = scatter.at(each.size)
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
        yield f"{count} {status}, such as that at {_place(those[0])}: {those[0].message}"
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
    found = []
    for name in JUDGED:
        scatter = study.settling.scatter[name]
        relative = float(scatter.relative[scatter.sizes.index(size)]) if size in scatter.sizes else math.nan
        found.append((relative if math.isfinite(relative) else math.inf, name))
    return max(found)


def _metres(study: RepresentativeVolume, size: int) -> str:
    extents = study.scan.extents_of(size)
    return f", {length_text(*extents)}," if extents else ""


def _place(each: Subvolume) -> str:
    return f"{list(each.corner)} of {each.size} voxels"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
