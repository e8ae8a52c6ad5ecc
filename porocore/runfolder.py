"""The folder of one run: who may write there, and where each file lies.

A folder belongs to one configuration from the moment it is claimed. It is never taken over by another run,
and two processes cannot write it at the same time.
"""

from __future__ import annotations

import json
import os
import platform
import re
import sys
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from porocore.backends import with_closure
from porocore.closures import CLOSURES
from porocore.config import RunConfig, differences, load_config
from porocore.errors import RunFolderError
from porocore.files import atomic_path

if sys.platform != "win32":
    import fcntl

FORMAT = "porocore-run"
VERSION = 1
CONFIG, RECORD, LOCK = "config.yaml", "run.json", ".lock"
#: Name of the law of linear poroelasticity.
LINEAR = "linear"
#: The temporary names of :func:`porocore.files.atomic_path`.
_HALF_WRITTEN = re.compile(r"\..+\.\d+\.part")
#: Keys of the configuration that may change when a run goes on.
NOT_PART_OF_A_RUN = ("title ", "scales", "output_units", "scenarios")
_PACKAGES = (
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


class RunFolder:
    """A claimed run folder; used as a context manager it holds the folder's lock.

    Create one by :meth:`claim` (a new run, or the same run resumed) or :meth:`open` (a later step of a run).

    Attributes
    ----------
    path
        The folder.
    config
        Its configuration; after :meth:`claim` the one that was handed in.
    written
        The configuration that the run began with, which names the files: a run that goes on with another closure
        keeps the solutions of each, and one surrogate for each model.
    """

    def __init__(self, path: Path, config: RunConfig) -> None:
        self.path = path
        self.config = self.written = config
        self._lock: int | None = None

    @classmethod
    def claim(cls, path: Path | str, config: RunConfig, *, resume: bool = False) -> RunFolder:
        """Make the folder and write configuration and versions, or with ``resume`` come back to it.

        Raises
        ------
        RunFolderError
            The folder holds another run or foreign files, or this run while ``resume`` is not set, or it
            cannot be written. Nothing in it was changed.
        """
        path = Path(path)
        folder = cls(path, config)
        try:
            if path.exists() and not path.is_dir():
                raise RunFolderError(f"{path}: expected a folder, got a file; choose another --out")
            present = {entry.name for entry in path.iterdir()} if path.exists() else set()
            foreign = sorted(name for name in present if not folder._left_by_a_start(name))
            if RECORD not in present and foreign:
                raise RunFolderError(
                    f"{path} is not empty and holds no run of porocore (found {_some(foreign)}); "
                    "choose another --out"
                )
            path.mkdir(parents=True, exist_ok=True)
            with folder:
                # Looked for under the lock: another process may have claimed the folder just now.
                if (path / RECORD).exists():
                    folder._check_same(cls.open(path), resume)
                else:
                    folder._write_record()
        except OSError as error:
            raise RunFolderError(
                f"{path}: the run folder cannot be made: {error.strerror or error}; choose another --out"
            ) from error
        return folder

    @classmethod
    def open(cls, path: Path | str) -> RunFolder:
        """The run that a folder holds.

        Raises
        ------
        RunFolderError
            It holds none, one of another version, or its configuration was edited after the run began.
        """
        path = Path(path)
        try:
            record = json.loads((path / RECORD).read_text(encoding="utf-8"))
            found = (record["format"], record["version"])
            identity = record["identity"]
        except (FileNotFoundError, NotADirectoryError) as error:
            raise RunFolderError(
                f"{path} is not a run folder (it has no {RECORD}); start one: "
                f"porocore run CONFIG --out {path}, or porocore sample CONFIG --out {path}"
            ) from error
        except OSError as error:
            raise RunFolderError(f"{path / RECORD} cannot be read: {error.strerror or error}") from error
        except (ValueError, KeyError, TypeError) as error:
            raise RunFolderError(
                f"{path / RECORD} is damaged ({error!r}); start again in another --out"
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

    def __enter__(self) -> Self:
        """Take the lock; the system releases it when the process ends, however it ends."""
        if sys.platform == "win32":
            return self
        try:
            self._lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise RunFolderError(
                f"{self.path} cannot be written: {error.strerror or error}; choose another --out"
            ) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(self._lock, 32).decode(errors="replace").strip() or "unknown"
            os.close(self._lock)
            self._lock = None
            raise RunFolderError(
                f"another porocore (process {holder}) is working in {self.path}; "
                "wait for it, stop it, or choose another --out"
            ) from error
        os.truncate(self._lock, 0)
        os.write(self._lock, f"{os.getpid()}\n".encode())
        self._remove_half_written()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _remove_half_written(self) -> None:
        """What processes that were killed left; nobody else writes here while the lock is held."""
        for path in self.path.rglob(".*.part"):
            if _HALF_WRITTEN.fullmatch(path.name):
                with suppress(OSError):
                    path.unlink()

    def require(self, file: Path, command: str) -> Path:
        """``file`` if it is there.

        Raises
        ------
        RunFolderError
            It is missing; ``command`` (``sample``, ``train``, ``solve``) makes it.
        """
        if not file.exists():
            raise RunFolderError(f"{file} is missing; make it first: porocore {command} {self.path}")
        return file

    @property
    def reference(self) -> Path:
        """The undeformed cell."""
        return self.path / "cell.json"

    @property
    def training_curve(self) -> Path:
        """Losses against epochs."""
        return self.training_curve_of(self.config)

    def training_curve_of(self, config: RunConfig) -> Path:
        """Losses of the surrogate that ``config`` needs."""
        return self.path / f"training{self._suffix(config)}.csv"

    @property
    def dataset(self) -> Path:
        """Solved states to learn from."""
        return self.path / "samples.h5"

    @property
    def test_dataset(self) -> Path:
        """Solved random states that no surrogate is trained on."""
        return self.path / "test.h5"

    @property
    def surrogate(self) -> Path:
        """The trained surrogate."""
        return self.surrogate_of(self.config)

    def surrogate_of(self, config: RunConfig) -> Path:
        """The surrogate of the model that ``config`` needs.

        ``surrogate.h5`` is that of the closure that the run began with; another closure may need another model,
        which lies beside it as ``surrogate-MODEL.h5``.
        """
        return self.path / f"surrogate{self._suffix(config)}.h5"

    @property
    def training_checkpoint(self) -> Path:
        """From which an interrupted training continues."""
        return self.training_checkpoint_of(self.config)

    def training_checkpoint_of(self, config: RunConfig) -> Path:
        """From which an interrupted training of that surrogate continues."""
        return self.path / "checkpoints" / f"training{self._suffix(config)}.h5"

    def _suffix(self, config: RunConfig) -> str:
        model = config.surrogate_model
        return "" if model == self.written.surrogate_model else f"-{model}"

    def macro_checkpoint(self, law: str, load: float) -> Path:
        """From which an interrupted macro solve continues."""
        return self.path / "checkpoints" / f"{_file_name(law, load)}.h5"

    def solution(self, law: str, load: float) -> Path:
        """Macro solution under one law and load."""
        return self.path / "solutions" / f"{_file_name(law, load)}.h5"

    def solutions(self, *laws: str) -> list[Path]:
        """The macro solution for each load with each of ``laws``; by default with the closure and linearly."""
        laws = laws or (self.config.closure, LINEAR)
        return [self.solution(law, load) for load in self.config.macro.loads for law in laws]

    def solved(self, load: float) -> list[str]:
        """Names of the nonlinear laws with a solution under ``load``: closures, with fallback, direct FE²."""
        closures = dict.fromkeys((self.written.closure, *CLOSURES))
        laws = (*closures, *map(fallback_law, closures), *map(direct_law, closures))
        return [law for law in laws if self.solution(law, load).exists()]

    @property
    def shown_closure(self) -> str:
        """The closure that a report is about: the first one of which every load is solved, else the run's first."""
        loads = self.config.macro.loads
        complete = [c for c in CLOSURES if all(self.solution(c, load).exists() for load in loads)]
        first = self.written.closure
        return first if first in complete or not complete else complete[0]

    @property
    def direct_work(self) -> Path:
        """How many cells direct FE² has solved, and in what time."""
        return self.path / "direct.json"

    @property
    def fallback(self) -> Path:
        """States that macro solves with a fallback needed outside the sampled range."""
        return self.path / "fallback.h5"

    @property
    def fallback_work(self) -> Path:
        """How many cells the fallback has solved, and in what time."""
        return self.path / "fallback.json"

    @property
    def fields(self) -> Path:
        """Folder of the files for ParaView."""
        return self.path / "fields"

    def history(self, law: str, load: float) -> Path:
        """Everything against time of one macro solution, as a table."""
        return self.path / "histories" / f"{_file_name(law, load)}.csv"

    @property
    def timings(self) -> Path:
        """Seconds that each stage took."""
        return self.path / "timings.json"

    @property
    def metrics(self) -> Path:
        """Figures of merit."""
        return self.path / "metrics.json"

    @property
    def report(self) -> Path:
        """The page to read."""
        return self.path / "report.html"

    def _check_same(self, held: RunFolder, resume: bool) -> None:
        same = with_closure(held.config, self.config.closure)
        if same.identity != self.config.identity:
            changed = [d for d in differences(self.config, same) if not d.startswith(NOT_PART_OF_A_RUN)]
            raise RunFolderError(
                f"{self.path} holds another run; this one has {_some(changed)}; choose another --out"
            )
        if not resume:
            raise RunFolderError(
                f"{self.path} already holds this run; add --resume to continue it, or choose another --out"
            )
        self.written = held.config

    def _left_by_a_start(self, name: str) -> bool:
        """Whether a file is what a start of this very run leaves that dies before the record is written."""
        if name == CONFIG:
            return (self.path / CONFIG).read_bytes() == self.config.resolved_yaml().encode()
        part = name.endswith(".part") and name.startswith((f".{CONFIG}.", f".{RECORD}."))
        return name == LOCK or part

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
        with atomic_path(self.path / RECORD) as part:
            part.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def direct_law(closure: str) -> str:
    """Name of the law of direct FE² with a closure."""
    return f"direct-{closure}"


def fallback_law(closure: str) -> str:
    """Name of the law of a closure whose surrogate learns on the way."""
    return f"{closure}-fallback"


def versions() -> dict[str, str]:
    """Of porocore, its plugins and the packages that numbers depend on; nothing is imported for that."""
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


def _file_name(law: str, load: float) -> str:
    safe = "".join(c if c.isalnum() else "-" for c in law)
    return f"{safe}_load{load!r}"


def _some(names: list[str]) -> str:
    shown = ", ".join(names[:4])
    return f"{shown} and {len(names) - 4} more" if len(names) > 4 else shown
