"""Dataset of solved states in one HDF5 file: append, merge parts, states, responses, digest."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import numpy as np

from porocore.core.echo import reason
from porocore.core.files.plain_data import stable_hash
from porocore.core.inputs.input_space import InputSpace
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import SolvedState, check_record, flatten_response
from porocore.sampling.datasets.layout import Block, Header, read_fields, write_block
from porocore.sampling.datasets.lock import sole_writer
from porocore.sampling.datasets.parts import parts_folder, read_with_parts, stamp
from porocore.states import Array, CellResponse, MacroState, Status

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

        ``sound`` is that of :func:`porocore.sampling.datasets.layout.read_block`; ``named`` says that a user named the
        file, which may be anything.

        Raises
        ------
        DataError
            A file is missing, truncated, foreign or of another version, or holds states of another
            ``identity`` or other ``inputs`` than expected.
        """
        return cls(path, *read_with_parts(path, inputs, identity, sound=sound, named=named))

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
        rows = [self._where[key] for key in self.keys]
        return np.array([block.x[i] for block, i in rows]).reshape(len(rows), len(self.inputs))

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
        """Return block and row of each state in the order of :attr:`keys`, for :func:`~.layout.read_fields`."""
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
        for kept in read_fields([self._where[key] for key in rows.keys]):
            if kept is not None:
                hasher.update(repr((kept.domain, kept.p, kept.u.shape)).encode())
                hasher.update(np.ascontiguousarray(kept.grad_u).tobytes())
                hasher.update(np.ascontiguousarray(kept.u).tobytes())
        return hasher.hexdigest()

    def _joined(self) -> Block:
        return Block.join(self.path, [self._where[key] for key in self.keys], self.inputs)

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
