"""One thread for numerical libraries, unless the user has set a number."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from threadpoolctl import threadpool_info

from porocore.core.parallel.memory import (
    THREAD_VARIABLES,
    one_blas_thread,
    one_thread_from_now,
    one_thread_in_children,
)


@pytest.fixture
def unset(monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)


def blas() -> list[int]:
    import numpy as np

    np.dot(np.ones((2, 2)), np.ones((2, 2)))
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.usefixtures("unset")
def test_the_process_takes_one_thread_unless_the_user_chose(monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.setenv(name, "")  # so that what is set here is undone
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    one_thread_from_now()
    assert [os.environ[name] for name in THREAD_VARIABLES] == ["", "3", "", ""]
    monkeypatch.setenv("MKL_NUM_THREADS", "")
    one_thread_from_now()
    assert {os.environ[name] for name in THREAD_VARIABLES} == {"1"}


@pytest.mark.usefixtures("unset")
def test_blas_goes_back_to_its_threads_after_the_block(monkeypatch):
    from threadpoolctl import threadpool_limits

    with threadpool_limits(2, user_api="blas"):
        before = blas()
        with one_blas_thread():
            assert set(blas()) == {1}
        assert blas() == before
        monkeypatch.setenv("OMP_NUM_THREADS", "2")
        with one_blas_thread():
            assert blas() == before, "the user has chosen"


@pytest.mark.usefixtures("unset")
def test_children_have_one_thread():
    with one_thread_in_children():
        assert {os.environ[name] for name in THREAD_VARIABLES} == {"1"}
    assert not set(THREAD_VARIABLES) & set(os.environ)


@pytest.mark.usefixtures("unset")
def test_the_command_line_computes_on_one_thread():
    script = (
        "import sys, os, porocore.cli; sys.argv = ['porocore', '--version']\n"
        "assert 'numpy' not in sys.modules, 'too late for the variables'\n"
        "os._exit = lambda status: print(os.environ['OPENBLAS_NUM_THREADS'], status)\n"
        "porocore.cli.program()"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ran.stdout.split()[-2:] == ["1", "0"], ran.stderr
