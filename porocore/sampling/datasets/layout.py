"""HDF5 layout of solved states: blocks of rows written and read, fields u¹ read row by row.

Layout, n rows sorted by key, d sampled inputs, the last m of them parameters of the cell: attributes ``format``,
``version``, ``identity``; ``inputs/names, lower, upper`` (d), ``inputs/parameters`` (m),
``inputs/used`` (k, m); ``provenance/*`` (texts);
``key``, ``start`` (n, text, empty: from the undeformed cell; ``samples: `` and a key: from a state of the samples
beside this file); ``x`` (n, d); ``grad_u`` (n, 3, 3); ``p``, ``seconds``, ``status`` (n); ``parameters`` (n, m);
``response/*`` as in :data:`porocore.states.CELL_FIELDS`; ``field/domain`` (n, text, empty: no field),
``field/grad_u``, ``field/p``, ``field/end`` (n), where its rows of ``field/u`` (all nodes, 3) end and those of the
next row begin. Without parameters there is no array of them. Every array carries checksums.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from porocore.core.echo import cut
from porocore.core.fields.check import response_fault
from porocore.core.hdf5 import Contents, atomic_hdf5, opened
from porocore.core.inputs.input_space import InputSpace
from porocore.errors import DataError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import SolvedState, build_response, flatten_response
from porocore.states import CELL_FIELDS, Array, CellResponse, MacroState

FORMAT, VERSION = "porocore-dataset", 1
CHUNK_NODES = 1024
TEXT = h5py.string_dtype()
#: What a user can name where a data set is expected.
EXPECTED = "data set of porocore, such as samples.h5 of a run folder, or that folder"


@dataclass(frozen=True)
class Header:
    """Data that all rows of a file share."""

    inputs: InputSpace
    identity: str
    provenance: dict[str, str]


@dataclass(frozen=True, eq=False)
class Block:
    """Rows of one file without the fields, which stay on the disk."""

    path: Path
    keys: list[str]
    starts: list[str]
    x: Array
    states: MacroState
    seconds: Array
    response: CellResponse

    @classmethod
    def empty(cls, path: Path, inputs: InputSpace) -> Block:
        """Return a block without rows."""
        response = CellResponse(np.zeros((0, 3, 3)), np.zeros(0, dtype=np.int64))
        x = np.zeros((0, len(inputs)))
        return cls(path, [], [], x, inputs.scatter(x), np.zeros(0), response)

    @classmethod
    def from_record(cls, path: Path, record: SolvedState) -> Block:
        """Return a block of one row."""
        x, seconds = np.array([record.x], dtype=float), np.array([record.seconds])
        return cls(path, [record.key], [record.start or ""], x, record.state, seconds, record.response)

    @classmethod
    def join(cls, path: Path, rows: list[tuple[Block, int]], inputs: InputSpace) -> Block:
        """Return the given rows of the given blocks in this order, for a file at ``path``."""
        if not rows:
            return cls.empty(path, inputs)
        blocks = list({id(block): block for block, _ in rows}.values())
        lengths = [len(block.keys) for block in blocks]
        first = dict(zip(map(id, blocks), np.cumsum([0, *lengths[:-1]]), strict=True))
        order = np.array([first[id(block)] + row for block, row in rows])
        return cls(
            path,
            [block.keys[row] for block, row in rows],
            [block.starts[row] for block, row in rows],
            np.concatenate([block.x for block in blocks])[order],
            MacroState.concatenate([block.states for block in blocks])[order],
            np.concatenate([block.seconds for block in blocks])[order],
            CellResponse.concatenate([block.response for block in blocks])[order],
        )


def write_block(path: Path, header: Header, block: Block, fields: Iterable[CellField | None]) -> None:
    """Write one file, whole or not at all.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    with atomic_hdf5(path) as file:
        _write(file, header, block, fields)


def _write(file: Any, header: Header, block: Block, fields: Iterable[CellField | None]) -> None:
    file.attrs.update(format=FORMAT, version=VERSION, identity=header.identity)
    file.create_dataset("inputs/names", data=list(header.inputs.names), dtype=TEXT)
    file["inputs/lower"], file["inputs/upper"] = header.inputs.lower, header.inputs.upper
    if header.inputs.parameters:
        file.create_dataset("inputs/parameters", data=list(header.inputs.parameters), dtype=TEXT)
    if header.inputs.used:
        file["inputs/used"] = np.array(header.inputs.used)
    for name, text in header.provenance.items():
        file.create_dataset(f"provenance/{name}", data=text, dtype=TEXT)
    file.create_dataset("key", data=block.keys, shape=(len(block.keys),), dtype=TEXT)
    file.create_dataset("start", data=block.starts, shape=(len(block.keys),), dtype=TEXT)
    arrays = {
        "x": block.x,
        "grad_u": block.states.grad_u,
        "p": block.states.p,
        "seconds": block.seconds,
        "status": block.response.status,
    }
    if block.states.parameters is not None:
        arrays["parameters"] = block.states.parameters
    arrays |= {f"response/{name}": array for name, array in flatten_response(block.response).items()}
    nodes = file.create_dataset(
        "field/u", (0, 3), "f8", maxshape=(None, 3), chunks=(CHUNK_NODES, 3), fletcher32=True
    )
    domains, grad_u, p, ends, end = [], [], [], [], 0
    for kept in fields:
        if kept is not None:
            nodes.resize(end + len(kept.u), axis=0)
            nodes[end:] = kept.u
            end += len(kept.u)
        domains.append("" if kept is None else kept.domain)
        grad_u.append(np.zeros((3, 3)) if kept is None else kept.grad_u)
        p.append(0.0 if kept is None else kept.p)
        ends.append(end)
    file.create_dataset("field/domain", data=domains, shape=(len(domains),), dtype=TEXT)
    arrays["field/grad_u"], arrays["field/p"] = np.array(grad_u).reshape(-1, 3, 3), np.array(p, dtype=float)
    arrays["field/end"] = np.array(ends, dtype=np.int64)
    for name, array in arrays.items():
        file.create_dataset(name, data=array, fletcher32=array.size > 0)


