"""Folder of one piece of work (WorkFolder), its claim (claim_folder); lock files with one holder (take_lock)."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

from filelock import lock_descriptor

from porocore.core.echo import joined, reason
from porocore.core.files.atomic import require_a_way, require_no_file, require_outside_a_run
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import RunFolderError

#: Windows has no flag against links; there the path is looked at instead.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_FLAGS = os.O_RDWR | os.O_CREAT | _NO_LINK | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)


class Locked(OSError):
    """Refusal of a lock that another process holds.

    Attributes
    ----------
    holder
        Number of that process, or ``unknown``.
    """

    def __init__(self, holder: str) -> None:
        super().__init__(errno.EAGAIN, f"held by process {holder}")
        self.holder = holder


def take_lock(path: Path) -> int:
    """Take a lock and write the number of this process into its file, which is made where there is none.

    Returns
    -------
    int
        A descriptor; closing it releases the lock.

    Raises
    ------
    Locked
        Another process holds it.
    OSError
        It is no ordinary file, or the folder cannot be written.
    """
    while True:
        held = _open_lock(path)
        try:
            if not lock_descriptor(held, blocking=False):
                raise Locked(_holder(held))
            # A holder may remove the file before it ends; then this one guards nothing.
            if os.path.samestat(os.fstat(held), path.stat()):
                with suppress(OSError):  # a full disk: the number is for messages only
                    os.ftruncate(held, 0)
                    os.write(held, f"\n{os.getpid()}\n".encode())
                return held
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(held)
            raise
        os.close(held)


def _open_lock(path: Path) -> int:
    """Open a lock file, or make it. A link is not followed, so that no other file is touched."""
    try:
        if not _NO_LINK and path.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        held = os.open(path, _FLAGS, 0o644)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, f"its lock {path.name} is a symbolic link; remove that") from None
        raise
    if not stat.S_ISREG(os.fstat(held).st_mode):
        os.close(held)
        raise OSError(errno.EINVAL, f"its lock {path.name} is no ordinary file; remove that")
    return held


def _holder(held: int) -> str:
    """Return the number that the holder wrote: from the second byte on, since Windows keeps the first from readers."""
    with suppress(OSError):
        os.lseek(held, 1, os.SEEK_SET)
        return os.read(held, 32).decode(errors="replace").strip() or "unknown"
    return "unknown"


#: Name of the lock in a folder.
LOCK = ".lock"


def lock_folder(path: Path) -> int:
    """Take the lock of a folder; the system releases it when the process ends, however it ends.

    Returns
    -------
    int
        A descriptor; closing it releases the lock.

    Raises
    ------
    RunFolderError
        Another process holds it, or the folder cannot be written.
    """
    try:
        return take_lock(path / LOCK)
    except Locked as error:
        raise RunFolderError(
            f"another porocore (process {error.holder}) is working in {path}; "
            "wait for it, stop it, or choose another --out"
        ) from None
    except OSError as error:
        raise RunFolderError(
            f"{path} cannot be written: {error.strerror or error}; choose another --out"
        ) from None


def claim_folder(
    path: Path,
    record: str,
    work: str,
    *,
    resume: bool,
    lock: AbstractContextManager[Any],
    begin: Callable[[], None],
    check: Callable[[], None],
    left_by_a_start: Callable[[str], bool] = lambda name: False,
) -> None:
    """Make a folder that belongs to one piece of work from now on, or open that of the same work again.

    Parameters
    ----------
    record
        Name of the file that says what the folder belongs to.
    work
        What a user calls it, such as ``calibration``.
    resume
        Whether the folder may hold this work already.
    lock
        Held while the record is looked at or written.
    begin
        Writes the record into a folder that has none.
    check
        Raises where the record is of other work.
    left_by_a_start
        Tells whether a further file is one that a start leaves if it dies before the record is written.

    Raises
    ------
    RunFolderError
        The folder holds other files, or this work while ``resume`` is not set, or it cannot be made. Nothing in it was
        changed.
    """
    try:
        _require_own_files(path, record, work, left_by_a_start)
        path.mkdir(parents=True, exist_ok=True)
        with lock:
            # Under the lock, because another process may have claimed the folder meanwhile.
            if not (path / record).exists():
                begin()
                return
            check()
            if not resume:
                raise RunFolderError(
                    f"{path} already holds this {work}; add --resume to continue it, or choose another --out"
                )
    except OSError as error:
        raise RunFolderError(
            f"{path}: the folder cannot be made: {error.strerror or error}; choose another --out"
        ) from None


class WorkFolder:
    """Folder of one piece of work; a context manager that holds the folder's lock.

    Parameters
    ----------
    path
        The folder, made where there is none.
    identity
        Hashes of all that the results depend on, by words for what they are of.
    resume
        Whether it may hold this work already.

    Raises
    ------
    RunFolderError
        It holds other work or foreign files, or this work while ``resume`` is not set, or cannot be written.
    """

    #: Name of the file that says what the folder belongs to.
    record: ClassVar[str]
    #: What a user calls the work, such as ``calibration``.
    work: ClassVar[str]
    #: Raised when files of older versions cannot be continued.
    version: ClassVar[int] = 1

    def __init__(self, path: Path, identity: Mapping[str, str], *, resume: bool = False) -> None:
        self.path = path
        self._lock: int | None = None
        self._expected: dict[str, Any] = {
            "format": f"porocore-{self.work}",
            "version": self.version,
            "identity": dict(identity),
        }
        require_outside_a_run(path.absolute())
        claim_folder(
            path,
            self.record,
            self.work,
            resume=resume,
            lock=self,
            begin=lambda: write_json(path / self.record, self._expected, indent=2),
            check=self._check_same,
        )

    def _check_same(self) -> None:
        record = self.path / self.record
        try:
            found = read_json(record)
        except ValueError as error:
            raise RunFolderError(
                f"{record} is damaged ({reason(error)}); start again in another --out"
            ) from error
        if found != self._expected:
            raise RunFolderError(
                f"{self.path} holds another {self.work}, {self._difference(found)}; choose another --out, or undo the "
                "change"
            )

    def _difference(self, found: Any) -> str:
        """Return words for what differs in a record that was read."""
        known = found.get("identity") if isinstance(found, dict) else None
        mine = self._expected["identity"]
        if not isinstance(known, dict) or {**found, "identity": mine} != self._expected:
            return "whose record is of another version, or damaged"
        return f"with other {joined(name for name in {**mine, **known} if known.get(name) != mine.get(name))}"

    def __enter__(self) -> Self:
        """Take the lock; the system releases it when the process ends, however it ends."""
        self._lock = lock_folder(self.path)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _require_own_files(path: Path, record: str, work: str, left_by_a_start: Callable[[str], bool]) -> None:
    require_a_way(path)
    require_no_file(path)
    present = {entry.name for entry in path.iterdir()} if path.exists() else set()
    if record in present:
        return
    foreign = [
        name for name in present - {LOCK} if not (is_half_written(name, record) or left_by_a_start(name))
    ]
    if foreign:
        raise RunFolderError(
            f"{path} is not empty and holds no {work} of porocore (found {some_of(sorted(foreign))}); "
            "choose another --out"
        )


def is_half_written(name: str, of: str) -> bool:
    """Return True for the name of a temporary file of :func:`~porocore.core.files.atomic.atomic_path`."""
    return name.startswith(f".{of}.") and name.endswith(".part")


def some_of(names: list[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    shown = ", ".join(names[:4])
    return f"{shown} and {len(names) - 4} more" if len(names) > 4 else shown
