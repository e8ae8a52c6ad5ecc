"""``porocore cell rev``: how large a sub-volume of an image has to be."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli import options
from porocore.cli.common import (
    check_workers,
    chosen_store,
    in_units_of,
    located,
    page,
    plain_table,
    read_config,
)
from porocore.cli.states import CellOption, named_cell
from porocore.core.echo import echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.commands.representative.results import RepresentativeVolume

#: Columns of a page where standard output is no terminal.
WIDTH = 150
#: Names of the results above their columns.
SHORT = {"modulus": "modulus", "biot": "Biot", "storage": "1/M_B"}


SizesOption = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        help="Edges of the sub-volumes in voxels, such as 16,32,64.",
        show_default="8 to 384, as the image, the elements, memory and an hour allow",
    ),
]
CountOption = Annotated[int, typer.Option(metavar="N", help="Sub-volumes of each size that are solved.")]
SeedOption = Annotated[int, typer.Option(metavar="N", help="Seed of the choice of their places.")]
OverlappingOption = Annotated[
    bool, typer.Option("--overlapping", help="Random places; by default sub-volumes do not overlap.")
]
CropOption = Annotated[
    bool, typer.Option("--within-crop", help="Stay in cell.geometry.crop; by default in the whole image.")
]
ElementOption = Annotated[
    float | None,
    typer.Option(
        metavar="X", help="Size of the elements in voxels.", show_default="as in the configured cell"
    ),
]
ToleranceOption = Annotated[
    float, typer.Option(metavar="X", help="Share by which results may differ, 0.05 for 5 %.")
]
PorosityOption = Annotated[bool, typer.Option("--porosity-only", help="Look at the voxels; solve nothing.")]
FolderOption = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder of record, tables and picture.")
]


def rev(
    config: options.ConfigArgument = None,
    sizes: SizesOption = None,
    count: CountOption = 4,
    seed: SeedOption = 0,
    overlapping: OverlappingOption = False,
    within_crop: CropOption = False,
    element: ElementOption = None,
    tolerance: ToleranceOption = 0.05,
    porosity_only: PorosityOption = False,
    cell: CellOption = None,
    fem: options.FemOption = None,
    workers: options.WorkersOption = None,
    out: FolderOption = Path("runs/rev"),
    resume: options.ResumeOption = False,
    as_json: options.JsonOption = False,
    store: options.StoreOption = None,
    no_store: options.NoStoreOption = False,
) -> None:
    """Find the size of a representative volume: solve sub-volumes of an image, larger and larger.

    Each sub-volume is made periodic and cleaned as cell.geometry says, with elements of the same size in voxels.
    Prints porosity, permeability, drained modulus, Biot coefficient and 1/M_B of each size, with their scatter, and the
    size that suffices. Writes rev.json, sizes.csv, subvolumes.csv, rev.png and rev.svg.
    """
    kept = chosen_store(store, no_store)
    path, settings = read_config(config, fem, cell_only=True)
    settings = named_cell(settings, cell)
    with located(path), in_units_of(settings.result_units):
        from porocore.commands.representative.plan import SubvolumePlan
        from porocore.commands.representative.results import summary, verdict
        from porocore.commands.representative.study import study_representative_volume

        check_workers(workers)
        try:
            edges = None if sizes is None else tuple(map(int, sizes.split(",")))
        except ValueError:
            raise ConfigurationError(
                f"--sizes: expected edges in voxels such as 16,32,64, got {echo(sizes)}"
            ) from None
        try:
            plan = SubvolumePlan(
                edges, count, seed, overlapping, within_crop, element, tolerance, not porosity_only
            )
        except ConfigurationError as error:
            raise ConfigurationError(f"--{error}") from None
        found = study_representative_volume(
            settings, out, plan, workers=workers, resume=resume, store=kept or False, progress=True
        )
        if as_json:
            typer.echo(json.dumps({**summary(found), "verdict": list(verdict(found))}, allow_nan=False))
            return
        _print(found)
        for line in verdict(found):
            typer.echo(line)
    for written in (found.record, *found.tables, *found.pictures):
        typer.echo(written)


def _print(found: RepresentativeVolume) -> None:
    """Print the means of each size with the standard deviation of single sub-volumes."""
    from porocore.commands.representative.results import QUANTITIES, edge_columns, factor, titled
    from porocore.report.format import number

    def text(mean: float, deviation: float) -> str:
        if not (math.isfinite(mean) and math.isfinite(deviation)):
            return number(mean, 3)
        share = abs(deviation / mean) if mean else math.inf
        return f"{number(mean, 3)} ± {100 * share:.2g} %"

    unit, edges = edge_columns(found.scan, found.sizes)
    voxel, names = found.scan.voxel, list(QUANTITIES) if found.subvolumes else []
    headings = ["voxels", *(f"{name} [{unit}]" for name in edges), "φ of voxels"]
    headings += ["solved"] if names else []
    headings += [titled(name, voxel, SHORT.get(name)) for name in names]
    table = plain_table(headings, range(len(headings)))
    for size in found.sizes:
        statistics = found.statistics(size)
        row = [str(size), *(f"{size * by:.4g}" for by in edges.values())]
        row.append(text(*statistics["porosity of voxels"][1:]))
        if names:
            solved, tried = found.solved(size)
            row.append(f"{solved} of {tried}" if tried else "–")
        for name in names:
            _, mean, deviation = statistics[name]
            by = factor(name, voxel)
            row.append(number(mean, 3) if name == "anisotropy" else text(by * mean, by * deviation))
        table.add_row(*row)
    page(WIDTH).print(table)
