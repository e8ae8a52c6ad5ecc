"""Commands that break one law each; the class attribute says which.

Each is installed by metadata in a folder of its own, whose hook offers the command of the class ``WRONG``.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer
from pydantic import BaseModel

from porocore.core.files.atomic import atomic_path
from porocore.core.files.claim import WorkFolder
from porocore.core.models.strict import StrictModel
from porocore.errors import ConfigurationError
from porocore.interfaces.command import Command
from porocore.testing import CommandSuite

SITE = Path(tempfile.gettempdir()) / f"porocore-wrong-commands-{os.getuid()}"
HOOKS = """
import os
{more}
from porocore import CommandOffer, hookimpl

def load():
    import importlib.util
    spec = importlib.util.spec_from_file_location("wrong_commands", {here!r})
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, os.environ.get("WRONG", "TestFine")).command

@hookimpl
def porocore_commands():
    return [CommandOffer("count", load, "Count to a number.", section="count")]
"""
Config = Annotated[Path, typer.Argument(help="Study.")]
Out = Annotated[Path, typer.Option("--out", help="Folder.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue.")]
Pause = Annotated[float, typer.Option(help="Pause at each number [s].")]


def install(name: str = "count", more: str = "") -> str:
    """Return the folder of a distribution with the command."""
    site = SITE / name
    info = site / f"wrong_{name}-1.0.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    for path, text in (
        (info / "METADATA", f"Metadata-Version: 2.1\nName: wrong-{name}\nVersion: 1.0\n"),
        (info / "entry_points.txt", f"[porocore]\ncount = wrong_{name}_hooks\n"),
        (site / f"wrong_{name}_hooks.py", HOOKS.format(more=more, here=__file__)),
    ):
        part = path.with_name(f"{path.name}.{os.getpid()}")
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    return str(site)


class CountSection(StrictModel):
    """Section of the command."""

    most: int = 3
    """Last number."""


class CountFolder(WorkFolder):
    record, work = "count.json", "count"


class Fine(Command):
    """It counts to 3 in files, and obeys all checks."""

    def run(self, config: Config, out: Out = Path("out"), resume: Resume = False, pause: Pause = 0.2) -> None:
        """Count to a number."""
        if not config.is_file():
            raise ConfigurationError(f"{config}: no such file; give a study")
        self.count(out, resume, pause)

    def count(self, out: Path, resume: bool, pause: float) -> None:
        with CountFolder(out, {"study": "1"}, resume=resume) as folder:
            for number in range(3):
                self.write(folder.path / f"{number}.txt", str(number))
                time.sleep(pause)
            self.write(folder.path / "all.txt", "0 1 2")

    def write(self, path: Path, text: str) -> None:
        with atomic_path(path) as part:
            part.write_text(text, encoding="utf-8")

    def section(self) -> Any:
        return CountSection


class _Law(CommandSuite):
    kit_version = "5"
    name = "count"
    arguments = ("study.yaml",)
    results = ("all.txt",)
    caught_by: ClassVar[str]
    command: ClassVar[type[Command]] = Fine
    site: ClassVar[str] = ""

    @classmethod
    def make_command(cls) -> Command:
        return cls.command()

    @classmethod
    def prepare(cls, folder: Path) -> None:
        (folder / "study.yaml").write_text("count: {}\n", encoding="utf-8")

    @classmethod
    def setup_class(cls) -> None:
        cls.site = install()
        sys.path.insert(0, cls.site)
        cls.environment = {"WRONG": cls.__name__}

    @classmethod
    def teardown_class(cls) -> None:
        from porocore.plugins.registry import registry

        sys.path.remove(cls.site)
        registry.cache_clear()

    def offer(self):
        from porocore.plugins.registry import registry

        registry.cache_clear()
        return super().offer()


class TestFine(_Law):
    caught_by = ""


class TestSaysSomethingElse(_Law):
    caught_by = "test_its_help_is_fast_and_begins_with_its_summary"
    slow = True

    class command(Fine):
        def run(self, config: Config, out: Out = Path("out"), resume: Resume = False) -> None:
            """Draw a picture."""


class TestNumberWithoutUnit(_Law):
    caught_by = "test_numbers_have_their_units_in_the_help"

    class command(Fine):
        def run(
            self, config: Config, length: Annotated[float, typer.Option(help="The length.")] = 1.0
        ) -> None:
            """Count to a number."""


class TestHeavyHooks(_Law):
    """Every command waits for a library."""

    caught_by = "test_its_hooks_import_nothing_heavy"

    @classmethod
    def setup_class(cls) -> None:
        super().setup_class()
        sys.path.remove(cls.site)
        cls.site = install("heavy", "import numpy")
        sys.path.insert(0, cls.site)


class TestRaisesWhatItWants(_Law):
    caught_by = "test_a_wrong_call_is_one_message"
    slow = True

    class command(Fine):
        def run(self, config: Config, out: Out = Path("out"), resume: Resume = False) -> None:
            """Count to a number."""
            config.read_text(encoding="ascii").index("count")
            raise KeyError(config)


class TestForgetsItsResults(_Law):
    caught_by = "test_it_writes_what_it_says"
    slow = True

    class command(Fine):
        def write(self, path: Path, text: str) -> None:
            if path.name != "all.txt":
                super().write(path, text)


class TestWritesBesideItsFolder(_Law):
    caught_by = "test_it_writes_what_it_says"
    slow = True

    class command(Fine):
        def write(self, path: Path, text: str) -> None:
            super().write(path, text)
            Path("log.txt").write_text(text, encoding="utf-8")


class TestTakesAnyFolder(_Law):
    caught_by = "test_a_folder_of_something_else_is_refused"
    slow = True

    class command(Fine):
        def count(self, out: Path, resume: bool, pause: float) -> None:
            out.mkdir(exist_ok=True)
            self.write(out / "all.txt", "0 1 2")


class TestHalfAFile(_Law):
    """Its result grows from number to number."""

    caught_by = "test_an_interrupted_run_leaves_whole_files_and_goes_on"
    slow = True

    class command(Fine):
        def count(self, out: Path, resume: bool, pause: float) -> None:
            with (
                CountFolder(out, {"study": "1"}, resume=resume) as folder,
                (folder.path / "all.txt").open("w", encoding="utf-8") as file,
            ):
                for number in range(3):
                    print(number, file=file, flush=True)
                    time.sleep(pause)


class TestOpenSection(_Law):
    caught_by = "test_its_section_refuses_unknown_keys"

    class command(Fine):
        def section(self) -> Any:
            class Open(BaseModel):
                most: int = 3

            class Outer(StrictModel):
                inner: Open = Open()

            return Outer
