"""Dataset of solved states in one HDF5 file: layout, parts, one writer, states, responses, digest.

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

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import h5py
import numpy as np

from porocore.core.echo import cut, reason
from porocore.core.field_check import response_fault
from porocore.core.files.claim import Locked, take_lock
from porocore.core.files.plain_data import stable_hash
from porocore.core.hdf5 import Contents, atomic_hdf5, opened
from porocore.core.inputs import InputSpace
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import SolvedState, build_response, check_record, flatten_response
from porocore.states import CELL_FIELDS, Array, CellResponse, MacroState, Status

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
        arrays["field/grad_u"], arrays["field/p"] = (
            np.array(grad_u).reshape(-1, 3, 3),
            np.array(p, dtype=float),
        )
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
        file.require_kind(FORMAT)
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


@contextmanager
def sole_writer(path: Path) -> Iterator[None]:
    """Hold ``.NAME.lock`` beside ``path``; it is removed afterwards.

    Raises
    ------
    RunFolderError
        Another process holds it, or the folder cannot be written.
    """
    lock = path.with_name(f".{path.name}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = take_lock(lock)
    except Locked as error:
        raise RunFolderError(
            f"{path}: another process ({error.holder}) is writing it; wait for it, stop it, or choose another --out"
        ) from None
    except OSError as error:
        raise RunFolderError(
            f"cannot write {path}: {error.strerror or error}; make room or choose another --out"
        ) from None
    try:
        yield
    finally:
        try:
            lock.unlink()  # still held: whoever opened it meanwhile finds that it is no longer the one at this path
            os.close(held)
        except OSError:  # Windows removes no file that anybody has open
            os.close(held)
            with suppress(OSError):
                lock.unlink()


#: Times that a file is read again when another process replaces it meanwhile.
MOST_ATTEMPTS = 5


def _read(
    path: Path, inputs: InputSpace | None, identity: str | None, sound: bool, named: bool
) -> tuple[Header, list[Block]]:
    """Return the header and the rows of the file and of the parts beside it; see :meth:`Dataset.open`."""
    header, block = read_block(path, None if named else "sample again", sound=sound)
    advice = "choose another --out, or move it elsewhere and sample again"
    if identity is not None and header.identity != identity:
        raise DataError(
            f"{path}: holds solved states of another cell or other settings (identity "
            f"{header.identity}, expected {identity}); {advice}"
        )
    if inputs is not None and header.inputs != inputs:
        raise DataError(
            f"{path}: holds states of other inputs ({describe(header.inputs)}, expected "
            f"{describe(inputs)}); {advice}"
        )
    blocks, seen = [block], set(block.keys)
    for part in sorted(parts_folder(path).glob("*.h5")):
        part_header, rows = read_block(part, "resume, which solves its state again", sound=sound)
        if (part_header.identity, part_header.inputs) != (header.identity, header.inputs):
            raise DataError(
                f"{part}: belongs to another dataset than {path.name}; move the folder "
                f"{part.parent.name} elsewhere, or choose another --out"
            )
        # Merged already, but killed before its removal.
        if seen.isdisjoint(rows.keys):
            blocks.append(rows)
    return header, blocks


def parts_folder(path: Path) -> Path:
    """Return the folder of the finished solves that are not merged into ``path`` yet."""
    return path.with_name(f"{path.name}.parts")


def stamp(path: Path) -> tuple[tuple[int, int] | None, ...]:
    """Return a mark that changes with the file and with the parts beside it."""
    found: list[tuple[int, int] | None] = []
    for place in (path, parts_folder(path)):
        try:
            stat = place.stat()
        except OSError:
            found.append(None)
        else:
            found.append((stat.st_ino, stat.st_mtime_ns))
    return tuple(found)


def describe(inputs: InputSpace) -> str:
    """Return names and ranges of the inputs in one line."""
    used = f", at {len(inputs.used)} values of the parameters that a body uses" if inputs.used else ""
    return ", ".join(f"{name} in {inputs.range_text(name)}" for name in inputs.names) + used


#: Finished solves that may lie beside the file before they are merged into it.
MOST_PARTS = 500


class Dataset:
    """Solved states by key: inputs, responses, derivatives, extrema, statuses, times and micro displacements.

    A finished solve is first a small file of its own, written whole or not at all, in the folder
    ``NAME.parts`` beside the file. :meth:`consolidate` merges those into the file, which again is
    replaced whole, and removes them only then. Opening reads both, so nothing is lost that :meth:`append`
    has returned from. Only one process can write at a time, see :meth:`writing`; any number may read.

    Attributes
    ----------
    path
        The file.
    inputs
        The sampled inputs and their ranges.
    identity
        Hash of all settings that the solved values depend on; states of another identity are refused.
    provenance
        Texts: the configuration, versions, and so on.
    """

    def __init__(self, path: Path, header: Header, blocks: list[Block]) -> None:
        self.path = path
        self.inputs = header.inputs
        self.identity = header.identity
        self.provenance = header.provenance
        self._blocks: list[Block] = []
        self._where: dict[str, tuple[Block, int]] = {}
        self._provided: frozenset[str] | None = None
        self._writing = False
        self._seen = stamp(path)
        for block in blocks:
            self._register(block)

    @classmethod
    def create(
        cls, path: Path, *, inputs: InputSpace, identity: str, provenance: Mapping[str, str] | None = None
    ) -> Self:
        """Write a new, empty file and open it.

        Raises
        ------
        RunFolderError
            The file exists, another process is making it, or it cannot be written.
        """
        with sole_writer(path):
            if path.exists():
                raise RunFolderError(f"{path} exists; resume its run or choose another --out")
            header = Header(inputs, identity, dict(provenance or {}))
            write_block(path, header, Block.empty(path, inputs), [])
            return cls.open(path, inputs=inputs, identity=identity)

    @classmethod
    def open(
        cls,
        path: Path,
        *,
        inputs: InputSpace | None = None,
        identity: str | None = None,
        sound: bool = True,
        named: bool = False,
    ) -> Self:
        """Read the file and the parts beside it, also while another process writes; nothing is written.

        ``sound`` is that of :func:`porocore.sampling.datasets.dataset.read_block`; ``named`` says that a user named the
        file, which may be anything.

        Raises
        ------
        DataError
            A file is missing, truncated, foreign or of another version, or holds states of another
            ``identity`` or other ``inputs`` than expected.
        """
        for _ in range(MOST_ATTEMPTS):
            seen = stamp(path)
            try:
                found = _read(path, inputs, identity, sound, named)
            except DataError:
                if stamp(path) == seen:
                    raise
            else:
                # Parts may have been merged between the reading of the file and that of its parts.
                if stamp(path)[:1] == seen[:1]:
                    return cls(path, *found)
        raise DataError(f"{path}: is being written all the time; read it when its process is done")

    @classmethod
    def create_or_open(
        cls, path: Path, *, inputs: InputSpace, identity: str, provenance: Mapping[str, str] | None = None
    ) -> Self:
        """Open the file if it exists, else create it."""
        if path.exists():
            return cls.open(path, inputs=inputs, identity=identity)
        return cls.create(path, inputs=inputs, identity=identity, provenance=provenance)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the only right to write during the block; what others wrote before is read first.

        Raises
        ------
        RunFolderError
            Another process is writing.
        DataError
            What others wrote is damaged, or of another identity or other inputs.
        """
        if self._writing:
            yield
            return
        with sole_writer(self.path):
            if stamp(self.path) != self._seen:
                fresh = self.open(self.path, inputs=self.inputs, identity=self.identity)
                self._blocks, self._where, self._provided = fresh._blocks, fresh._where, fresh._provided
            self._writing = True
            try:
                yield
            finally:
                self._writing = False
                self._seen = stamp(self.path)

    def append(self, record: SolvedState) -> None:
        """Keep one finished solve; when this returns it is on disk.

        Raises
        ------
        ValueError
            The key is there already.
        ConfigurationError
            The state has not the parameters of the inputs.
        PluginError
            The response has not the documented shapes, or other parts than those of the other states.
        RunFolderError
            The disk is full or read-only, or another process is writing.
        """
        with self.writing():
            if record.key in self._where:
                raise ValueError(f"state '{record.key}' is in the dataset already")
            self.inputs.require_parameters(record.state)
            provided = check_record(record, self._provided)
            name = stable_hash(record.key, length=32)
            block = Block.from_record(parts_folder(self.path) / f"{name}.h5", record)
            write_block(block.path, Header(self.inputs, self.identity, {}), block, [record.field])
            self._provided = provided
            self._register(block)
            if len(self._blocks) > MOST_PARTS:
                self._consolidate()

    def consolidate(self) -> None:
        """Merge the parts into the file, rows sorted by key, and remove them.

        Raises
        ------
        RunFolderError
            The disk is full or read-only, or another process is writing; file and parts are as they were.
        DataError
            A part cannot be read any more.
        """
        with self.writing():
            self._consolidate()

    def drop(self, keys: Iterable[str]) -> None:
        """Remove these states and their responses; errors as in :meth:`consolidate`."""
        with self.writing():
            if dropped := self._where.keys() & set(keys):
                self._consolidate(dropped)

    def _consolidate(self, dropped: Set[str] = frozenset()) -> None:
        folder = parts_folder(self.path)
        parts = [block.path for block in self._blocks if block.path != self.path]
        if parts or dropped:
            rows = [self._where[key] for key in self.keys if key not in dropped]
            merged = Block.join(self.path, rows, self.inputs)
            header = Header(self.inputs, self.identity, self.provenance)
            write_block(self.path, header, merged, read_fields(rows))
            self._blocks, self._where = [], {}
            self._register(merged)
        try:
            # Besides the parts just merged, those merged before a kill and half-written files.
            for path in [*parts, *folder.glob("*.h5"), *folder.glob(".*.part")]:
                path.unlink(missing_ok=True)
            if folder.exists():
                folder.rmdir()
        except OSError as error:
            raise RunFolderError(f"cannot remove {folder}: {reason(error)}; mend its permissions") from None

    def __len__(self) -> int:
        return len(self._where)

    def __contains__(self, key: object) -> bool:
        return key in self._where

    @property
    def keys(self) -> list[str]:
        """All keys, sorted; the rows of every batch below have this order."""
        return sorted(self._where)

    def x(self) -> Array:
        """Return the values of the sampled inputs, (n, d)."""
        return np.array([block.x[i] for block, i in self.rows()]).reshape(len(self), len(self.inputs))

    def states(self) -> MacroState:
        """Return all n states."""
        return self._joined().states

    def responses(self) -> CellResponse:
        """Return all n responses; failed states have their status and NaN.

        Raises
        ------
        DataError
            The dataset is empty.
        """
        if not self._where:
            raise DataError(f"{self.path}: holds no states yet; sample first")
        return self._joined().response

    def seconds(self) -> Array:
        """Return the wall time of each solve, (n,) [s]."""
        return self._joined().seconds

    def starts(self) -> list[str | None]:
        """Return the key of the state from which each of the n solves started; None: from the undeformed cell."""
        return [start or None for start in self._joined().starts]

    def response(self, key: str) -> CellResponse:
        """Return the response of one state, one row."""
        block, row = self._where[key]
        return block.response[row : row + 1]

    def inputs_of(self, key: str) -> tuple[float, ...]:
        """Return the values of the sampled inputs of one state."""
        block, row = self._where[key]
        return tuple(map(float, block.x[row]))

    def field(self, key: str) -> CellField | None:
        """Return u¹ of one state, read from the disk; None where it was not kept."""
        return next(read_fields([self._where[key]]))

    def ended(self, status: Status) -> list[str]:
        """Return the keys of the states with a status."""
        if not self._where:
            return []
        return [key for key, found in zip(self.keys, self.responses().status, strict=True) if found == status]

    def rows(self) -> list[tuple[Block, int]]:
        """Return block and row of each state in the order of :attr:`keys`, for :func:`read_fields`."""
        return [self._where[key] for key in self.keys]

    @property
    def unmerged(self) -> int:
        """Number of solves in files of their own."""
        return sum(block.path != self.path for block in self._blocks)

    def digest(self) -> str:
        """Return the SHA-256 of all contents but times and provenance: equal for bit-identical results."""
        rows = self._joined()
        hasher = hashlib.sha256(repr((self.identity, self.inputs, rows.keys, rows.starts)).encode())
        arrays = [rows.x, *rows.states.arrays(), rows.response.status]
        for array in (*arrays, *flatten_response(rows.response).values()):
            hasher.update(np.ascontiguousarray(array).tobytes())
        for kept in read_fields(self.rows()):
            if kept is not None:
                hasher.update(repr((kept.domain, kept.p, kept.u.shape)).encode())
                hasher.update(np.ascontiguousarray(kept.grad_u).tobytes())
                hasher.update(np.ascontiguousarray(kept.u).tobytes())
        return hasher.hexdigest()

    def _joined(self) -> Block:
        return Block.join(self.path, self.rows(), self.inputs)

    def _register(self, block: Block) -> None:
        if len(block.keys):
            provided = frozenset(flatten_response(block.response))
            if self._provided not in (None, provided):
                raise DataError(
                    f"{block.path}: holds other responses than {self.path.name}; move it elsewhere and resume"
                )
            self._provided = provided
        self._blocks.append(block)
        self._where |= {key: (block, row) for row, key in enumerate(block.keys)}
