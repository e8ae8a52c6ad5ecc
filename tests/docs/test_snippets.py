"""Every command and every piece of Python of every page, in the page's order, in one folder that looks like a clone."""

from __future__ import annotations

import contextlib
import hashlib
import io
import linecache
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import yaml

from tests.docs.clone import Clone
from tests.docs.coarse import make_coarse
from tests.docs.commands import Command, all_commands, commands_of
from tests.docs.fragments import example, role, with_fragment
from tests.docs.given import provide
from tests.docs.not_run import reason
from tests.docs.pages import PAGES, Block, blocks_of, name_of, page
from tests.docs.shell import Shell, as_before

SHELL = ("sh", "bash", "console", "shell")
RUN = (*SHELL, "python")
#: What may not be installed, by what shows that a page needs it.
NEEDS = {
    "to_xarray": "xarray",
    "to_pyvista": "pyvista",
    "porocore reproduce": "pyvista",
    "tcp://": "distributed",
    "--fem dolfinx": "dolfinx",
}
#: Commands that take more than some seconds even so; run with --run-slow, and where CI is set.
SLOW = ("porocore reproduce dehghani2022",)
#: Commands on whose results no later one of a page rests: done once with the same words and files.
LOOKING = ("stability", "sensitivity", "crosscheck", "verify", "reproduce", "cell", "units", "schema")


def shown(name: str) -> list[Block]:
    return blocks_of(page(name), name)


PAGES_TO_RUN = [n for n in map(name_of, PAGES) if any(block.language in RUN for block in shown(n))]


@pytest.fixture
def coarse() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        make_coarse(patch)
        yield


@pytest.fixture(scope="session")
def done() -> set[str]:
    """Commands of :data:`LOOKING` that were run, with the files that they read."""
    return set()


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """Gives the folder of a finished run of the coarse example, computed when it is first asked for."""
    folder = tmp_path_factory.mktemp("finished") / "run"

    def run() -> Path:
        if not folder.exists():
            import porocore

            porocore.Study("dehghani2022", out=folder).report()
        return folder

    return run


@pytest.mark.parametrize("name", PAGES_TO_RUN)
def test_the_snippets_of_a_page_run(name, tmp_path, coarse, service, finished, done, request):
    for word, module in NEEDS.items():
        if any(word in block.text for block in shown(name)):
            pytest.importorskip(module)
    slow = request.config.getoption("--run-slow") or "CI" in os.environ
    clone = Clone(tmp_path)
    place = clone.place(name)
    place.mkdir(parents=True, exist_ok=True)
    shell = Shell(clone, place, service)
    names: dict[str, Any] = {}
    try:
        with as_before():
            for block in shown(name):
                what, file = role(block)
                if what == "file":
                    provide(block.text, shell.folder, clone, finished)
                    write(shell.folder / file, block.text)
                elif what == "in":
                    write(shell.folder / file, merged(shell.folder / file, block))
                elif block.language == "python":
                    provide(block.text, shell.folder, clone, finished)
                    python(block, names, shell)
                elif block.language in SHELL:
                    for command in commands_of(block):
                        if reason(command.text) is None and (slow or command.text not in SLOW):
                            provide(command.text, shell.folder, clone, finished)
                            if not again(command, shell.folder, done):
                                shell.run(command)
    finally:
        shell.close()


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def merged(path: Path, block: Block) -> str:
    base = yaml.safe_load(path.read_text(encoding="utf-8")) if path.exists() else example()
    return yaml.safe_dump(with_fragment(base, yaml.safe_load(block.text)), sort_keys=False)


def python(block: Block, names: dict[str, Any], shell: Shell) -> None:
    """Execute a block; all of a page share their names."""
    file = f"<{block}>"
    # So that a traceback shows the line of the page.
    linecache.cache[file] = (len(block.text), None, block.text.splitlines(keepends=True), file)
    code = compile(block.text, file, "exec")
    with (
        contextlib.chdir(shell.folder),
        contextlib.redirect_stdout(io.StringIO()),
        mock.patch.dict(os.environ, shell.environment, clear=True),
        mock.patch.object(sys, "path", [str(shell.folder), *sys.path]),
    ):
        exec(code, names)


def again(command: Command, folder: Path, done: set[str]) -> bool:
    """Whether a command that only looks has been run before on the same files; remembers it otherwise."""
    if not command.is_porocore or not command.plain or command.words[1] not in LOOKING:
        return False
    files = [folder / word for word in command.words[1:]]
    digest = hashlib.sha256("\n".join(command.words).encode())
    for file in files:
        if file.is_file():
            digest.update(file.read_bytes())
        elif file.is_dir():
            return False
    if digest.hexdigest() in done:
        return True
    done.add(digest.hexdigest())
    return False


def test_slow_commands_are_shown():
    assert set(SLOW) <= {command.text for command in all_commands()}
