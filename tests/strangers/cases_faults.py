"""Inputs and circumstances that ended in an unexpected error, in the loss of work or in advice that harms."""

from __future__ import annotations

import copy
import csv
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from porocore import DataError, Study
from porocore.interfaces.solution import write_series
from porocore.sampling.datasets.dataset import Dataset
from tests.helpers.command_run import PROGRAM, Ended
from tests.helpers.stranger_case import Case


def _shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line of a shell in which ``$porocore`` is the command."""
    words = " ".join(f"'{word}'" for word in PROGRAM)
    # A shell may expand the quotes of no variable, so the command is a function.
    return subprocess.run(
        ["bash", "-c", f'porocore() {{ {words} "$@"; }}; {line}'], cwd=folder, capture_output=True, text=True
    )


def _runs_in_silence(folder: Path, done: Ended | None) -> None:
    for closed, status in (("2>&-", 0), ("2>&- >&-", 2), ("2>&- >&- <&-", 2)):
        found = _shell(f"porocore check base.yaml {closed}", folder)
        # What is printed on a closed standard output is lost, and neither is a message of that read.
        assert (found.returncode, found.stderr) == (status, ""), found
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


def _solved_and_read_again(*names: str) -> Callable[[Path, Ended | None], None]:
    """The check that studies are solved, read again by another object, and tabled, with the names as they are."""

    def check(folder: Path, done: Ended | None) -> None:
        for name in names:
            first = Study(f"{name}.yaml", out=name, progress=False)
            load = first.config.macro.loads[0]
            solved = first.solve()[load].nonlinear.solution
            again = Study(f"{name}.yaml", out=name, progress=False).solve()[load].nonlinear.solution
            assert set(again.probes) == set(first.config.macro.probes)
            assert set(again.inflow) == {
                n for n, b in first.config.macro.boundary.items() if b.pressure is not None
            }
            for probe, values in solved.probes.items():
                np.testing.assert_array_equal(again.probes[probe], values)
            for surface, values in solved.inflow.items():
                np.testing.assert_array_equal(again.inflow[surface], values)
            table = write_series(folder / f"{name}.csv", again, first.units)
            with table.open(encoding="utf-8", newline="") as file:
                head = next(csv.reader(file))
            for probe in first.config.macro.probes:
                assert f"{probe}: u_2 [-]" in head

    return check


_HOLD = (
    "import h5py, sys; file = h5py.File(sys.argv[1], 'r+'); print('held', flush=True); input(); file.close()"
)


def _open_elsewhere(folder: Path, done: Ended | None) -> None:
    """A data set that another program has open is no damaged one, and is read again once it is closed."""
    study = Study("base.yaml", out="r", progress=False)
    study.sample()
    samples = folder / "r" / "samples.h5"
    before = Dataset.open(samples).digest()
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(samples)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(DataError) as refused:
        study.train()
    assert str(refused.value) == (
        "r/samples.h5: open in another program, which may write it; close it there and try again"
    )
    holder.communicate("\n")
    assert Dataset.open(samples).digest() == before
    study.train()


def _not_closed(folder: Path, done: Ended | None) -> None:
    """A program that was killed while it had a data set open is told apart from damage."""
    Study("base.yaml", out="r", progress=False).sample()
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, "r/samples.h5"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout is not None
    holder.stdout.readline()
    holder.kill()
    holder.communicate()
    with pytest.raises(DataError, match=r"did not close it; .* move it to samples\.h5\.damaged, then"):
        Dataset.open(folder / "r" / "samples.h5")


_BASE = (Path(__file__).parent / "stderr_closed" / "base.yaml").read_text(encoding="utf-8")


def _base(folder: Path) -> None:
    (folder / "base.yaml").write_text(_BASE, encoding="utf-8")


def _dangling(folder: Path) -> None:
    _base(folder)
    os.symlink("nowhere", folder / "r")


def _encoded(name: str, data: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(data)


_IN_QUOTES = "write the key in quotes, as "
CASES = [
    *(
        Case("yaml_key_no_text", ("check", f"{name}.yaml"), 2, (f"{name}.yaml:{line}: {key}: ", *says))
        for name, line, key, says in (
            ("boolkey", 4, "yes", ("YAML reads yes as true", f"{_IN_QUOTES}'yes'")),
            ("nullkey", 4, "~", ("YAML reads ~ as no value", f"{_IN_QUOTES}'~'")),
            ("intkeys", 4, "1", ("unknown key; remove it; the keys here are title, cell,",)),
            ("ykey", 15, "macro.probes.on", ("YAML reads on as true", f"{_IN_QUOTES}'on'")),
            (
                "commadec2",
                2,
                "cell.geometry.radius",
                ("if 'radius: 0,25' was meant as a number, write 'radius: 0.25'",),
            ),
        )
    ),
    # Tags of a mesh name its surfaces, with quotes or without.
    Case("yaml_key_no_text", ("check", "nonames2.yaml"), says=("no faults",)),
    Case(
        "names_in_hdf5",
        ("check", "probeempty.yaml"),
        2,
        ("probeempty.yaml:24: macro.probes.'': expected a name, got ''; give it one letter at least",),
    ),
    Case(
        "names_in_hdf5",
        ("check", "probelong.yaml"),
        2,
        (
            "probelong.yaml:24: macro.probes.xxx",
            "expected a name of at most 200 characters, got 300; shorten it",
        ),
    ),
    Case(
        "names_in_hdf5",
        ("check", "probenl.yaml"),
        2,
        (r"probenl.yaml:24: macro.probes.a\nb: expected a name without line breaks and control characters",),
    ),
    Case("names_in_hdf5", "probes a and a/u are solved", check=_solved_and_read_again("probetwo")),
    Case(
        "names_in_hdf5",
        "names with a slash, of a dot and from a mesh are solved",
        check=_solved_and_read_again("probeslash", "probedot", "surfslash", "spaces"),
        slow=True,
    ),
    Case("h5_open_elsewhere", "a data set is open in another program", check=_open_elsewhere),
    Case("h5_open_elsewhere", "a program with a data set open was killed", check=_not_closed),
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
        (
            "a symbolic link to nowhere, which does not exist; remove or mend that link, or choose another --out",
        ),
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
