"""The table of strangers' files: every case is answered as it says, and every folder has one."""

from __future__ import annotations

import importlib
from collections import Counter
from pathlib import Path

import pytest

from tests.helpers.command_run import LATEST, run_apart, run_here
from tests.helpers.message_words import assert_says_all

HERE = Path(__file__).parent
#: A slow command that has not ended then is stopped [s].
LATEST_OF_SLOW = 900.0
CASES = [
    case
    for path in sorted(HERE.glob("cases_*.py"))
    for case in importlib.import_module(f"tests.strangers.{path.stem}").CASES
]


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, id=c.name, marks=[pytest.mark.slow] if c.slow else []) for c in CASES],
)
def test_a_strangers_files_are_read_right_or_refused_in_one_message(case, tmp_path, monkeypatch, capfd):
    folder = tmp_path / "work"
    case.make_files(folder)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(folder)
    if case.before is not None:
        case.before(folder)
    if isinstance(case.words, str):
        case.check(folder, None)
        return
    latest = LATEST_OF_SLOW if case.slow else LATEST
    done = (
        run_apart(case.words, folder)
        if case.own_process
        else run_here(case.words, monkeypatch, capfd, latest)
    )
    told = " ".join((done.out + " " + done.err).split())
    assert done.status == case.status, f"{done.status}: {told[-3000:]}"
    assert "Traceback" not in told
    assert_says_all(done.err)
    for words in case.says:
        assert " ".join(words.split()) in told, told
    for words in case.never:
        assert " ".join(words.split()) not in told, told
    if case.check is not None:
        case.check(folder, done)


def test_every_folder_has_a_case():
    folders = {path.name for path in HERE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders - {case.folder for case in CASES} == set()


def test_the_names_tell_the_cases_apart():
    assert [name for name, count in Counter(case.name for case in CASES).items() if count > 1] == []
