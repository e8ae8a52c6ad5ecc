"""Virtual environments that know nothing of the checkout."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

#: Another torch may bring its CUDA build (gigabytes).
CONSTRAINTS = Path(__file__).parents[2] / "constraints/other.txt"
_KEPT_OUT = (
    *("COLUMNS", "FORCE_COLOR", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"),
    # What is imported is compiled then, and kept.
    "PYTHONDONTWRITEBYTECODE",
)
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if name not in _KEPT_OUT},
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
    "COLUMNS": "160",
    "PIP_DISABLE_PIP_VERSION_CHECK": "1",
}
OWN = re.compile(r"porocore\b|porocore_|porocore-|__editable__|__pycache__|.*\.(pth|egg-link)$")


class Environment:
    """A virtual environment.

    Parameters
    ----------
    folder
        Where it is made.
    pip
        Whether it has a pip of its own; without, the pip of the Python that runs the tests serves it.
    """

    def __init__(self, folder: Path, *, pip: bool = True) -> None:
        self.folder = folder
        self.python = folder / "bin/python"
        # Of the Python that made the environment of the tests, whose packages it does not see.
        words = [sys.executable, "-m", "venv", *([] if pip else ["--without-pip"]), folder]
        subprocess.run(words, check=True, capture_output=True)
        self._pip = (
            [self.python, "-m", "pip"] if pip else [sys.executable, "-m", "pip", "--python", self.python]
        )
        (self.site,) = folder.glob("lib/python*/site-packages")

    def run(self, *words: object, cwd: Path, status: int = 0) -> tuple[str, str]:
        """Run a command of this environment: standard output, standard error."""
        search = f"{self.folder / 'bin'}{os.pathsep}{ENVIRONMENT['PATH']}"
        done = subprocess.run(
            [*map(str, words)],
            env={**ENVIRONMENT, "PATH": search},
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        said = done.stdout + done.stderr
        assert done.returncode == status, f"{words}: exit status {done.returncode}\n{said}"
        assert "Traceback" not in said, f"{words}\n{said}"
        return done.stdout, done.stderr

    def pip(self, *words: object) -> str:
        """Run pip."""
        command, *more = words
        # Compiling all of the libraries takes longer than all that is done with them here.
        extra = ["--no-compile"] if command == "install" else []
        return self.run(*self._pip, command, *extra, *more, cwd=self.folder)[0]

    def install(self, *what: object) -> None:
        """Install, and look whether everything has what it needs."""
        self.pip("install", "-q", *what)
        self.pip("check")

    def porocore(self, *words: object, cwd: Path, status: int = 0) -> tuple[str, str]:
        """Run the command of this environment."""
        return self.run(self.folder / "bin/porocore", *words, cwd=cwd, status=status)

    def plugins(self) -> list[dict[str, Any]]:
        """What ``porocore plugins`` tells."""
        rows: list[dict[str, Any]] = json.loads(self.porocore("plugins", "--json", cwd=self.folder)[0])
        return rows

    def states(self) -> dict[tuple[str, str], str]:
        """State of each plugin by kind and name, those of the core left out."""
        return {
            (row["kind"], row["name"]): row["state"]
            for row in self.plugins()
            if row["distribution"] != "porocore"
        }

    def remove(self) -> None:
        """Delete it: it may hold gigabytes."""
        shutil.rmtree(self.folder)


def copy_libraries(source: Environment, target: Environment) -> None:
    """What is installed in one environment into another as hard links, porocore and its plugins excepted."""
    there = {path.name for path in target.site.iterdir()}
    for path in source.site.iterdir():
        if not OWN.match(path.name) and path.name not in there:
            shutil.copytree(
                path, target.site / path.name, copy_function=os.link
            ) if path.is_dir() else os.link(path, target.site / path.name)


def link_libraries(environment: Environment) -> None:
    """Let an environment see every package of the Python that runs the tests, porocore and its plugins excepted.

    Nothing is fetched or copied, so it is no empty environment; but what is installed into it comes from there alone.
    """
    libraries = environment.folder / "libraries"
    libraries.mkdir()
    for place in _places():
        there = {_project(path.name) for path in libraries.iterdir()}
        for path in place.iterdir():
            if not OWN.match(path.name) and _project(path.name) not in there:
                (libraries / path.name).symlink_to(path)
    (environment.site / "libraries.pth").write_text(f"{libraries}\n", encoding="utf-8")


def _places() -> Iterator[Path]:
    for entry in sys.path:
        if Path(entry).name in ("site-packages", "dist-packages") and Path(entry).is_dir():
            yield Path(entry)


def _project(name: str) -> str:
    """``numpy-1.26.4.dist-info`` and ``numpy-1.24.2.egg-info`` are of one project; a package is its own."""
    found = re.fullmatch(r"(.+?)-[^-]*(?:-py[\d.]+)?\.(?:dist|egg)-info", name)
    return f"{found[1].lower().replace('-', '_')} metadata" if found else name
