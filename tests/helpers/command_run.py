"""A command run with a row's words: in this process, or in one of its own; watched for time and memory."""

from __future__ import annotations

import hashlib
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import pytest

from porocore.cli import main

#: Of POSIX alone, as is what watches a command here.
resource = pytest.importorskip("resource")

#: A command that has not ended then is stopped [s].
LATEST = 20
#: Writable memory beyond that of the beginning, at which the system refuses more [bytes].
BACKSTOP = 4 << 30
#: Of each file that is compared [bytes]; those with holes say that they are far larger.
READ = 64 << 20
PROGRAM = (sys.executable, "-c", "from porocore.cli import main; main()")


class TooLong(BaseException):
    """The command did not end; no handler of the program takes it for a fault."""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes
    ----------
    memory
        The largest resident memory beyond that of the beginning [bytes]; in a process of its own, all of it.
    """

    status: int | None
    out: str
    err: str
    seconds: float
    memory: int


def run_here(
    words: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    streams: pytest.CaptureFixture[str],
    latest: float = LATEST,
) -> Ended:
    """Run the command's entry in this process, in the current folder; it is stopped after ``latest`` seconds."""
    monkeypatch.setattr(sys, "argv", ["porocore", *words])
    streams.readouterr()
    _forget_the_peak()
    before, begun = _memory("VmRSS"), time.perf_counter()
    status: int | None = None
    with _limited(latest):
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
    seconds = time.perf_counter() - begun
    memory = _memory("VmHWM") - before
    captured = streams.readouterr()
    return Ended(status, captured.out, captured.err, seconds, memory)


def run_apart(words: tuple[str, ...], folder: Path) -> Ended:
    """Run the command in a process of its own."""
    begun = time.perf_counter()
    with (folder.with_name("out")).open("w+b") as out, (folder.with_name("err")).open("w+b") as err:
        process = subprocess.Popen(
            [*PROGRAM, *words], cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (BACKSTOP, BACKSTOP)),
        )  # fmt: skip
        killer = _alarm(lambda: process.kill())
        with killer:
            _, ended, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(ended)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode(errors="replace"))
    return Ended(
        process.returncode, *texts, seconds=time.perf_counter() - begun, memory=usage.ru_maxrss * 1024
    )


def fingerprint(folder: Path) -> dict[str, str]:
    """Everything below a folder, links and pipes included, but the content of locks."""
    found = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        content = ""
        if stat.S_ISLNK(mode):
            content = os.readlink(path)
        elif stat.S_ISREG(mode) and path.name == ".lock":
            continue
        elif stat.S_ISREG(mode):
            with path.open("rb") as file:
                content = f"{path.stat().st_size} {hashlib.sha256(file.read(READ)).hexdigest()}"
        found[str(path.relative_to(folder))] = f"{stat.filemode(mode)} {content}"
    return found


@contextmanager
def _limited(latest: float) -> Iterator[None]:
    """A block that may not run for ever, nor take all memory."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)

    def stop() -> None:
        raise TooLong(f"it has not ended after {latest:g} s")

    resource.setrlimit(resource.RLIMIT_DATA, (_memory("VmData") + BACKSTOP, hard))
    try:
        with _alarm(stop, latest):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def _alarm(action: object, latest: float = LATEST) -> Iterator[None]:
    def ring(number: int, frame: FrameType | None) -> None:
        action()  # type: ignore[operator]

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, latest)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _forget_the_peak() -> None:
    """Let VmHWM begin anew; ru_maxrss never falls, so it tells nothing in a process that has done other things."""
    Path("/proc/self/clear_refs").write_text("5")


def _memory(name: str) -> int:
    """A figure of /proc/self/status [bytes]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise KeyError(name)