def read_block(path: Path, then: str | None, *, sound: bool = True) -> tuple[Header, Block]:
    """Return header and rows of one file, without the fields.

    Parameters
    ----------
    path
        The file.
    then
        What makes a file anew that cannot be read; None: a user named the file.
    sound
        Refuse rows with missing or unexpected numbers and unknown statuses; False to examine them.

    Raises
    ------
    DataError
        The file is missing, truncated, damaged, foreign or of another version.
    """
    with _reading(path, then) as file:
        form = file.attribute("format", str) if "format" in file.attributes else ""
        if form != FORMAT:
            other = f" but a {cut(form)}" if form.startswith("porocore-") else ""
            advice = f"expected a {EXPECTED}" if then is None else f"move it elsewhere and {then}"
            raise DataError(f"{path}: an HDF5 file, but no dataset of porocore{other}; {advice}")
        if (version := file.attribute("version", int)) != VERSION:
            advice = "use the porocore that made it" if then is None else f"move it elsewhere and {then}"
            raise DataError(f"{path}: is a dataset of version {version}, expected {VERSION}; {advice}")
        names = tuple(file.texts("inputs/names", "d"))
        low, high = (tuple(map(float, file.array(f"inputs/{end}", "d"))) for end in ("lower", "upper"))
        parameters = tuple(file.texts("inputs/parameters", "m")) if "inputs/parameters" in file else ()
        used: tuple[tuple[float, ...], ...] = ()
        if "inputs/used" in file:
            used = tuple(map(tuple, file.array("inputs/used", "k", "m").tolist()))
        inputs = InputSpace(names, low, high, parameters, used)
        provenance = {name: file.text(f"provenance/{name}") for name in file.members("provenance")}
        keys = file.texts("key", "n")
        if len(set(keys)) < len(keys):
            raise ValueError("two of its states have the same key")
        block = Block(
            path,
            keys,
            file.texts("start", "n"),
            file.array("x", "n", "d"),
            MacroState(
                file.array("grad_u", "n", 3, 3),
                file.array("p", "n"),
                file.array("parameters", "n", "m") if parameters else None,
            ),
            file.array("seconds", "n"),
            read_response(file),
        )
        if sound and (fault := response_fault(block.response, len(keys), len(parameters) or None)):
            raise ValueError(fault)
        _Fields(file)  # what it says of them belongs together
        return Header(inputs, file.attribute("identity", str), provenance), block


def read_response(file: Contents, group: str = "") -> CellResponse:
    """Return the status and the responses of n states below a group, of the declared shapes.

    Raises
    ------
    ValueError
        Something is there that is no response, or of another shape.
    """
    head = f"{group}/" if group else ""
    arrays = {}
    for name in file.arrays_below(f"{head}response"):
        if name not in CELL_FIELDS:
            raise ValueError(f"'{head}response/{name}' is no response")
        arrays[name] = file.array(
            f"{head}response/{name}", f"{head}n", *CELL_FIELDS[name].shape, finite=False
        )
    status = file.array(f"{head}status", f"{head}n", kind="int")
    if not arrays and not len(status):
        return CellResponse(np.zeros((0, 3, 3)), status)
    return build_response(status, arrays)


def read_fields(rows: list[tuple[Block, int]]) -> Iterator[CellField | None]:
    """Yield the fields of the given rows of the given blocks; None where none was kept.

    Raises
    ------
    DataError
        A file has gone or is damaged.
    """
    with ExitStack() as stack:
        large: dict[Path, _Fields] = {}
        for block, row in rows:
            then = "sample again"
            if len(block.keys) == 1:
                with _reading(block.path, then) as file:
                    yield _Fields(file)[row]
                continue
            if block.path not in large:
                large[block.path] = _Fields(stack.enter_context(_reading(block.path, then)))
            yield large[block.path][row]


class _Fields:
    """Fields of an open file; u¹ itself is read row by row."""

    def __init__(self, file: Contents) -> None:
        self.domain = file.texts("field/domain", "n")
        self.grad_u, self.p = file.array("field/grad_u", "n", 3, 3), file.array("field/p", "n")
        self.end = np.concatenate([[0], file.array("field/end", "n", kind="int")])
        self.u = file.rows("field/u", "nodes", 3)
        if (np.diff(self.end) < 0).any() or self.end[-1] != file.sizes["nodes"]:
            raise ValueError("'field/end' does not divide 'field/u'")

    def __getitem__(self, row: int) -> CellField | None:
        if not self.domain[row]:
            return None
        u = self.u[int(self.end[row]) : int(self.end[row + 1])]
        if not np.isfinite(u).all():
            raise ValueError(f"'field/u' of row {row} holds numbers that are not finite")
        return CellField(self.grad_u[row], float(self.p[row]), self.domain[row], u)


def _reading(path: Path, then: str | None) -> AbstractContextManager[Contents]:
    if then is None:
        return opened(path, EXPECTED, None)
    return opened(path, "dataset of porocore", then, missing="sample first")
