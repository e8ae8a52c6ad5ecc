"""The run folder (RunFolder): files, lock, finished record, decisions, versions, seconds of the stages.

A decision is found by a hash of the run and of all that it was made on. So one of another run, or one that was made on
other responses, is never found; a file whose checksum does not fit is passed over. What is not found is decided again.

A folder belongs to one configuration from the moment it is claimed. It is never taken over by another run,
and two processes cannot write it at the same time.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from porocore.core.echo import reason
from porocore.core.files.atomic import RUN_RECORD, require_outside_a_run, write_text
from porocore.core.files.claim import claim_folder, is_half_written, lock_folder, some_of
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import obstacle, read_json
from porocore.core.files.store import Numbers, added_up, read_totals
from porocore.core.parallel.calls import Call, CallProcesses
from porocore.core.unexpected import note_folder
from porocore.errors import PorocoreError, RunFolderError
from porocore.macro.laws.closure import CLOSURES
from porocore.study.config.config import RunConfig, differences, with_closure
from porocore.study.config.loading import load_config

#: Name of the law of linear poroelasticity.
LINEAR = "linear"
#: Files of solved states: sampled ones, held-out ones, undeformed members of a family, those beyond the samples.
DATA_SETS = ("samples.h5", "test.h5", "undeformed.h5", "fallback.h5")


def direct_law(closure: str) -> str:
    """Return the name of the law of direct FE² with a closure."""
    return f"direct-{closure}"


def fallback_law(closure: str) -> str:
    """Return the name of the law of a closure whose surrogate learns on the way."""
    return f"{closure}-fallback"


def _file_name(law: str, load: float) -> str:
    safe = "".join(c if c.isalnum() else "-" for c in law)
    return f"{safe}_load{load!r}"


DECISIONS_FORMAT, DECISIONS_VERSION = "porocore-decisions", 1


class DecisionRecord:
    """The decisions of one run; an implementation of :class:`porocore.interfaces.sampler.Remember`.

    Parameters
    ----------
    path
        The file; it need not exist.
    owner
        Identity of the run.
    """

    def __init__(self, path: Path, owner: str) -> None:
        self.path, self._owner = path, owner
        self._known: dict[str, Any] | None = None

    def __call__(self, grounds: str, decide: Callable[[], Any]) -> Any:
        """Return the decision that was made on these grounds; where there is none, make it and keep it.

        Raises
        ------
        RunFolderError
            The file cannot be written.
        """
        if self._known is None:
            self._known = _read(self.path)
        key = hashlib.sha256(f"{self._owner} {grounds}".encode()).hexdigest()
        if key not in self._known:
            # As it will be read, so that a decision is the same now and later.
            self._known[key] = json.loads(json.dumps(decide(), allow_nan=False))
            document = {
                "format": DECISIONS_FORMAT,
                "version": DECISIONS_VERSION,
                "checksum": _checksum(self._known),
            }
            write_json(self.path, document | {"decisions": self._known})
        return self._known[key]


def _read(path: Path) -> dict[str, Any]:
    """Return the decisions by their keys; none where the file is missing, damaged or foreign."""
    try:
        document = read_json(path)
        known = document["decisions"]
        whole = (document["format"], document["version"], document["checksum"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return (
        known
        if isinstance(known, dict) and whole == (DECISIONS_FORMAT, DECISIONS_VERSION, _checksum(known))
        else {}
    )


def _checksum(decisions: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(decisions, sort_keys=True).encode()).hexdigest()


_PACKAGES = (
    "porocore",
    "numpy",
    "scipy",
    "h5py",
    "gmsh",
    "scikit-fem",
    "mkl",
    "fenics-dolfinx",
    "petsc4py",
    "torch",
    "jax",
)


def versions() -> dict[str, str]:
    """Return the versions of porocore, its plugins and the packages that results depend on, without importing them."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    names = {*_PACKAGES, *(d.name for d in metadata.distributions() if _is_plugin(d))}
    for name in sorted(names):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _is_plugin(distribution: Any) -> bool:
    return any(entry_point.group == "porocore" for entry_point in distribution.entry_points)


FORMAT = "porocore-run"
#: Raised when the identities of configurations change, so that older runs are recognised.
#: 1: without surrogate.tolerance, and with a conductivity piola that did not turn with the solid.
VERSION = 2
CONFIG, RECORD = "config.yaml", RUN_RECORD
#: The temporary names of :func:`porocore.core.files.atomic.atomic_path`.
_HALF_WRITTEN = re.compile(r"\..+\.\d+\.part")
#: Keys of the configuration that may change when a run continues.
NOT_PART_OF_A_RUN = ("title ", "scales", "output_units", "scenarios")


