"""Inputs and circumstances that ended in an unexpected error, in the loss of work or in advice that harms."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from command_run import PROGRAM, Ended
from stranger_case import Case

from porocore import Study


def _shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line of a shell in which ``$porocore`` is the command."""
    words = " ".join(f"'{word}'" for word in PROGRAM)
    # A shell may expand the quotes of no variable, so the command is a function.
    return subprocess.run(
        ["bash", "-c", f'porocore() {{ {words} "$@"; }}; {line}'], cwd=folder, capture_output=True, text=True
    )


def _runs_in_silence(folder: Path, done: Ended | None) -> None:
    for closed in ("2>&-", "2>&- >&-", "2>&- >&- <&-"):
        found = _shell(f"porocore check base.yaml {closed}", folder)
        assert (found.returncode, found.stderr) == (0, ""), found
    found = _shell("porocore run base.yaml --out r 2>&-", folder)
    assert (found.returncode, found.stdout) == (0, "r/report.html\n")


def _python_samples_in_silence(folder: Path, done: Ended | None) -> None:
    program = "import porocore; porocore.Study('base.yaml', out='r').sample()"
    words = f"'{sys.executable}' -c \"{program}\" 2>&-"
    found = subprocess.run(["bash", "-c", words], cwd=folder, capture_output=True, text=True)
    assert (found.returncode, found.stdout) == (0, "")
    assert (folder / "r" / "samples.h5").is_file()


def _study_is_copied(folder: Path, done: Ended | None) -> None:
    study = Study("base.yaml", out="r", progress=True)
    study.solve()
    for other in (pickle.loads(pickle.dumps(study)), copy.deepcopy(study)):
        assert other.path == study.path
        assert other.config == study.config
        load = study.config.macro.loads[0]
        ours, theirs = (each.solve()[load].nonlinear.settlement for each in (study, other))
        assert ours[-1] == pytest.approx(theirs[-1], rel=1e-12)


def _full_output(folder: Path, done: Ended | None) -> None:
    found = _shell("porocore check base.yaml >/dev/full", folder)
    assert found.returncode == 2
    assert found.stderr == "error: standard output: No space left on device; send it somewhere else\n"


def _folder_removed(folder: Path, done: Ended | None) -> None:
    found = _shell(f"mkdir gone && cd gone && rmdir ../gone && porocore check '{folder}/base.yaml'", folder)
    assert found.returncode == 2
    assert found.stderr.endswith("error: the current folder was removed; change to another one (cd)\n")
    assert "MKL" not in found.stderr


def _module_is_a_program(folder: Path, done: Ended | None) -> None:
    found = subprocess.run(
        [sys.executable, "-m", "porocore", "--version"], cwd=folder, capture_output=True, text=True
    )
    assert found.returncode == 0
    assert found.stdout.startswith("porocore ")


_BASE = (Path(__file__).parent / "stderr_closed" / "base.yaml").read_text(encoding="utf-8")


def _base(folder: Path) -> None:
    (folder / "base.yaml").write_text(_BASE, encoding="utf-8")


def _dangling(folder: Path) -> None:
    _base(folder)
    os.symlink("nowhere", folder / "r")


def _encoded(name: str, data: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(data)


_IN_QUOTES = "write the key in quotes: "
CASES = [
    *(
        Case("yaml_key_no_text", ("check", f"{name}.yaml"), 2, (f"{name}.yaml:{line}: {key}: ", *says))
        for name, line, key, says in (
            ("boolkey", 4, "yes", ("YAML reads yes as true or false", f"{_IN_QUOTES}'yes':")),
            ("nullkey", 4, "~", ("YAML reads ~ as no value", f"{_IN_QUOTES}'~':")),
            ("intkeys", 4, "1", ("YAML reads 1 as a number", f"{_IN_QUOTES}'1':")),
            ("ykey", 15, "macro.probes.on", ("YAML reads on as true or false", f"{_IN_QUOTES}'on':")),
            (
                "nonames2",
                17,
                "macro.boundary.1",
                ("nonames2.yaml:22: macro.boundary.4: ", f"{_IN_QUOTES}'4':"),
            ),
            ("commadec2", 2, "cell.geometry.25", ("write 'radius: 0.25' if 'radius: 0,25' was meant",)),
        )
    ),
    Case("stderr_closed", "a run without standard error", check=_runs_in_silence, slow=True),
    Case("stderr_closed", "Study.sample() without standard error", check=_python_samples_in_silence),
    Case("pickle_study", "a study is pickled and copied", check=_study_is_copied),
    Case("small", "check >/dev/full", before=_base, check=_full_output),
    Case("small", "a current folder that was removed", before=_base, check=_folder_removed),
    Case("small", "python -m porocore", check=_module_is_a_program),
    Case(
        "small",
        ("run", "base.yaml", "--out", "r"),
        2,
        ("r is a symbolic link to nowhere, which does not exist; make that folder, or choose another --out",),
        before=_dangling,
    ),
    *(
        Case("small", ("check", name), 2, (f"{name}{says}",), before=_encoded(name, data))
        for name, data, says in (
            (
                "latin1.yaml",
                "title: x\n# Prüfung\n".encode("latin-1"),
                ":2: expected YAML text in UTF-8, got the byte 0xfc, "
                "which is 'ü' in Latin-1 (Windows-1252); save the file as UTF-8",
            ),
            (
                "utf16.yaml",
                "title: x\n".encode("utf-16"),
                ": expected YAML text in UTF-8, got UTF-16; save the file as UTF-8",
            ),
            (
                "formfeed.yaml",
                b"title: x\n\x0ccell: {}\n",
                r":2: expected YAML text, got the control character '\x0c'; remove it",
            ),
            (
                "null.yaml",
                b"title: x\n\ncell: \x00\n",
                r":3: expected YAML text, got the control character '\x00'; remove it",
            ),
        )
    ),
]
