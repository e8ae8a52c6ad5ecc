"""Checks of a dataset by laws of every cell; export as CSV or parquet; merging of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.field_check import known_statuses, rows_as_declared
from porocore.core.fields import PARAMETER_AXIS
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_csv
from porocore.errors import ConfigurationError, DataError, PluginError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import flatten_response
from porocore.sampling.campaign import OF_SAMPLES
from porocore.sampling.datasets.dataset import (
    Block,
    Dataset,
    Header,
    describe,
    read_fields,
    sole_writer,
    write_block,
)
from porocore.states import CELL_FIELDS, Array, BoolArray, CellResponse, MacroState, Status

#: Largest misfit of a law, relative to the largest entry of what is compared.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class DatasetCheck:
    """Result of one check: its name, whether it holds, and what was found."""

    name: str
    holds: bool
    detail: str


def check_file(path: Path, tolerance: float = TOLERANCE, *, named: bool = False) -> list[DatasetCheck]:
    """Check every array of the dataset at ``path``; a file that cannot be read fails one check.

    ``named`` is that of :meth:`Dataset.open`.
    """
    try:
        dataset = Dataset.open(path, sound=False, named=named)
        fields = list(read_fields(dataset.rows()))
    except DataError as error:
        return [DatasetCheck("readable", False, str(error))]
    n = len(dataset)
    findings = [DatasetCheck("readable", True, f"{n} states, {sum(f is not None for f in fields)} with u¹")]
    findings.append(DatasetCheck("keys unique", True, f"{n} keys"))  # otherwise it could not be read
    if not n:
        return findings
    response, states = dataset.responses(), dataset.states()
    keys = np.array(dataset.keys)
    valid = response.valid
    known = known_statuses(response.status)
    findings.append(_all("statuses known", known, keys, "a status that this version does not know"))
    findings.append(
        _all("finite", _finite(response), keys, "values where none belong, or none where they do")
    )
    findings += _places(dataset, states, keys)
    kept = np.array([f is None or _at(f.grad_u, f.p, states, i) for i, f in enumerate(fields)])
    findings.append(_all("fields of their states", kept, keys, "u¹ of another state"))
    held = {key for key, f in zip(dataset.keys, fields, strict=True) if f is not None}
    started = np.array(
        [start is None or start in held or start.startswith(OF_SAMPLES) for start in dataset.starts()]
    )
    findings.append(_all("starts kept", started, keys, "a start whose u¹ is not in the file"))
    if response.extrema is not None:
        upright = ~valid | (response.extrema.min_jacobian > 0)
        findings.append(_all("J > 0", upright, keys, "a smallest J that is not positive"))
    if response.conductivity is not None:
        K = np.where(np.isfinite(response.conductivity), response.conductivity, np.eye(3))
        same = np.abs(K - K.transpose(0, 2, 1)).max(axis=(1, 2)) <= tolerance * np.abs(K).max(axis=(1, 2))
        # A pore that is closed in some direction has an eigenvalue of zero.
        positive = np.linalg.eigvalsh((K + K.transpose(0, 2, 1)) / 2)
        same &= positive[:, 0] >= -tolerance * positive[:, 2]
        findings.append(_all("K positive", same, keys, "a conductivity that is not symmetric and positive"))
    return findings + _laws(response, keys, tolerance)


def _places(dataset: Dataset, states: MacroState, keys: Array) -> list[DatasetCheck]:
    x, inputs = dataset.x(), dataset.inputs
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    slack = 1e-12 * (high - low)
    inside = ((x >= low - slack) & (x <= high + slack)).all(axis=1)
    same = np.ones(len(x), dtype=bool)
    for i, row in enumerate(x):
        expected = inputs.scatter(tuple(map(float, row)))
        same[i] = all(map(np.array_equal, expected.arrays(), states[i : i + 1].arrays()))
    return [
        _all("within the ranges", inside, keys, "inputs outside the ranges of the file"),
        _all("states of their inputs", same, keys, "H, p or parameters that its inputs do not give"),
    ]


def _laws(response: CellResponse, keys: Array, tolerance: float) -> list[DatasetCheck]:
    """Check ∂P_E/∂p = −∂φ/∂H and ∂P_E/∂H = (∂P_E/∂H)ᵀ: both are second derivatives of W(H, p)."""
    tangent, rows = response.tangent, np.flatnonzero(response.valid)
    if tangent is None or not len(rows):
        return []
    findings = []
    if tangent.stress_p is not None and tangent.fluid_volume_grad_u is not None:
        ours, theirs = tangent.stress_p[rows], -tangent.fluid_volume_grad_u[rows]
        findings.append(_law("∂P_E/∂p = −∂φ/∂H", ours, theirs, keys[rows], tolerance))
    if tangent.stress_grad_u is not None:
        A = tangent.stress_grad_u[rows].reshape(-1, 9, 9)
        findings.append(_law("∂P_E/∂H symmetric", A, A.transpose(0, 2, 1), keys[rows], tolerance))
    return findings


def _law(name: str, ours: Array, theirs: Array, keys: Array, tolerance: float) -> DatasetCheck:
    n = len(ours)
    scale = np.abs(theirs.reshape(n, -1)).max(axis=1)
    misfit = np.abs(ours - theirs).reshape(n, -1).max(axis=1) / np.where(scale > 0, scale, 1.0)
    # A misfit that is no number fails too.
    worst = int(np.argmax(np.where(np.isnan(misfit), np.inf, misfit)))
    holds = bool((misfit <= tolerance).all())
    return DatasetCheck(
        name, holds, f"largest misfit {misfit[worst]:.1e} (state '{keys[worst]}', allowed {tolerance:.0e})"
    )


def _finite(response: CellResponse) -> BoolArray:
    valid, unstable = response.valid, response.status == Status.unstable
    good = np.ones(len(response), dtype=bool)
    for name, array in flatten_response(response).items():
        good &= rows_as_declared(CELL_FIELDS[name], array, valid, unstable)
    return good


def _at(grad_u: Array, p: float, states: MacroState, row: int) -> bool:
    return bool(np.array_equal(grad_u, states.grad_u[row])) and p == float(states.p[row])


def _all(name: str, good: BoolArray, keys: Array, what: str) -> DatasetCheck:
    wrong = keys[~good]
    if not len(wrong):
        return DatasetCheck(name, True, f"all {len(keys)}")
    return DatasetCheck(name, False, f"{len(wrong)} of {len(keys)} states have {what}, such as '{wrong[0]}'")


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


def merge(datasets: Sequence[Dataset], out: Path) -> Dataset:
    """Write every state of ``datasets`` once.

    Raises
    ------
    DataError
        They differ in identity, inputs or kind of responses, or hold a state of the same key with different
        results. Wall times do not count: of equal states the first is kept.
    RunFolderError
        ``out`` exists or cannot be written.
    """
    first = datasets[0]
    rows: dict[str, tuple[Block, int]] = {}
    provided = None
    for dataset in datasets:
        _check_same_kind(first, dataset)
        if len(dataset):
            names = frozenset(flatten_response(dataset.responses()))
            if provided not in (None, names):
                raise DataError(
                    f"{dataset.path}: holds other responses than {first.path}; they cannot be merged"
                )
            provided = names
        for key, row in zip(dataset.keys, dataset.rows(), strict=True):
            if key in rows:
                _check_equal(key, rows[key], row, dataset.path)
            else:
                rows[key] = row
    with sole_writer(out):
        if out.exists():
            raise RunFolderError(f"{out} exists; choose another --out, or move it elsewhere")
        ordered = [rows[key] for key in sorted(rows)]
        merged = Block.join(out, ordered, first.inputs)
        header = Header(first.inputs, first.identity, _provenance(datasets))
        write_block(out, header, merged, read_fields(ordered))
    return Dataset.open(out)


def _check_same_kind(one: Dataset, other: Dataset) -> None:
    if other.identity != one.identity:
        raise DataError(
            f"{other.path}: holds states of another cell or other settings than {one.path} (identity "
            f"{other.identity}, not {one.identity}); they cannot be merged"
        )
    if other.inputs != one.inputs:
        raise DataError(
            f"{other.path}: holds states of other inputs ({describe(other.inputs)}) than {one.path} "
            f"({describe(one.inputs)}); they cannot be merged"
        )


def _check_equal(key: str, one: tuple[Block, int], other: tuple[Block, int], path: Path) -> None:
    (a, i), (b, j) = one, other
    pairs = {"the inputs": (a.x[i], b.x[j]), "the status": (a.response.status[i], b.response.status[j])}
    ours, theirs = a.states[i : i + 1].arrays(), b.states[j : j + 1].arrays()
    pairs |= dict(zip(("H", "p", "the parameters"), zip(ours, theirs, strict=True), strict=False))
    one_row, other_row = flatten_response(a.response[i : i + 1]), flatten_response(b.response[j : j + 1])
    pairs |= {name: (one_row[name], other_row[name]) for name in one_row}
    wrong = [name for name, (x, y) in pairs.items() if not np.array_equal(x, y, equal_nan=True)]
    if a.starts[i] != b.starts[j]:
        wrong.append("the start")
    if not wrong and not _same_field(next(read_fields([one])), next(read_fields([other]))):
        wrong.append("the field")
    if wrong:
        raise DataError(
            f"{path}: state '{key}' differs from that of {a.path} in {', '.join(wrong)}, so one of the two is not what "
            "its settings give; nothing was written"
        )


def _same_field(a: CellField | None, b: CellField | None) -> bool:
    if a is None or b is None:
        return a is b
    same = a.domain == b.domain and a.p == b.p and np.array_equal(a.grad_u, b.grad_u)
    return same and np.array_equal(a.u, b.u)


def _provenance(datasets: Sequence[Dataset]) -> dict[str, str]:
    """Return the provenance of all, each text once."""
    said: dict[str, dict[str, None]] = {}
    for dataset in datasets:
        for name, text in dataset.provenance.items():
            said.setdefault(name, {})[text] = None
    found = {name: "\n".join(texts) for name, texts in said.items()}
    return found | {"merged": ", ".join(dataset.path.name for dataset in datasets)}