class RunFolder:
    """The folder of one run with its files; used as a context manager it holds the folder's lock.

    Create one by :meth:`claim` (a new run, or the same run resumed) or :meth:`open` (a later step of a run).

    Attributes
    ----------
    path
        The folder.
    config
        Configuration of the run, or the other settings with which it continues.
    written
        Configuration that the run began with, which names the files: a run that continues with another closure
        keeps the solutions of each, and one surrogate for each model.
    surrogate, training_curve, training_checkpoint
        The surrogate that ``config`` needs, the table of its losses against epochs, and the checkpoint of a training
        that was interrupted. ``surrogate.h5`` belongs to the closure that the run began with; another model of
        surrogate lies beside it as ``surrogate-MODEL.h5``.
    reference, dataset, test_dataset
        The undeformed cell, and the data sets of the states to learn from and of the held-out ones.
    undeformed
        Data set of the undeformed members of a family of cells.
    decisions
        Decisions of a sampler that explores, for a sampling that is resumed.
    direct_work, fallback, fallback_work
        Record of the cells that direct FE² has solved; data set of the states that solves with a fallback needed
        outside the sampled range, and the record of their cells.
    fields, figures, metrics, report
        Folders of the files for ParaView and of the report's figures, figures of merit, and page of the report.
    timings
        Record of the seconds that each stage took.
    body
        Folder of the macro solutions, their histories and checkpoints: that of the run, or one below it.
    cell
        Name of the cell whose files these are; None: that of the rest of the body, or the only one.
    whole
        Files of the whole run.
    """

    def __init__(self, path: Path, config: RunConfig) -> None:
        self.path = self.body = path
        self.cell: str | None = None
        self.whole = self
        self.config = self.written = config
        self.reference = path / "cell.json"
        self.dataset, self.test_dataset, self.undeformed, self.fallback = (path / name for name in DATA_SETS)
        self.decisions = path / "decisions.json"
        self.direct_work = path / "direct.json"
        self.fallback_work = path / "fallback.json"
        self.fields, self.figures = path / "fields", path / "figures"
        self.metrics, self.report = path / "metrics.json", path / "report.html"
        self.timings = path / "timings.json"
        self._lock: int | None = None

    def with_config(self, config: RunConfig, body: str = "") -> Self:
        """Return the files of the same run that goes on with other settings.

        With another ``body`` its solutions are in a folder of this name below that of the run.
        """
        other = copy(self)
        other.config, other.body = config, self.body / body
        if self.whole is self:
            other.whole = other
        return other

    @property
    def surrogate(self) -> Path:
        """Trained surrogate of the folder, or of one of its layers of cells."""
        return self.path / f"surrogate{self._suffix}.h5"

    @property
    def training_curve(self) -> Path:
        """Losses of its training against time."""
        return self.path / f"training{self._suffix}.csv"

    @property
    def training_checkpoint(self) -> Path:
        """Checkpoint of its training while that goes on."""
        return self.path / "checkpoints" / f"training{self._suffix}.h5"

    @property
    def _suffix(self) -> str:
        model = self.config.surrogate_model
        return "" if model == self.written.surrogate_model else f"-{model}"

    def stage_of_cell(self, stage: str) -> str:
        """Return the name of a stage of a cell, with the name of the cell where it has one."""
        return stage if self.cell is None else f"{stage}, {self.cell}"

    def said_of_cell(self, text: str) -> str:
        """Return a sentence with the name of the cell before it where it has one."""
        return text if self.cell is None else f"cell {self.cell}: {text}"

    def macro_checkpoint(self, law: str, load: float) -> Path:
        """Return the checkpoint of an interrupted macro solve."""
        return self.body / "checkpoints" / f"{_file_name(law, load)}.h5"

    def solution(self, law: str, load: float) -> Path:
        """Return the file of the macro solution with one law under one load."""
        return self.body / "solutions" / f"{_file_name(law, load)}.h5"

    def solutions(self, *laws: str) -> list[Path]:
        """Return the files of the solutions for each load with each of ``laws``; by default the closure and linear."""
        laws = laws or (self.config.closure, LINEAR)
        return [self.solution(law, load) for load in self.config.macro.loads for law in laws]

    def solved(self, load: float) -> list[str]:
        """Return the nonlinear laws with a solution under ``load``: closures, with fallback, direct FE²."""
        closures = dict.fromkeys((self.written.closure, *CLOSURES))
        laws = (*closures, *map(fallback_law, closures), *map(direct_law, closures))
        return [law for law in laws if self.solution(law, load).exists()]

    @property
    def shown_closure(self) -> str:
        """Closure that a report shows: the first one with solutions of all loads, else the run's first."""
        loads = self.config.macro.loads
        complete = [c for c in CLOSURES if all(self.solution(c, load).exists() for load in loads)]
        first = self.written.closure
        return first if first in complete or not complete else complete[0]

    def history(self, law: str, load: float) -> Path:
        """Return the table of everything against time of one macro solution."""
        return self.body / "histories" / f"{_file_name(law, load)}.csv"

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
        if not os.path.lexists(path / CONFIG):
            raise RunFolderError(
                f"{path / CONFIG}: no such file, so the run folder is incomplete; put back the {CONFIG} that was "
                "there, or start again in another --out"
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

    @property
    def of_each_cell(self) -> list[RunFolder]:
        """Files of every cell, as :meth:`of_cell` returns them, that of the rest of the body first."""
        return [self.of_cell(name) for name in self.config.cell_names]

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
            options = _begun_with(same, self.config, changed)
            advice = f"repeat {options} if it was begun so, or " if options else ""
            raise RunFolderError(
                f"{self.path} holds another run; this one has {some_of(changed)}; {advice}choose another --out"
            )
        self.written = held.config

    def _left_by_a_start(self, name: str) -> bool:
        """Return True for a file that a start of this run leaves if it dies before the record is written."""
        if name == CONFIG:
            return (self.path / CONFIG).read_bytes() == self.config.resolved_yaml().encode()
        return is_half_written(name, CONFIG)

    def _write_record(self) -> None:
        write_text(self.path / CONFIG, self.config.resolved_yaml())
        record = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self.config.identity,
            "stages": asdict(self.config.stages),
            "versions": versions(),
        }
        write_json(self.path / RECORD, record, indent=2)


