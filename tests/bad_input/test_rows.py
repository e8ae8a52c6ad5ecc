"""The table of bad input: every row of every ``rows_*.py`` is refused with one message, and nothing is changed."""

from __future__ import annotations

import importlib
import re
from collections import Counter
from pathlib import Path
from zlib import crc32

import pytest

from tests.bad_input.bad_row import CONFIG, Row, commands
from tests.helpers.command_run import fingerprint, run_apart, run_here
from tests.helpers.message_words import assert_says_all

HERE = Path(__file__).parent
ROWS: list[Row] = [
    row
    for path in sorted(HERE.glob("rows_*.py"))
    for row in importlib.import_module(f"tests.bad_input.{path.stem}").ROWS
]
#: Characters of what came that an answer may repeat in one piece, with what stands around them in both.
ECHOED = 90
#: A shorter word may be the path of a file, which is shown whole.
NAMES = 400
#: Bounds on one answer: characters of standard error, seconds, bytes.
LONGEST, LATEST, LARGEST = 2000, 10, 1 << 30


#: Of so many rows of one family one stands in the fast suite, where the family has more than the number below.
SHARE, FEW = 3, 20
FAMILIES = Counter(row.command for row in ROWS)


def fast(row):
    """Return whether a row stands in the fast suite: a fixed third of large families, and all of small ones."""
    return not row.slow and (FAMILIES[row.command] <= FEW or crc32(row.name.encode()) % SHARE == 0)


def parameter(row):
    marks = [] if fast(row) else [pytest.mark.slow]
    return pytest.param(row, id=row.name, marks=marks)


@pytest.mark.parametrize("row", [parameter(row) for row in ROWS])
def test_bad_input_is_refused_in_one_message(row, tmp_path, monkeypatch, capfd):
    folder = tmp_path / "work"
    folder.mkdir()
    row.make_files(folder)
    before = fingerprint(folder)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(folder)
    done = run_apart(row.words, folder) if row.own_process else run_here(row.words, monkeypatch, capfd)
    assert done.status == row.status, f"{done.status}: {done.err[-2000:]}"
    if row.status == 2:
        told = the_message(done.err)
    else:
        told = " ".join((done.out + done.err).split())
        assert "Traceback" not in told
    assert_says_all(done.err)
    assert len(done.err) <= LONGEST, f"{len(done.err)} characters"
    assert_echoes_little(told, row)
    assert row.prints or done.out == ""
    for words in row.expected:
        assert " ".join(words.split()) in told, told
    assert_points_at_its_key(told, folder / CONFIG)
    assert fingerprint(folder) == before
    assert done.seconds < LATEST
    assert done.memory < LARGEST, f"{done.memory / 1e9:.2f} GB"


def the_message(err: str) -> str:
    """The one message, whether of porocore or of the parser of command lines; without line breaks and boxes."""
    assert "Traceback" not in err, err[-2000:]
    text = " ".join(re.sub("[│╭╮╰╯─]+", " ", err).split())
    if "Usage: porocore" in text:
        return text
    notes, found, told = text.rpartition("error: ")
    assert found, err
    assert "error: " not in notes, err
    assert told
    return told


def assert_echoes_little(told, row):
    """No more than some 80 characters in one piece come from the words or from a text file of the row."""
    given = [*row.words, *(content for content in row.files.values() if isinstance(content, str))]
    given = [" ".join(text.split()) for text in given if len(text) > NAMES]
    for i in range(len(told) - ECHOED):
        assert not any(told[i : i + ECHOED + 1] in text for text in given), told


def assert_points_at_its_key(told, config):
    """Each line of the configuration that is named holds a part of the key that is named behind it."""
    for number, key in re.findall(rf"{CONFIG}:(\d+): ([\w.+-]+): ", told):
        source = config.read_text(encoding="utf-8").splitlines()[int(number) - 1]
        entry = any(part.isdigit() for part in key.split(".")[-2:]) and source.lstrip().startswith("- ")
        source = source.replace("'", "")
        assert entry or any(f"{part}:" in source for part in key.split(".")), f"{key}: {number} is {source!r}"


def test_the_names_tell_the_rows_apart():
    assert [name for name, count in Counter(row.name for row in ROWS).items() if count > 1] == []


def test_every_command_has_rows():
    assert {row.command for row in ROWS} >= commands()
    in_the_fast_suite = [row for row in ROWS if fast(row)]
    assert {row.command for row in in_the_fast_suite} >= commands()
    assert len(in_the_fast_suite) >= 300
