"""Export of a dataset as one table with a row for each state: CSV or parquet."""

from __future__ import annotations

from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.fields.declaration import PARAMETER_AXIS
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_csv
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.records import flatten_response
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import CELL_FIELDS, Status

#: Formats by the end of the file's name.
FORMATS = (".csv", ".parquet")


def export(dataset: Dataset, out: Path, *, derivatives: bool = False) -> Path:
    """Write ``out`` in the format of its suffix; numbers lose no digit.

    Parameters
    ----------
    derivatives
        Also the first derivatives of the responses, 200 columns more, and those by the parameters.

    Raises
    ------
    ConfigurationError
        The name ends in none of :data:`FORMATS`.
    PluginError
        Parquet is asked for and pyarrow is missing.
    RunFolderError
        The file cannot be written.
    """
    if out.suffix not in FORMATS:
        raise ConfigurationError(f"--out: expected a name that ends in {' or '.join(FORMATS)}, got {out}")
    if out.suffix == ".csv":
        columns = table(dataset, derivatives=derivatives)
        cells = [map(_text, values) for values in columns.values()]
        return write_csv(out, list(columns), zip(*cells, strict=True))
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError as error:
        raise PluginError(
            f"--out with .parquet needs pyarrow, which cannot be imported here ({error}); pip install pyarrow, "
            "or choose .csv"
        ) from error
    columns = table(dataset, derivatives=derivatives)
    with atomic_path(out) as part:
        parquet.write_table(arrow.table(columns), part)
    return out


def table(dataset: Dataset, *, derivatives: bool = False) -> dict[str, list[Any]]:
    """Return the columns by name: key, status, start, seconds, H11 … H33, p, the parameters, and the responses.

    Entries of tensors have 1-based indices: ``stress_12``, ``mean_grad_31``, ``tangent_stress_grad_u_1122``; slopes end
    with the name of the parameter: ``slopes_stress_12_radius``.
    """
    states = dataset.states()
    columns: dict[str, list[Any]] = {
        "key": dataset.keys,
        "status": [],
        "start": [start or "" for start in dataset.starts()],
        "seconds": dataset.seconds().tolist(),
    }
    for i, j in product(range(3), repeat=2):
        columns[f"H{i + 1}{j + 1}"] = states.grad_u[:, i, j].tolist()
    columns["p"] = states.p.tolist()
    parameters = dataset.inputs.parameters
    if states.parameters is not None:
        columns |= dict(zip(parameters, states.parameters.T.tolist(), strict=True))
    if not len(dataset):
        return columns
    response = dataset.responses()
    columns["status"] = [Status(int(status)).name for status in response.status]
    for name, array in flatten_response(response).items():
        if name.startswith(("tangent/", "slopes/")) and not derivatives:
            continue
        by_parameter = PARAMETER_AXIS in CELL_FIELDS[name].shape and len(parameters) == array.shape[-1]
        for index in product(*map(range, array.shape[1:])):
            end = "".join(str(i + 1) for i in (index[:-1] if by_parameter else index))
            column = name.replace("/", "_") + (f"_{end}" if end else "")
            column += f"_{parameters[index[-1]]}" if by_parameter else ""
            entry: Any = (slice(None), *index)
            columns[column] = np.asarray(array[entry]).tolist()
    return columns


def _text(value: Any) -> Any:
    return repr(value) if isinstance(value, float) else value