#: Folders without a run by a file in them: what they are of, what to open, and how to write it again.
OTHER_RESULTS = {
    "calibrate.json": (
        "a calibration",
        "report.html",
        ", which 'porocore calibrate CONFIG --out {} --resume' writes again",
    ),
    "rev.json": ("a study of representative volumes", "rev.png", ""),
    "sensitivity.csv": ("a sensitivity study", "sensitivity.csv", ""),
    "stability.h5": ("a stability map", "stability.png", ""),
    "crosscheck.json": ("a cross-check", "crosscheck.html", ""),
    "reproduction.json": ("a reproduction", "index.html", ""),
}


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
    for record, (kind, shown, again) in OTHER_RESULTS.items():
        if (path / record).is_file():
            opened = f"open {path / shown}" if (path / shown).is_file() else "it is not finished"
            return f"{path} is the folder of {kind}, not of a run; {opened}{again.format(path)}"
    if runs := [str(each) for each in inside if (each / RECORD).is_file()]:
        return f"{said}, but holds some; give one of them: {some_of(runs)}"
    if inside:
        return f"{said}, but holds other files; give the folder that 'porocore run' or 'porocore sample' made"
    return f"{said}; start one: porocore run CONFIG --out {path}, or porocore sample CONFIG --out {path}"


def _begun_with(held: RunConfig, given: RunConfig, changed: list[str]) -> str:
    """Return the options by which the backends would be those of a held run; empty where more than these differs."""
    if not all(each.startswith(("surrogate.", "fem.", "macro.backend ")) for each in changed):
        return ""
    options = {
        "--fem": (held.fem.backend, given.fem.backend),
        "--macro": (held.macro.backend, given.macro.backend),
        "--surrogate": (held.surrogate.backend, given.surrogate.backend),
    }
    return " ".join(f"{option} {mine}" for option, (mine, other) in options.items() if mine and mine != other)


FINISHED_FORMAT, FINISHED_VERSION = "porocore-finished", 1
#: Files that are no part of what the run ended with; the lock is taken by every command.
_LEFT_OUT = (".lock", "finished.json")
#: What the names begin with that a sweep adds to the folder of its family.
_OF_SWEEPS = "sweep"


