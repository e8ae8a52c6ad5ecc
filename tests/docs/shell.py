"""Runs the commands of a page as a reader does, one after the other; studies are coarse."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import shlex
import signal
import site
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest

from porocore.cli import main
from porocore.plugins.registry import registry
from tests.docs.clone import Clone
from tests.docs.coarse import begin
from tests.docs.commands import Command
from tests.docs.services import Service

PIP = (sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
#: Seconds that a command of the shell may take.
LIMIT = 60
OFFLINE = ("--no-deps", "--no-index", "--no-build-isolation")


class Shell:
    """One reader's terminal: a folder, an environment, and what has been started in the background."""

    def __init__(self, clone: Clone, folder: Path, service: Service) -> None:
        self.clone, self.folder, self.service = clone, folder, service
        self.environment = {
            **{k: v for k, v in os.environ.items() if k not in ("COLUMNS", "FORCE_COLOR", "PYTHONPATH")},
            **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
            "PATH": f"{clone.bin}:{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(clone.site),
            "PYTHONDONTWRITEBYTECODE": "1",
            # A store of the page's own, since its reader has one.
            "POROCORE_STORE": str(folder / ".store"),
        }
        self._background: list[subprocess.Popen[bytes]] = []

    def run(self, command: Command) -> None:
        """Run a command, which has to succeed."""
        if command.words[0] == "sed":
            self._check_sed(command)
        text = self.service.localised(command.text)
        if self.service.provides(command.text):
            self.service.start()
        elif re.match(r"pip install (-e )?\S+( #.*)?$", text):
            self._install(command, command.words[-1])
        elif text.endswith(" &"):
            self._begin(text.removesuffix("&"))
        elif command.is_porocore and command.plain:
            self._porocore(command, shlex.split(text, comments=True))
        elif command.is_porocore and not command.piped:
            self._porocore(command, self._expanded(text))
        else:
            self._bash(command, text)

    def close(self) -> None:
        """End what still runs."""
        for process in self._background:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait(20)

    def _porocore(self, command: Command, words: list[str]) -> None:
        """In this process, which has imported everything already."""
        out, err = io.StringIO(), io.StringIO()
        status: object = 0
        with (
            mock.patch.dict(os.environ, self.environment, clear=True),
            mock.patch.object(sys, "argv", ["porocore", *words[1:]]),
            contextlib.chdir(self.folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            begin(words[1])
            try:
                main()
            except SystemExit as end:
                status = end.code or 0
        if status == 130:
            raise KeyboardInterrupt
        assert status == 0, f"{command}\nstatus {status}\n{err.getvalue()[-2000:]}\n{out.getvalue()[-2000:]}"

    def _bash(self, command: Command, text: str) -> None:
        """In a shell; its folder and its variables stay for what follows."""
        state = self.clone.bin / ".state"
        process = subprocess.Popen(
            ["bash", "-c", f"set -e\n{text}\n{{ pwd; env -0; }} > {shlex.quote(str(state))}"],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            said, _ = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            pytest.fail(f"{command}\nstill runs after {LIMIT} s")
        assert process.returncode == 0, f"{command}\nstatus {process.returncode}\n{said.decode()[-3000:]}"
        folder, _, variables = state.read_text(encoding="utf-8").partition("\n")
        self.folder = Path(folder)
        self.environment = dict(item.split("=", 1) for item in variables.split("\0") if "=" in item)
        self.environment["PATH"] = f"{self.clone.bin}:{self.environment['PATH']}"

    def _check_sed(self, command: Command) -> None:
        """What it replaces has to be there: sed itself says nothing if it is not."""
        words = [word for word in command.words if word != "-i"]
        source = (self.folder / words[2]).read_text(encoding="utf-8")
        for old, _ in re.findall(r"s/([^/]+)/([^/]+)/", words[1]):
            assert re.search(old, source, re.MULTILINE), f"{command}: there is no '{old}' in {words[2]}"

    def _expanded(self, text: str) -> list[str]:
        done = subprocess.run(
            ["bash", "-c", f"set -e; printf '%s\\0' {text}"],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.rstrip("\0").split("\0")

    def _begin(self, text: str) -> None:
        process = subprocess.Popen(
            ["bash", "-c", f"exec {text}"],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._background.append(process)

    def _install(self, command: Command, project: str) -> None:
        """A project in a folder, by pip, beside the environment instead of into it; nothing is fetched."""
        place = [*(["-e"] if "-e" in command.words else []), project]
        done = subprocess.run(
            [*PIP, *OFFLINE, "--target", str(self.clone.site), *place],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stderr[-3000:]}"
        importlib.invalidate_caches()
        site.addsitedir(str(self.clone.site))
        registry.cache_clear()


@contextlib.contextmanager
def as_before() -> Iterator[None]:
    """Forget afterwards what was installed."""
    path, modules = sys.path[:], set(sys.modules)
    try:
        yield
    finally:
        sys.path[:] = path
        sys.meta_path[:] = [
            f for f in sys.meta_path if not getattr(f, "__module__", "").startswith("__editable__")
        ]
        for name in set(sys.modules) - modules:
            if name.startswith(("porocore_", "__editable__", "my_")):
                del sys.modules[name]
        importlib.invalidate_caches()
        registry.cache_clear()
