"""Table and picture of a sweep: sweep.csv, sweep.png and sweep.svg."""

from __future__ import annotations

import numpy as np

from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_csv
from porocore.report.figures.style import png_bytes, svg_bytes
from porocore.study.sweep.figure import sweep_figure
from porocore.study.sweep.results import ParameterSweep


def write_sweep(sweep: ParameterSweep) -> None:
    """Write the table, with one row a point, and the picture.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    units, swept = sweep.units, sweep.plan.swept
    header = [units.titled(each.name, each.quantity) for each in swept]
    header += [units.titled(name, sweep.quantity(name)) for name in sweep.figures]
    values = zip(sweep.values.T, swept, strict=True)
    columns = [[units.value(float(x), each.quantity) for x in column] for column, each in values]
    columns += [column.tolist() for column in sweep.figures.values()]
    rows = zip(*columns, strict=True)
    write_csv(sweep.table, header, ([x if np.isfinite(x) else "" for x in row] for row in rows))
    figure = sweep_figure(sweep)
    for path, made in zip(sweep.pictures, (png_bytes, svg_bytes), strict=True):
        with atomic_path(path) as part:
            part.write_bytes(made(figure))