@dataclass(frozen=True)
class FinishedRun:
    """Texts of a report that change without anything being computed, and what it warned of.

    Attributes
    ----------
    title, heading
        Title of the configuration, and the one that the page shows.
    configuration
        The configuration as the page shows it.
    warnings
        Warnings of the report.
    """

    title: str
    heading: str
    configuration: str
    warnings: tuple[str, ...] = ()

    def keep(self, folder: Path) -> None:
        """Record that the run in ``folder`` is finished with the files that are there now.

        Raises
        ------
        RunFolderError
            The disk is full or read-only.
        """
        document = _head() | asdict(self) | {"files": _stamps(folder)}
        write_json(folder / "finished.json", document)

    @classmethod
    def find(cls, folder: Path) -> Self | None:
        """Return the record; None where there is none, or where a file of the folder is another one now."""
        try:
            document = read_json(folder / "finished.json")
            files, texts = document.pop("files"), {name: document.pop(name) for name in cls.__annotations__}
            if document != _head() or files != _stamps(folder):
                return None
            return cls(**texts | {"warnings": tuple(map(str, texts["warnings"]))})
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None


def _head() -> dict[str, Any]:
    return {"format": FINISHED_FORMAT, "version": FINISHED_VERSION, "porocore": version("porocore")}


def _stamps(folder: Path) -> dict[str, list[int]]:
    """Return size and time of the last change of every file in the folder; a change of either is noticed."""
    found = {}
    for above, _, names in os.walk(folder):
        for path in (Path(above, name) for name in names):
            relative = path.relative_to(folder).as_posix()
            if relative not in _LEFT_OUT and not relative.startswith(_OF_SWEEPS):
                status = path.stat()
                found[relative] = [status.st_size, status.st_mtime_ns]
    return found


class StageTime(NamedTuple):
    """Seconds of a stage, over all runs that worked on it: one, and one more for each time that it was resumed.

    They are those of an empty store: ``saved`` of them were not spent, because a store held results.
    """

    seconds: float
    runs: int
    saved: float = 0.0


class StageClock:
    """Clock of a running stage, which counts what stored results had taken as if it were taken now.

    Attributes
    ----------
    idle
        True if the stage found its work done, so that its time is not to be added.
    now
        Tells the time; another clock where another process works.
    saved
        Seconds that stored results had taken.
    """

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self.now = now
        self._began, self.saved, self.idle = now(), 0.0, False

    @property
    def seconds(self) -> float:
        """Seconds so far, stored results included."""
        return self.now() - self._began + self.saved

    def add(self, seconds: float) -> None:
        """Count the seconds that a result from the store had taken."""
        self.saved += seconds


@contextmanager
def timed(path: Path, stage: str, clock: StageClock | None = None) -> Iterator[StageClock]:
    """Add the block's wall time to what ``stage`` has taken so far, also when the block is interrupted.

    Yields the clock of the block, a new one unless it is given.

    Raises
    ------
    DataError
        The record at ``path`` is damaged; the block is not run.
    RunFolderError
        The disk is full or read-only.
    """
    clock = clock or StageClock()

    def gained() -> Numbers:
        return {} if clock.idle else {"seconds": clock.seconds, "runs": 1, "saved": clock.saved}

    with added_up(path, _record, stage, gained):
        yield clock


@contextmanager
def cut_short_timed(path: Path, calls: Mapping[str, Call], processes: CallProcesses) -> Iterator[None]:
    """Add the times of the calls by stage if the block is interrupted; the calls end with it."""
    try:
        yield
    except BaseException:
        while processes.receive(0.0):
            pass
        for stage, call in calls.items():
            if call.began is not None:
                with suppress(PorocoreError), timed(path, stage, StageClock(call.time)):
                    call.catch_up()
        raise


def stage_times(path: Path) -> dict[str, StageTime]:
    """Return the times by stage; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    return {
        stage: StageTime(entry["seconds"], int(entry["runs"]), entry["saved"])
        for stage, entry in _record(path).items()
    }


def _record(path: Path) -> dict[str, Numbers]:
    return read_totals(path, "the stages' times", _numbers)


def _numbers(entry: Any) -> Numbers:
    # Folders of porocore 0.1 have the seconds alone.
    entry = entry if isinstance(entry, dict) else {"seconds": entry, "runs": 1}
    return {
        "seconds": float(entry["seconds"]),
        "runs": int(entry["runs"]),
        "saved": float(entry.get("saved", 0.0)),
    }
