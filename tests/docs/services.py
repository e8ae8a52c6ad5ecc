"""The cluster of the pages: a dask scheduler and a worker on this machine, started as docs/cluster.md says."""

from __future__ import annotations

import contextlib
import os
import queue
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.commands import all_commands

#: The address that the pages give, and how their worker and scheduler say that they are ready.
ADDRESS, PORT, WORKERS = "tcp://node17:8786", "--port 8786", "--nworkers auto"
READY = {"dask scheduler": "Scheduler at:", "dask worker": "Registered to:"}


class Service:
    """Started when it is first asked for."""

    def __init__(self) -> None:
        self._processes: list[subprocess.Popen[str]] = []
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self._port = one.getsockname()[1]

    def provides(self, text: str) -> bool:
        """Whether a command is one of those that make the cluster."""
        return text.startswith(tuple(READY))

    def localised(self, text: str) -> str:
        """The command with this cluster's address, which is started if it is named."""
        if ADDRESS not in text:
            return text
        if not self.provides(text):
            self.start()
        return text.replace(ADDRESS, f"tcp://127.0.0.1:{self._port}")

    def start(self) -> None:
        """Scheduler and worker, by the commands of the page; returns when both are ready."""
        if self._processes:
            return
        pytest.importorskip("distributed")
        shown = [command.text for command in all_commands() if self.provides(command.text)]
        assert [text.split(" -")[0].split(" tcp")[0] for text in shown] == list(READY)
        for text, ready in zip(shown, READY.values(), strict=True):
            local = (
                self.localised(text).replace(PORT, f"--port {self._port}").replace(WORKERS, "--nworkers 1")
            )
            self._start(shlex.split(local, comments=True), ready)

    def _start(self, words: list[str], ready: str) -> None:
        process = subprocess.Popen(
            [str(Path(sys.executable).with_name(words[0])), *words[1:]],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._processes.append(process)
        said: queue.Queue[str] = queue.Queue()
        threading.Thread(target=_tell, args=(process, said), daemon=True).start()
        lines = [said.get(timeout=60)]
        while ready not in lines[-1]:
            lines.append(said.get(timeout=60))
            assert lines[-1], f"{words}: {''.join(lines)}"

    def close(self) -> None:
        """End both."""
        for process in reversed(self._processes):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait(30)


def _tell(process: subprocess.Popen[str], said: queue.Queue[str]) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        said.put(line)
    said.put("")


@pytest.fixture(scope="session")
def service() -> Iterator[Service]:
    """The cluster, not yet started."""
    made = Service()
    yield made
    made.close()
