"""``porocore data``: summary, check, merging, export and picture of a file of solved states."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.cli.common import interruptible
from porocore.cli.options import JsonOption
from porocore.cli.parsing import command_group
from porocore.errors import ConfigurationError, DataError, RunFolderError

if TYPE_CHECKING:
    from porocore.core.units import ResultUnits
    from porocore.sampling.datasets.dataset import Dataset

FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="Data set, or run folder.", show_default=False)
]

data = command_group(
    "Summarise (info), check, merge, export or plot files of solved states.", no_args_is_help=True
)


@data.command()
def info(
    file: FileArgument,
    provenance: Annotated[
        bool,
        typer.Option("--provenance", help="Print texts of several lines, such as the configuration, too."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Print counts, ranges, statuses and provenance.

    A run folder stands for its samples and its held-out states.
    """
    from porocore.sampling.datasets.dataset import Dataset

    with interruptible():
        found = [_facts(Dataset.open(path, named=_is_foreign(path))) for path in _files(file)]
    if as_json:
        typer.echo(json.dumps(found if len(found) > 1 else found[0], allow_nan=False))
        return
    for k, facts in enumerate(found):
        typer.echo(("\n" if k else "") + _as_text(facts, provenance, _units(file)))


@data.command()
def check(
    file: FileArgument,
    tolerance: Annotated[
        float,
        typer.Option(metavar="X", help="Largest misfit of a law, relative to the largest entry.", min=0.0),
    ] = 1e-6,
) -> None:
    """Read every array, checksums included, and check the contents.

    Keys must be unique; states with values must be finite, and the others hold none; inputs must lie in their ranges;
    ∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H must be symmetric. Exit status 1 if a check fails.
    """
    from porocore.sampling.datasets.check import check_file

    sound = True
    with interruptible():
        for path in _files(file):
            typer.echo(path)
            for finding in check_file(path, tolerance, named=_is_foreign(path)):
                typer.echo(f"  {'ok  ' if finding.holds else 'FAIL'}  {finding.name}: {finding.detail}")
                sound &= finding.holds
    if not sound:
        raise typer.Exit(1)


@data.command()
def merge(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE FILE …", help="Data sets, or run folders.", show_default=False),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", help="The new data set; missing folders are made.", show_default=False
        ),
    ],
) -> None:
    """Merge data sets of the same cell and inputs.

    A state of several data sets must be the same in all, to the last bit; otherwise nothing is written.
    Prints the path.
    """
    from porocore.sampling.datasets.check import merge as merged

    if len(files) < 2:
        raise ConfigurationError("expected at least two files to merge, got one")
    with interruptible():
        dataset = merged([_opened(path) for path in files], _fresh(out))
    typer.echo(f"{len(dataset)} states", err=True)
    typer.echo(out)


@data.command()
def export(
    file: FileArgument,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Table, .csv or .parquet; missing folders are made.",
            show_default=False,
        ),
    ],
    derivatives: Annotated[
        bool,
        typer.Option("--derivatives", help="Write the derivatives of the responses, too, some 200 columns."),
    ] = False,
) -> None:
    """Write a table with a row for each state.

    The columns are key, status, start, seconds, H11 … H33, p and the responses, with all digits. Prints the path.
    """
    from porocore.sampling.datasets.check import export as exported

    with interruptible():
        typer.echo(exported(_opened(file), _fresh(out), derivatives=derivatives))


@data.command()
def plot(
    file: FileArgument,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Picture, .png or .svg; missing folders are made.",
            show_default=False,
        ),
    ],
    axes: Annotated[
        str | None,
        typer.Option(
            "--axes",
            metavar="NAME,NAME",
            help="Inputs of the horizontal and the vertical axis.",
            show_default="H22,p or the first two",
        ),
    ] = None,
) -> None:
    """Draw the solved states and their statuses.

    The outline encloses the stable states, from which a surrogate learns. Prints the path.
    """
    if out.suffix not in (".png", ".svg"):
        raise ConfigurationError(f"--out: expected a name that ends in .png or .svg, got {out}")
    with interruptible():
        dataset = _opened(file)
        pair = None if axes is None else _pair(axes, dataset)
        response = dataset.responses()
        _fresh(out)
        from porocore.report.figures.sampling import samples_figure
        from porocore.report.figures.style import write_pictures

        figure = samples_figure(
            dataset.inputs, dataset.x(), response.status, training=response.stable, pair=pair
        )
        write_pictures(figure, out)
    typer.echo(out)


def _files(target: Path) -> list[Path]:
    """Return the data sets of a run folder, or the file itself."""
    first = _samples(target)
    held_out = target / "test.h5"
    return [first, held_out] if target.is_dir() and held_out.exists() else [first]


def _samples(target: Path) -> Path:
    """Return the samples of a run folder, or the file itself.

    Raises
    ------
    DataError
        There is no file and no folder.
    RunFolderError
        The folder holds no run, or one without samples.
    """
    from porocore.core.files.atomic import RUN_RECORD
    from porocore.core.files.claim import some_of
    from porocore.core.files.reading import obstacle
    from porocore.sampling.datasets.dataset import EXPECTED
    from porocore.study.run.folder import RunFolder

    if not target.exists():
        raise DataError(f"{target}: {obstacle(target) or 'no such file or folder'}; expected a {EXPECTED}")
    if not target.is_dir():
        return target
    if not os.path.lexists(target / RUN_RECORD):
        inside = [path.name for path in sorted(target.glob("*.h5"))]
        files = f"; the HDF5 files in it are {some_of(inside)}" if inside else ""
        raise RunFolderError(
            f"{target} is not a run folder (it has no {RUN_RECORD}); expected a {EXPECTED}{files}"
        )
    folder = RunFolder.open(target)
    return folder.require(folder.dataset, "sample")


