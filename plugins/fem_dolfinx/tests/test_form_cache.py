"""Compiling forms on a clean machine, side by side, after a kill, without a compiler, and with a foreign dolfinx."""

import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import pytest

from porocore_fem_dolfinx.compat import FORMS

VOLUME = "volume 1.000000000000"
COMPILE = """
    import numpy as np
    from mpi4py import MPI
    from porocore import PorocoreError
    try:
        from porocore_fem_dolfinx import compat
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        mesh = compat.make_mesh(MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else MPI.COMM_SELF,
            "tetrahedron", 1, points, np.array([[0, 1, 2, 3]])[: 1 if MPI.COMM_WORLD.rank == 0 else 0])
        import ufl
        value = compat.form(6.0 * compat.constant(mesh, 1.0) * ufl.dx)
        total = mesh.comm.allreduce(compat.fem.assemble_scalar(value))
        print(f"volume {total:.12f}\\n", end="", flush=True)
    except PorocoreError as error:
        print(error)
"""


def start(cache, *before, **environment):
    """A fresh process that compiles one form; it must not see the forms that others have compiled."""
    return subprocess.Popen(
        [*before, sys.executable, "-c", textwrap.dedent(COMPILE)],
        env={**os.environ, "XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def printed(process):
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out.strip()


def forms_in(cache):
    return cache / "porocore" / FORMS.name


def test_forms_are_kept_apart_from_those_of_other_programs(tmp_path):
    assert printed(start(tmp_path)) == VOLUME
    kept = sorted(path.relative_to(tmp_path).parts[:2] for path in tmp_path.rglob("*.cached"))
    assert kept == [("porocore", FORMS.name)]


def test_compiling_logs_nothing(tmp_path):
    """The C compiler's driver logs each call; where a handler is there it stood on standard error."""
    done = start(tmp_path)
    out, err = done.communicate(timeout=120)
    assert (out.strip(), err) == (VOLUME, "")


def test_two_processes_may_compile_the_same_form_at_once(tmp_path):
    both = [start(tmp_path) for _ in range(2)]
    assert [printed(process) for process in both] == [VOLUME, VOLUME]
    assert len(list(forms_in(tmp_path).glob("*.cached"))) == 1


def test_two_mpi_ranks_compile_once(tmp_path):
    ranks = ["mpirun", "-n", "2", "--oversubscribe"]
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    assert printed(start(tmp_path, *ranks, **root)).splitlines() == [VOLUME, VOLUME]
    assert len(list(forms_in(tmp_path).glob("*.cached"))) == 1


def test_a_kill_during_compilation_fails_nobody_after_it(tmp_path):
    slow = tmp_path / "bin" / "slow-compiler"
    slow.parent.mkdir()
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o755)
    killed = start(tmp_path, CC=str(slow))
    marks = []
    while not marks:
        assert killed.poll() is None, killed.communicate()
        marks = [path for path in forms_in(tmp_path).glob("*.c") if path.stat().st_size]
        time.sleep(0.05)
    killed.kill()
    killed.wait()
    with suppress(ProcessLookupError):  # the compiler had not been started yet
        os.killpg(killed.pid, signal.SIGKILL)
    assert not list(forms_in(tmp_path).glob("*.cached"))
    assert printed(start(tmp_path)) == VOLUME  # who waits for the dead gives up after ten seconds


def test_without_a_compiler_the_message_says_what_to_install(tmp_path):
    said = printed(start(tmp_path, CC=str(tmp_path / "no-such-compiler")))
    assert re.search(
        r"^dolfinx could not compile a form \(.*\); .*apt-get install gcc python3-dev$", said, re.M
    )


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "porocore").write_text("a file in the way")
    said = printed(start(tmp_path))
    assert str(forms_in(tmp_path)) in said
    assert said.endswith("set XDG_CACHE_HOME to a folder that can be written")


@pytest.mark.parametrize(
    ("version", "reason"),
    [
        ("0.4.1", "dolfinx 0.4.1 is too old"),
        pytest.param("0.12.0", "dolfinx 0.12.0 is newer than", marks=pytest.mark.slow),
        pytest.param(None, "numpy<2", marks=pytest.mark.slow),
    ],
)
def test_another_version_of_dolfinx_is_refused_in_words(tmp_path, version, reason):
    fake = tmp_path / "dolfinx"
    (fake / "fem").mkdir(parents=True)
    head = f"__version__ = {version!r}" if version else "raise ImportError('numpy.core.multiarray failed')"
    (fake / "__init__.py").write_text(head)
    (fake / "fem" / "__init__.py").write_text("class Expression: ...")
    (fake / "fem" / "petsc.py").touch()
    (fake / "mesh.py").touch()
    said = printed(start(tmp_path, PYTHONPATH=os.pathsep.join([str(tmp_path), *filter(Path, sys.path)])))
    assert reason in said
    assert "\n" not in said
