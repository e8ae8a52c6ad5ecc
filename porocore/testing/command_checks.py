"""Suite of commands (CommandSuite): help, refusals, files, interruption, section; run as a user runs them."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, get_args, get_origin, get_type_hints

import pytest

from porocore.core.models.strict import StrictModel
from porocore.interfaces.command import Command
from porocore.plugins.discovery import Offered
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
    """Checks of a command, which must be installed.

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
        NotImplementedError
            The suite does not define it.
        """
        raise cls.undefined("make_command(cls)", "MyCommand()", "a porocore.Command")

    @classmethod
    def prepare(cls, folder: Path) -> None:
        """Write the files that ``arguments`` name."""

    def started(self, folder: Path, *words: str, program: Sequence[str] = ()) -> subprocess.Popen[str]:
        """Return the process of the command, or of another ``program`` of Python, that works in a folder."""
        path = os.pathsep.join(str(Path(part).resolve()) for part in sys.path if part)
        return subprocess.Popen(
            [sys.executable, *(program or ("-m", "porocore", *self.name.split())), *words],
            env={**os.environ, "COLUMNS": "200", "PYTHONPATH": path, **self.environment},
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def said(
        self, process: subprocess.Popen[str], state: str, status: Sequence[int] = (0,)
    ) -> tuple[str, str]:
        """Return standard output and standard error of a process, which must end with a status."""
        out, err = process.communicate(timeout=PATIENCE)
        expected = " or ".join(map(str, status))
        holds(process.returncode in status, state, f"exit status {expected}", f"{process.returncode}: {err}")
        return out, err

    def run_words(self, folder: Path) -> list[str]:
        """Return the words of a run into ``out`` in a folder that has the files for it."""
        self.needs(self.arguments is not None, "arguments = None: it is not run")
        self.prepare(folder)
        return [*(self.arguments or ()), "--out", "out"]

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
        folder = tmp_path_factory.mktemp("whole")
        self.said(self.started(folder, *self.run_words(folder)), "a whole run")
        return folder

    def test_its_help_is_fast_and_begins_with_its_summary(self, tmp_path: Path) -> None:
        began = time.perf_counter()
        out, _ = self.said(self.started(tmp_path, "--help"), "--help")
        seconds = time.perf_counter() - began
        summary = " ".join(self.offer().offer.summary.split())
        holds(summary in " ".join(out.split()), "--help", f"the summary of its offer, {summary!r}", out)
        holds(seconds < SOON, "--help", f"less than {SOON:g} s", f"{seconds:.1f} s")

    def test_numbers_have_their_units_in_the_help(self) -> None:
        for name, hint in get_type_hints(self.make_command().run, include_extras=True).items():
            value, *more = get_args(hint) if get_origin(hint) is Annotated else (hint,)
            if value is float or float in get_args(value):
                told = " ".join(f"{each.help or ''} {each.metavar or ''}" for each in more).strip().lower()
                holds(UNIT.search(told), f"the number {name}", "its unit, such as [s] or 'share'", told)

    def test_its_hooks_import_nothing_heavy(self, tmp_path: Path) -> None:
        file = self.offer().source.file
        code = f"import runpy, sys; runpy.run_path({file!r}); print(*{{*{HEAVY}}} & {{*sys.modules}})"
        out, _ = self.said(self.started(tmp_path, program=("-c", code)), file)
        holds(not out.strip(), file, "no heavy library imported", out)

    def test_a_wrong_call_is_one_message(self, tmp_path: Path) -> None:
        calls = {"an unknown option": ["--no-such-option"]}
        if self.arguments:
            calls["a study that is not there"] = ["no-such-study.yaml", *self.arguments[1:], "--out", "out"]
        for state, words in calls.items():
            _, err = self.said(self.started(tmp_path, *words), state, (2,))
            holds("Traceback" not in err, state, "one message", err)
            holds(not names_below(tmp_path), state, "no files", names_below(tmp_path))

    def test_it_writes_what_it_says(self, whole: Path, tmp_path: Path) -> None:
        self.prepare(tmp_path)
        there = names_below(whole) - names_below(tmp_path)
        beside = [name for name in there if not name.startswith("out/")]
        holds(not beside, "a whole run", "no file outside --out", beside)
        left = [name for name in there if name.endswith(".part")]
        holds(not left, "a whole run", "no temporary files", left)
        missing = {f"out/{name}" for name in self.results} - there
        holds(not missing, "a whole run", f"the files {', '.join(self.results)}", f"none of {missing}")

    def test_a_folder_of_something_else_is_refused(self, tmp_path: Path) -> None:
        words, state = self.run_words(tmp_path), "--out is a folder with a file diary.txt"
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "diary.txt").write_text("mine", encoding="utf-8")
        self.said(self.started(tmp_path, *words), state, (2,))
        there = names_below(tmp_path / "out")
        holds(there <= {"diary.txt", ".lock"}, state, "nothing written", there)

    def test_an_interrupted_run_leaves_whole_files_and_goes_on(self, whole: Path, tmp_path: Path) -> None:
        """Ctrl-C as soon as there is a file beside the record; ``--resume`` comes to the same results."""
        words, out, state = self.run_words(tmp_path), tmp_path / "out", "interrupted by Ctrl-C"
        process = self.started(tmp_path, *words)
        while process.poll() is None and len(names_below(out)) < 3:  # lock, record, first file
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        self.said(process, state, (0, 130))
        self.same_results(whole, out, state, [name for name in self.results if (out / name).exists()])
        helped, _ = self.said(self.started(tmp_path, "--help"), "--help")
        if "--resume" in helped:
            words.append("--resume")
        else:
            shutil.rmtree(out, ignore_errors=True)
        self.said(self.started(tmp_path, *words), f"{state}, and called again")
        self.same_results(whole, out, f"{state}, and called again", self.results)

    def same_results(self, whole: Path, out: Path, state: str, names: Sequence[str]) -> None:
        """Require the results of a whole run."""
        for name in names:
            same = (out / name).is_file() and (out / name).read_bytes() == (whole / "out" / name).read_bytes()
            holds(same, state, f"{name} as of a run without interruption", "another or none")

    def test_its_section_refuses_unknown_keys(self) -> None:
        model, offer = self.make_command().section(), self.offer().offer
        self.needs(model is not None, "it has no section")
        assert model is not None
        holds(issubclass(model, StrictModel), "its section", "a subclass of porocore.StrictModel", model)
        schema = model.model_json_schema()
        parts = [schema, *(part for part in schema.get("$defs", {}).values() if "properties" in part)]
        open_ = [part.get("title") for part in parts if part.get("additionalProperties") is not False]
        holds(not open_, "its section", "sections that refuse unknown keys (StrictModel)", open_)
        holds(getattr(offer, "section", ""), "its offer", "the key of its section", "none")


def names_below(folder: Path) -> set[str]:
    """Return the files below a folder, relative to it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
