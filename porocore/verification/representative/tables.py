"""Tables sizes.csv and subvolumes.csv of a study of sub-volumes, in the units of the study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from porocore.core.files.plain_data import json_ready, write_csv
from porocore.core.units.results import length_unit, spoken
from porocore.verification.representative.results import RepresentativeVolume
from porocore.verification.representative.scan import Scan
from porocore.verification.representative.settling import QUANTITIES

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
