"""Merging of several datasets of the same cell and inputs into one file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from porocore.errors import DataError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import flatten_response
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.datasets.layout import Block, Header, read_fields, write_block
from porocore.sampling.datasets.lock import sole_writer
from porocore.sampling.datasets.parts import describe


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
