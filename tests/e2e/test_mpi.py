"""Several MPI processes: the same history, one voice, and a clear word from what cannot share its work."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import fields
from importlib.util import find_spec

import numpy as np
import pytest

from porocore.interfaces.solution import History, MacroSolution
from porocore.study.config.loading import load_config
from porocore.study.run.folder import RunFolder
from tests.e2e.study import (
    ENVIRONMENT,
    LOADS,
    ONE_LOAD,
    POROCORE,
    contents,
    fingerprint,
    message,
    porocore,
    succeeded,
    write_study,
)
from tests.helpers.platform_parts import without

MPIRUN = shutil.which("mpirun")
if not os.environ.get("CI") or without("dolfinx"):
    if MPIRUN is None:
        pytest.skip("mpirun is missing", allow_module_level=True)
    if not find_spec("dolfinx"):
        pytest.skip("dolfinx is not installed", allow_module_level=True)
LOAD = LOADS[0]
NAMES = [f"{law}_load{LOAD!r}.h5" for law in ("mean-gradient", "linear")]
#: One load, and as many steps as a comparison needs.
SHORT = ONE_LOAD | {
    "macro.time": {"end": 24, "step": 3, "ramp_increments": 4, "ramp_step": 0.2, "profiles": [1, 10]},
}


def mpirun(processes, *words):
    """The command on so many processes, more than there are cores if need be, and that as root, too."""
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    return subprocess.run(
        [MPIRUN, "--oversubscribe", "-n", str(processes), str(POROCORE), *map(str, words)],
        env=ENVIRONMENT | allowed | {"OMPI_MCA_mpi_yield_when_idle": "1"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def said(done):
    """What porocore wrote to standard error; mpirun adds its own lines after a failure."""
    return done.stderr.split(
        "\n--------------------------------------------------------------------------\n"
    )[0]


def solution(folder, name):
    return MacroSolution.load_file(folder / "solutions" / name)


def assert_same(found, expected, accuracy):
    """The same solution; a solver that keeps its factor takes more iterations, and shorter ones."""
    for field in fields(History):
        if field.name == "iterations":
            continue
        mine, theirs = (getattr(one.history, field.name) for one in (found, expected))
        scale = abs(theirs).max() if field.name != "stress_spread" else abs(expected.load)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=accuracy * scale, err_msg=field.name)
    for one, other in zip(found.profiles, expected.profiles, strict=True):
        mine = one.arrays()
        for name, theirs in other.arrays().items():
            scale = max(np.abs(theirs).max(), abs(expected.load))
            np.testing.assert_allclose(mine[name], theirs, rtol=0, atol=accuracy * scale, err_msg=name)


@pytest.fixture(scope="module")
def short(finished, tmp_path_factory):
    """A run with cell, states and surrogate of the finished one, solved by scikit-fem. Not to be changed."""
    folder = tmp_path_factory.mktemp("short")
    config = load_config(write_study(folder / "study.yaml", SHORT))
    run = RunFolder.claim(folder / "run", config).path
    for name in ("cell.json", "samples.h5", "test.h5", "surrogate.h5", "training.csv"):
        shutil.copy(finished / name, run)
    solved = succeeded(porocore("solve", run)).splitlines()
    assert [os.path.basename(line) for line in solved] == NAMES
    return run


@pytest.fixture
def copy_of_short(short, tmp_path):
    """Without the files and folders that are named."""

    def copy(*without):
        folder = tmp_path / "run"
        shutil.copytree(short, folder, ignore=shutil.ignore_patterns(*without))
        return folder

    return copy


@pytest.fixture(scope="module")
def one_and_two(short, tmp_path_factory):
    """Folders solved with dolfinx on one process and on two, and what the command said."""
    folders = []
    for processes in (1, 2):
        folder = tmp_path_factory.mktemp("mpi") / "run"
        shutil.copytree(short, folder, ignore=shutil.ignore_patterns("solutions"))
        folders.append((folder, mpirun(processes, "solve", folder, "--fem", "dolfinx")))
    return folders


@pytest.mark.slow
def test_two_processes_give_the_history_of_one_and_of_scikit_fem(one_and_two, short):
    (one, first), (two, second) = one_and_two
    assert first.returncode == 0, first.stderr
    assert second.returncode == 0, second.stderr
    for name in NAMES:
        assert_same(solution(two, name), solution(one, name), 1e-9)
        # The trained surrogate, solved by both backends.
        assert_same(solution(two, name), solution(short, name), 1e-6)
        assert solution(two, name).backend == "dolfinx"
        assert solution(short, name).backend == "skfem"


@pytest.mark.slow
def test_one_process_prints_and_the_folder_is_left_tidy(one_and_two):
    (one, first), (two, second) = one_and_two
    for folder, done in ((one, first), (two, second)):
        assert [os.path.basename(line) for line in done.stdout.splitlines()] == NAMES
        assert done.stderr.count("next: porocore report") == 1
        assert len(re.findall(rf"^linear, load {LOAD:g}: .* took ", done.stderr, re.M)) == 1
        assert not list((folder / "checkpoints").iterdir())
        assert not [path for path in folder.rglob("*") if path.name.endswith(".part")]


@pytest.mark.slow
def test_solutions_of_another_backend_are_replaced_only_on_demand(copy_of_short):
    run = copy_of_short(NAMES[1])
    before = contents(run / "solutions" / NAMES[0])
    done = porocore("solve", run)
    assert f"{NAMES[0]} is there already" in done.stderr
    assert contents(run / "solutions" / NAMES[0]) == before
    done = porocore("solve", run, "--fem", "dolfinx")
    succeeded(done)
    assert f"{NAMES[0]} is of skfem; solved again with dolfinx" in done.stderr
    assert solution(run, NAMES[0]).backend == "dolfinx"
    assert porocore("solve", run).stderr.count("is there already") == 2
    assert porocore("solve", run, "--fem", "dolfinx").stderr.count("is there already") == 2


def test_a_backend_that_cannot_share_its_work_says_so_once(finished):
    before = fingerprint(finished)
    done = mpirun(2, "solve", finished)
    assert done.returncode == 2
    assert done.stdout == ""
    assert said(done).count("error: ") == 1
    assert "macro solver 'skfem' cannot share its work among 2 MPI processes" in said(done)
    assert "Traceback" not in done.stderr
    assert fingerprint(finished) == before


@pytest.mark.parametrize(
    "command",
    ["sample", *(pytest.param(command, marks=pytest.mark.slow) for command in ("run", "train", "report"))],
)
def test_commands_that_do_not_share_say_so_once(study, finished, tmp_path, command):
    out = tmp_path / "run"
    words = [study, "--out", out] if command in ("run", "sample") else [finished]
    done = mpirun(2, command, *words)
    assert done.returncode == 2
    assert said(done).count("error: ") == 1
    assert f"'porocore {command}' was started as 2 MPI processes" in said(done)
    assert not out.exists()


@pytest.mark.slow
def test_an_error_of_the_first_process_alone_ends_all(copy_of_short):
    """The lock is taken by process 0 only; the other one must hear that it cannot be had."""
    run = copy_of_short("solutions")
    with RunFolder.open(run):
        done = mpirun(2, "solve", run, "--fem", "dolfinx")
    assert done.returncode == 2
    assert said(done).count("error: ") == 1
    assert "another porocore (process" in said(done)


def test_one_process_needs_no_mpirun(finished):
    """Variables of a batch system are no sign of MPI."""
    done = subprocess.run(
        [str(POROCORE), "train", str(finished)],
        env=ENVIRONMENT | {"SLURM_PROCID": "0", "SLURM_NTASKS": "8"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert message(porocore("solve", finished, "--fem", "dolfin")).startswith("unknown macro solver 'dolfin'")