def _is_foreign(path: Path) -> bool:
    """Return True for a file that is no data set of a run folder, which 'porocore sample' would not make again."""
    from porocore.core.files.atomic import RUN_RECORD

    if not (path.parent / RUN_RECORD).is_file():
        return True
    from porocore.study.run.folder import DATA_SETS

    return path.name not in DATA_SETS


def _opened(target: Path) -> Dataset:
    """Return the data set that a user named, or the samples of a run folder."""
    from porocore.sampling.datasets.dataset import Dataset

    path = _samples(target)
    return Dataset.open(path, named=_is_foreign(path))


def _fresh(out: Path) -> Path:
    from porocore.core.files.atomic import place_for

    place_for(out)
    if os.path.lexists(out):
        raise RunFolderError(f"{out} exists; choose another --out, or move it elsewhere")
    return out


def _pair(axes: str, dataset: Dataset) -> tuple[str, str]:
    names = tuple(name.strip() for name in axes.split(","))
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(dataset.inputs.names):
        raise ConfigurationError(
            f"--axes: expected two of {', '.join(dataset.inputs.names)} with a comma between, got '{axes}'"
        )
    return names[0], names[1]


def _facts(dataset: Dataset) -> dict[str, Any]:
    import numpy as np

    from porocore.interfaces.records import flatten_response
    from porocore.sampling.datasets.dataset import read_fields
    from porocore.states import Status

    n = len(dataset)
    x = dataset.x()
    status = dataset.responses().status if n else np.zeros(0, dtype=int)
    seconds = dataset.seconds()
    conductivity = dataset.responses().conductivity if n else None
    known = {}
    if conductivity is not None:
        known["with_conductivity"] = int(np.isfinite(conductivity).all(axis=(1, 2)).sum())
    inputs = {
        name: {
            "range": [dataset.inputs.lower[i], dataset.inputs.upper[i]],
            "found": [float(x[:, i].min()), float(x[:, i].max())] if n else None,
        }
        for i, name in enumerate(dataset.inputs.names)
    }
    return {
        "path": str(dataset.path),
        "bytes": dataset.path.stat().st_size,
        "states": n,
        "not_merged": dataset.unmerged,
        "statuses": {s.name: int((status == s).sum()) for s in Status if (status == s).any()},
        "inputs": inputs,
        "responses": sorted(flatten_response(dataset.responses())) if n else [],
        **known,
        "fields": sum(kept is not None for kept in read_fields(dataset.rows())),
        "seconds": {"sum": float(seconds.sum()), "median": float(np.median(seconds)) if n else None},
        "identity": dataset.identity,
        "provenance": dataset.provenance,
    }


def _units(target: Path) -> ResultUnits:
    """Return the units of the study of a run folder; a file alone has none."""
    from porocore.core.units import ResultUnits
    from porocore.study.run.folder import RunFolder

    return RunFolder.open(target).written.result_units if target.is_dir() else ResultUnits()


def _input_range(name: str, told: dict[str, Any], units: ResultUnits) -> str:
    """Return sampled and found range of an input; a pressure without scales is a multiple of E."""
    quantity = "pressure" if name == "p" else ""
    unit = f" {units.name(quantity) if units.given else 'E'}" if quantity else ""

    def between(ends: list[float]) -> str:
        low, high = (end * units.factor(quantity) for end in ends)
        return f"[{low:g}, {high:g}]{unit}"

    found = "nothing yet" if told["found"] is None else f"found {between(told['found'])}"
    return f"  {name} in {between(told['range'])}, {found}"


def _as_text(facts: dict[str, Any], whole: bool, units: ResultUnits) -> str:
    from porocore.core.console import duration

    megabytes = facts["bytes"] / 1e6
    statuses = [f"{count} {name.replace('_', ' ')}" for name, count in facts["statuses"].items()]
    lines = [
        f"{facts['path']}: {facts['states']} states, {megabytes:.3g} MB, identity {facts['identity']}",
        f"  statuses: {', '.join(statuses) or 'none'}",
    ]
    lines += [_input_range(name, told, units) for name, told in facts["inputs"].items()]
    if facts["states"]:
        lines.append(f"  responses: {', '.join(facts['responses'])}")
        if "with_conductivity" in facts:
            rest = facts["states"] - facts["with_conductivity"]
            why = f"; in {rest} the fluid's mesh cannot follow walls that touch, or the solid has no values"
            lines.append(
                f"  conductivity of the deformed pore: of {facts['with_conductivity']} states{why if rest else ''}"
            )
        seconds = facts["seconds"]
        lines.append(
            f"  solves: {duration(seconds['sum'])} in all, {duration(seconds['median'])} each (median); "
            f"{facts['fields']} with u¹"
        )
    if facts["not_merged"]:
        lines.append(f"  {facts['not_merged']} solves in files of their own: sampling runs or was stopped")
    for name, text in facts["provenance"].items():
        rows = text.splitlines()
        if len(rows) <= 1:
            lines.append(f"  {name}: {text}")
        elif whole:
            lines += [f"  {name}:", *(f"    {row}" for row in rows)]
        else:
            lines.append(f"  {name}: {len(rows)} lines (--provenance shows them)")
    return "\n".join(lines)
