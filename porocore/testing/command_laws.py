"""Suite of commands (CommandSuite): help, refusals, files, interruption, section; run as a user runs them."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import pytest

from porocore.core.models.strict import StrictModel
from porocore.interfaces.command import Command
from porocore.plugins.discovery import Offered
from porocore.plugins.hookspecs import CommandOffer
from porocore.plugins.registry import find_command
from porocore.testing.expect import holds
from porocore.testing.suite import Suite

#: Seconds that a help page may take, and a whole run.
SOON, PATIENCE = 3.0, 600.0
#: Libraries that the module with the hooks must not import.
HEAVY = (
    "numpy",
    "scipy",
    "pydantic",
    "h5py",
    "matplotlib",
    "gmsh",
    "torch",
    "jax",
    "skfem",
    "dolfinx",
    "pandas",
)
#: By these words a help text says the unit of a number.
UNIT = re.compile(r"\[[^\]]+\]|%|\b(per cent|percent\w*|multiples?|shares?|dimensionless|units?|in \w+s)\b")


class CommandSuite(Suite):
    """Laws of a command, which must be installed.

    Attributes
    ----------
    name
        The words behind ``porocore`` that call it, such as ``my-study``.
    arguments
        Words with which it runs for some seconds, the study first; of ``--out DIR`` and ``--resume`` the suite takes
        care. None: it is not run.
    results
        Names of the files that a whole run writes into its folder, the same at each run.
    environment
        Further environment variables of its processes.
    """

    name: ClassVar[str] = ""
    arguments: ClassVar[Sequence[str] | None] = None
    results: ClassVar[Sequence[str]] = ()
    environment: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def make_command(cls) -> Command:
        """Return the command.

        Raises
        ------
        Undefined
            The suite does not define it.
        """
        raise cls.undefined("make_command(cls)", "MyCommand()", "a porocore.Command")

    @classmethod
    def prepare(cls, folder: Path) -> None:
        """Write the files that ``arguments`` name."""

    def variables(self) -> dict[str, str]:
        """Return the environment variables of a process that finds the same packages."""
        path = os.pathsep.join(str(Path(part).resolve()) for part in sys.path if part)
        return {**os.environ, "COLUMNS": "200", "PYTHONPATH": path, **self.environment}

    def porocore(self, folder: Path, *words: str) -> subprocess.Popen[str]:
        """Return the process of a command that was started in a folder."""
        return subprocess.Popen(
            [sys.executable, "-m", "porocore", *self.name.split(), *words],
            env=self.variables(),
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def ended(self, folder: Path, *words: str) -> tuple[int, str, str]:
        """Return exit status, standard output and standard error of a command."""
        process = self.porocore(folder, *words)
        out, err = process.communicate(timeout=PATIENCE)
        return process.returncode, out, err

    def run_words(self) -> list[str]:
        """Return the words of a run into the folder ``out``."""
        self.needs(self.arguments is not None, "arguments = None: it is not run")
        assert self.arguments is not None
        return [*self.arguments, "--out", "out"]

    def offer(self) -> Offered:
        """Return the offer of the command."""
        *group, name = self.name.split()
        found = find_command(lambda offer: (offer.group, offer.name) == (" ".join(group), name))
        holds(found is not None, f"porocore {self.name}", "an installed command", "none of this name")
        assert found is not None
        return found

    @pytest.fixture(scope="class")
    def whole(self, tmp_path_factory: pytest.TempPathFactory) -> Path:
        """Folder in which a whole run worked."""
        words, folder = self.run_words(), tmp_path_factory.mktemp("whole")
        self.prepare(folder)
        status, _, err = self.ended(folder, *words)
        holds(status == 0, "a whole run", "exit status 0", f"{status}: {err}")
        return folder

    def test_its_help_is_fast_and_begins_with_its_summary(self, tmp_path: Path) -> None:
        began = time.perf_counter()
        status, out, err = self.ended(tmp_path, "--help")
        seconds = time.perf_counter() - began
        holds(status == 0, "--help", "exit status 0", f"{status}: {err}")
        summary = " ".join(self.offer().offer.summary.split())
        holds(summary in " ".join(out.split()), "--help", f"the summary of its offer, {summary!r}", out)
        holds(seconds < SOON, "--help", f"less than {SOON:g} s", f"{seconds:.1f} s")

    def test_numbers_have_their_units_in_the_help(self) -> None:
        for name, hint in get_type_hints(self.make_command().run, include_extras=True).items():
            value, *more = get_args(hint) if get_origin(hint) is Annotated else (hint,)
            if value is float or float in get_args(value):
                said = " ".join(f"{each.help or ''} {each.metavar or ''}" for each in more).strip().lower()
                holds(UNIT.search(said), f"the number {name}", "its unit, such as [s] or 'share'", said)

    def test_its_hooks_import_nothing_heavy(self, tmp_path: Path) -> None:
        offered = self.offer()
        code = f"import runpy, sys; runpy.run_path({offered.source.file!r})"
        code += f"; print(*[name for name in {HEAVY} if name in sys.modules])"
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=self.variables(),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        holds(
            not done.stdout.strip(),
            offered.source.file,
            "no heavy library imported",
            done.stdout or done.stderr,
        )

    def test_a_wrong_call_is_one_message(self, tmp_path: Path) -> None:
        calls = {"an unknown option": ["--no-such-option"]}
        if self.arguments:
            calls["a study that is not there"] = ["no-such-study.yaml", *self.arguments[1:], "--out", "out"]
        for state, words in calls.items():
            status, _, err = self.ended(tmp_path, *words)
            holds(status == 2, state, "exit status 2", f"{status}: {err}")
            holds("Traceback" not in err, state, "one message", err)
            holds(not names_below(tmp_path), state, "no files", ", ".join(map(str, names_below(tmp_path))))

    def test_it_writes_what_it_says(self, whole: Path, tmp_path: Path) -> None:
        self.prepare(tmp_path)
        new = {name for name in names_below(whole) - names_below(tmp_path) if name.parts[0] != "out"}
        holds(not new, "a whole run", "no file outside --out", ", ".join(map(str, sorted(new))))
        for name in self.results:
            holds(
                (whole / "out" / name).is_file(),
                "a whole run",
                f"the file {name}",
                names_below(whole / "out"),
            )
        left = [name for name in names_below(whole / "out") if name.suffix == ".part"]
        holds(not left, "a whole run", "no temporary files", ", ".join(map(str, left)))

    def test_a_folder_of_something_else_is_refused(self, tmp_path: Path) -> None:
        words = self.run_words()
        self.prepare(tmp_path)
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "diary.txt").write_text("mine", encoding="utf-8")
        status, _, err = self.ended(tmp_path, *words)
        state = "--out is a folder with a file diary.txt"
        holds(status == 2, state, "exit status 2", f"{status}: {err}")
        there = names_below(tmp_path / "out")
        holds(
            there <= {Path("diary.txt"), Path(".lock")}, state, "nothing written", ", ".join(map(str, there))
        )

    def test_an_interrupted_run_leaves_whole_files_and_goes_on(self, whole: Path, tmp_path: Path) -> None:
        """Ctrl-C as soon as there is a file beside the record; ``--resume`` comes to the same results."""
        words, out = self.run_words(), tmp_path / "out"
        self.prepare(tmp_path)
        process = self.porocore(tmp_path, *words)
        while process.poll() is None and len(names_below(out)) < 3:  # lock, record, first file
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
        state = "interrupted by Ctrl-C"
        holds(process.returncode in (0, 130), state, "exit status 130", f"{process.returncode}: {err}")
        self.same_results(whole, out, state, absent=True)
        _, helped, _ = self.ended(tmp_path, "--help")
        if "--resume" not in helped:
            shutil.rmtree(out, ignore_errors=True)
        status, _, err = self.ended(tmp_path, *words, *(["--resume"] if "--resume" in helped else []))
        holds(status == 0, f"{state}, and called again", "exit status 0", f"{status}: {err}")
        self.same_results(whole, out, f"{state}, and called again")

    def same_results(self, whole: Path, out: Path, state: str, absent: bool = False) -> None:
        """Require the results of a whole run, of which some may be absent."""
        for name in self.results:
            if absent and not (out / name).exists():
                continue
            same = (out / name).is_file() and (out / name).read_bytes() == (whole / "out" / name).read_bytes()
            holds(same, state, f"{name} as of a run without interruption", "another or none")

    def test_its_section_refuses_unknown_keys(self) -> None:
        model = self.make_command().section()
        self.needs(model is not None, "it has no section")
        assert model is not None
        holds(issubclass(model, StrictModel), "its section", "a subclass of porocore.StrictModel", model)
        open_ = [name for name, part in sections_of(model) if part.get("additionalProperties") is not False]
        holds(not open_, "its section", "sections that refuse unknown keys (StrictModel)", ", ".join(open_))
        offer = self.offer().offer
        key = offer.section if isinstance(offer, CommandOffer) else ""
        holds(key, "its offer", "the key of its section", "none")


def names_below(folder: Path) -> set[Path]:
    """Return the files below a folder, relative to it."""
    return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}


def sections_of(model: type[StrictModel]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and JSON schema of a section and of those below it."""
    schema = model.model_json_schema()
    yield model.__name__, schema
    yield from ((name, part) for name, part in schema.get("$defs", {}).items() if "properties" in part)
