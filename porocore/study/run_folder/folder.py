"""The run folder (RunFolder): made, locked, opened; refusal of a folder of another run.

A folder belongs to one configuration from the moment it is claimed. It is never taken over by another run,
and two processes cannot write it at the same time.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from porocore.core.echo import reason
from porocore.core.files.atomic import RUN_RECORD, atomic_path, require_outside_a_run
from porocore.core.files.claim import claim_folder, is_half_written, lock_folder, some_of
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import obstacle, read_json
from porocore.core.unexpected import note_folder
from porocore.errors import RunFolderError
from porocore.study.backends import with_closure
from porocore.study.config.config import RunConfig, differences
from porocore.study.config.loading import load_config
from porocore.study.run_folder.decisions import DecisionRecord
from porocore.study.run_folder.files import RunFiles
from porocore.study.run_folder.provenance import versions

FORMAT = "porocore-run"
#: Raised when the identities of configurations change, so that older runs are recognised.
#: 1: without surrogate.tolerance, and with a conductivity piola that did not turn with the solid.
VERSION = 2
CONFIG, RECORD = "config.yaml", RUN_RECORD
#: The temporary names of :func:`porocore.core.files.atomic.atomic_path`.
_HALF_WRITTEN = re.compile(r"\..+\.\d+\.part")
#: Keys of the configuration that may change when a run continues.
NOT_PART_OF_A_RUN = ("title ", "scales", "output_units", "scenarios", "calibration")


class RunFolder(RunFiles):
    """A claimed run folder; used as a context manager it holds the folder's lock.

    Create one by :meth:`claim` (a new run, or the same run resumed) or :meth:`open` (a later step of a run).
    """

    whole: RunFolder

    @classmethod
    def claim(cls, path: Path | str, config: RunConfig, *, resume: bool = False) -> RunFolder:
        """Make the folder and write configuration and versions, or with ``resume`` open the same run again.

        Raises
        ------
        RunFolderError
            The folder holds another run or foreign files, or this run while ``resume`` is not set, or it
            cannot be written. Nothing in it was changed.
        """
        path = Path(path)
        folder = cls(path, config)
        require_outside_a_run(path.absolute().parent)
        claim_folder(
            path,
            RECORD,
            "run",
            resume=resume,
            lock=folder,
            begin=folder._write_record,
            check=lambda: folder._check_same(cls.open(path)),
            left_by_a_start=folder._left_by_a_start,
        )
        return folder

    @classmethod
    def open(cls, path: Path | str) -> RunFolder:
        """Return the run that a folder holds.

        Raises
        ------
        RunFolderError
            The folder holds no run or one of another version, or its configuration was edited after the run began.
        """
        path = Path(path)
        try:
            record = read_json(path / RECORD)
            found = (record["format"], record["version"])
            identity = record["identity"]
        except (FileNotFoundError, NotADirectoryError):
            raise RunFolderError(_no_run(path)) from None
        except OSError as error:
            raise RunFolderError(f"{path / RECORD} cannot be read: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError) as error:
            raise RunFolderError(
                f"{path / RECORD} is damaged ({reason(error)}); start again in another --out"
            ) from error
        if found != (FORMAT, VERSION):
            raise RunFolderError(
                f"{path / RECORD}: expected {FORMAT} version {VERSION}, got {found[0]} version {found[1]}; "
                "use the porocore that made it, or start again in another --out"
            )
        config = load_config(path / CONFIG)
        if config.identity != identity:
            raise RunFolderError(
                f"{path / CONFIG} was changed after the run began and no longer belongs to the files beside "
                "it; change it back, or start a new run from it with another --out"
            )
        return cls(path, config)

    def of_cell(self, name: str | None) -> RunFolder:
        """Return the files of one of several cells, as those of a study of this cell alone.

        Those of a cell with a name lie in a folder of their own, ``cells/NAME``; None names that of the rest of the
        body.
        """
        if not self.written.cells:
            return self
        folder = RunFolder(
            self.path if name is None else self.path / "cells" / name, self.config.of_cell(name)
        )
        folder.cell, folder.whole, folder.written = name, self.whole, self.written.of_cell(name)
        return folder

    def of_each_cell(self, config: RunConfig) -> list[tuple[RunFolder, RunConfig]]:
        """Return files and configuration of every cell, as :meth:`of_cell` does, that of the rest of the body first."""
        return [(self.of_cell(name), config.of_cell(name)) for name in config.cell_names]

    def __enter__(self) -> Self:
        """Take the lock; the system releases it when the process ends, however it ends."""
        self._lock = lock_folder(self.path)
        self._remove_half_written()
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Leave the lock out: a process that this one starts works under it."""
        return self.__dict__ | {"_lock": None}

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        note_folder(error, self.path)
        if kind is not None:
            self._remove_half_written()  # processes that worked beside this one have been ended
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _remove_half_written(self) -> None:
        """Remove incomplete files of killed processes; no other process writes while the lock is held."""
        for path in self.path.rglob(".*.part"):
            if _HALF_WRITTEN.fullmatch(path.name):
                with suppress(OSError):
                    path.unlink()

    def require(self, file: Path, command: str) -> Path:
        """Return ``file`` if it exists.

        Raises
        ------
        RunFolderError
            The file is missing; ``command`` (``sample``, ``train``, ``solve``) makes it.
        """
        if not file.exists():
            raise RunFolderError(f"{file} is missing; make it first: porocore {command} {self.whole.path}")
        return file

    def remembered(self) -> DecisionRecord:
        """Return the decisions of the run's sampler so far."""
        return DecisionRecord(self.decisions, self.written.identity)

    def _check_same(self, held: RunFolder) -> None:
        same = with_closure(held.config, self.config.closure)
        if same.identity != self.config.identity:
            found = differences(self.config, same)
            changed = [
                each for each in found if each.startswith("scales.")
            ]  # which changes all other numbers
            changed += [each for each in found if not each.startswith(NOT_PART_OF_A_RUN)]
            raise RunFolderError(
                f"{self.path} holds another run; this one has {some_of(changed)}; choose another --out"
            )
        self.written = held.config

    def _left_by_a_start(self, name: str) -> bool:
        """Return True for a file that a start of this run leaves if it dies before the record is written."""
        if name == CONFIG:
            return (self.path / CONFIG).read_bytes() == self.config.resolved_yaml().encode()
        return is_half_written(name, CONFIG)

    def _write_record(self) -> None:
        with atomic_path(self.path / CONFIG) as part:
            part.write_text(self.config.resolved_yaml(), encoding="utf-8")
        record = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self.config.identity,
            "stages": asdict(self.config.stages),
            "versions": versions(),
        }
        write_json(self.path / RECORD, record, indent=2)


def _no_run(path: Path) -> str:
    """Return what is at a path that is no run folder, and what to give or to do instead."""
    if found := obstacle(path):
        return f"{path}: {found}; expected a run folder"
    if path.exists() and not path.is_dir():
        if (path.parent / RECORD).is_file():
            return f"{path}: expected a run folder, got a file of one; give the folder: {path.parent}"
        return f"{path}: expected a run folder, got a file; 'porocore run CONFIG' makes one"
    there = path.exists()
    said = f"{path} is not a run folder ({f'it has no {RECORD}' if there else 'there is no such folder'})"
    inside = sorted(path.iterdir()) if there else []
    if runs := [str(each) for each in inside if (each / RECORD).is_file()]:
        return f"{said}, but holds some; give one of them: {some_of(runs)}"
    if inside:
        return f"{said}, but holds other files; give the folder that 'porocore run' or 'porocore sample' made"
    return f"{said}; start one: porocore run CONFIG --out {path}, or porocore sample CONFIG --out {path}"
