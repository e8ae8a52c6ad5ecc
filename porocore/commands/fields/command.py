"""``porocore cell fields`` and ``show``: local fields of one state, and the mesh of the cell."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from porocore.cli.common import chosen_store, in_units_of, interruptible, located, read_config
from porocore.cli.options import ConfigArgument, FemOption, JsonOption, NoStoreOption, StoreOption
from porocore.cli.states import (
    AtOption,
    CellOption,
    GradUOption,
    ParametersOption,
    PressureOption,
    one_cell,
    read_state,
)
from porocore.core.console import Console
from porocore.core.files.plain_data import json_ready

NoPicturesOption = Annotated[
    bool, typer.Option("--no-pictures", help="Write only what ParaView reads; pyvista is not needed.")
]


def fields(
    config: ConfigArgument = None,
    at: AtOption = None,
    grad_u: GradUOption = None,
    p: PressureOption = None,
    parameters: ParametersOption = None,
    cell: CellOption = None,
    fem: FemOption = None,
    no_pictures: NoPicturesOption = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of file and pictures.")] = Path(
        "runs/fields"
    ),
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Solve one state, by default H22=-0.1, and write its local fields.

    Writes a .vtu file of the whole cell for ParaView with the micro displacement, F, J, the strain energy density and
    stresses. Draws the micro displacement on the deformed cell and the strain energy density on the undeformed one.
    Pictures need pyvista (pip install pyvista) and no display.
    """
    kept = chosen_store(store, no_store)
    path, settings = read_config(config, fem, cell_only=True)
    with located(path):
        settings = one_cell(settings, cell, parameters)
    asked = read_state(at, grad_u, p, settings.cell.modulus, {"H22": -0.1}, settings.scales)
    with interruptible(), located(path):
        from porocore.commands.fields.solve import write_local_fields

        found = write_local_fields(
            settings, out, asked, pictures=not no_pictures, store=kept or False, tell=Console().note
        )
    from porocore.report.text import status_in_words
    from porocore.states import Status

    typer.echo(f"status: {status_in_words(Status(int(found.response.status[0])).name)}")
    if (extrema := found.response.extrema) is not None:
        from porocore.report.format import multiple

        with in_units_of(settings.result_units):
            mean, largest = (
                multiple(float(value[0]), "energy-density", 6)
                for value in (extrema.energy_mean, extrema.energy)
            )
        typer.echo(f"strain energy density: mean <Ψ>_s {mean}, largest {largest}")
    for written in (found.vtu, *found.pictures.values()):
        typer.echo(written)


def show(
    config: ConfigArgument = None,
    parameters: ParametersOption = None,
    cell: CellOption = None,
    no_pictures: NoPicturesOption = False,
    as_json: JsonOption = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of files and picture.")] = Path(
        "runs/cell"
    ),
) -> None:
    """Mesh the cell and show it; nothing is solved.

    Prints porosity, number and quality of the elements, how solid and fluid are connected from cell to cell, and
    if opposite faces match. Writes both phases as .vtu files for ParaView, and a picture.
    Pictures need pyvista (pip install pyvista) and no display.
    """
    path, settings = read_config(config, None, cell_only=True)
    with interruptible(), located(path):
        from porocore.cell.quality import measure_mesh_quality, quality_lines
        from porocore.commands.fields.pictures import render_phases, write_phases
        from porocore.core.files.atomic import new_folder

        if parameters or cell is not None:
            settings = one_cell(settings, cell, parameters)
        new_folder(out)
        quality = measure_mesh_quality(settings.cell)
        if as_json:
            typer.echo(json.dumps(json_ready(asdict(quality)), allow_nan=False))
        else:
            typer.echo("\n".join(quality_lines(quality)))
        files = write_phases(settings.cell, out, path.stem)
        written = [*files]
        if not no_pictures:
            written.append(render_phases(settings.cell, files, out / f"{path.stem}.png"))
    if not as_json:
        for file in written:
            typer.echo(file)
