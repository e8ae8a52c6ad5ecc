"""The store of results: it gives back what was put in, or nothing; never anything else."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from porocore.core.files.store import ResultStore

KEY = "ab" + 38 * "0"


def put(store: ResultStore, number: int, size: int = 1000) -> str:
    key = f"{number:02x}" + 38 * "0"
    store.keep("states", key, bytes(size), {"seconds": float(number)})
    return key


def test_the_store_returns_what_it_was_given(tmp_path):
    store = ResultStore(tmp_path / "store")
    assert store.find("states", KEY) is None
    store.keep("states", KEY, b"\x00\n\xff", {"seconds": 0.25})
    found = ResultStore(tmp_path / "store").find("states", KEY)
    assert found is not None
    assert (found.payload, found.facts) == (b"\x00\n\xff", {"seconds": 0.25})
    assert store.find("cells", KEY) is None


@pytest.mark.parametrize("where", [0, 3, 40, 90, -1])
def test_a_changed_byte_is_noticed_and_the_file_removed(tmp_path, where):
    store = ResultStore(tmp_path)
    store.keep("states", KEY, 50 * b"x", {})
    (file,) = store.files()
    data = bytearray(file.path.read_bytes())
    data[where] ^= 1
    file.path.write_bytes(data)
    assert store.find("states", KEY) is None
    assert not file.path.exists()


def test_check_removes_damaged_files_alone(tmp_path):
    store = ResultStore(tmp_path)
    put(store, 1)
    put(store, 2)
    damaged = store.files()[0]
    os.truncate(damaged.path, 100)
    assert [file.path for file in store.check()] == [damaged.path]
    assert len(store.files()) == 1
    assert not store.check()


def test_its_size_is_bounded_and_what_was_used_last_stays(tmp_path):
    store = ResultStore(tmp_path, most_bytes=10_000)
    keys = []
    for number in range(8):
        keys.append(put(store, number))
        path = next(file.path for file in store.files() if file.path.name == keys[-1])
        os.utime(path, (1000 + number, 1000 + number))
    assert store.find("states", keys[0])  # used now
    for number in range(8, 12):
        keys.append(put(store, number))
    names = {file.path.name for file in store.files()}
    assert sum(file.bytes for file in store.files()) <= 10_000
    assert keys[0] in names
    assert keys[-1] in names
    assert keys[1] not in names


def test_one_that_cannot_be_written_is_left_alone(tmp_path):
    (tmp_path / "store").write_text("no folder")
    store = ResultStore(tmp_path / "store")
    put(store, 1)
    assert str(tmp_path / "store") in store.fault
    assert store.find("states", KEY) is None
    assert store.files() == []


def test_clear_removes_all_or_what_was_not_used(tmp_path):
    store = ResultStore(tmp_path)
    old, new = put(store, 1), put(store, 2)
    path = next(file.path for file in store.files() if file.path.name == old)
    os.utime(path, (time.time() - 100, time.time() - 100))
    assert [file.path.name for file in store.clear(unused_since=50)] == [old]
    assert [file.path.name for file in store.clear()] == [new]
    assert store.files() == []


def test_files_of_others_in_its_folder_are_left_alone(tmp_path):
    store = ResultStore(tmp_path)
    put(store, 1)
    letters = tmp_path / "letters" / "to" / "mother.txt"
    letters.parent.mkdir(parents=True)
    letters.write_text("Dear mother")
    assert len(store.files()) == 1
    assert store.check() == []
    store.clear()
    assert letters.read_text() == "Dear mother"


WRITER = """
import sys
from pathlib import Path
from porocore.core.files.store import ResultStore
store = ResultStore(Path(sys.argv[1]), most_bytes=60_000)
while True:
    for number in range(64):
        key = f"{number:02x}" + 38 * "0"
        found = store.find("states", key)
        assert found is None or (found.payload == 2000 * bytes([number]) and found.facts == {"n": number})
        store.keep("states", key, 2000 * bytes([number]), {"n": number})
    print("round", flush=True)
"""


def test_several_processes_write_and_are_killed(tmp_path):
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, tmp_path], stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    try:
        for writer in writers:
            assert writer.stdout.readline() == "round\n"
    finally:
        for writer in writers:
            writer.kill()
            assert writer.wait() == -9
    store = ResultStore(tmp_path)
    assert store.files()
    for file in store.files():
        found = store.find("states", file.path.name)
        assert found is not None
        assert found.payload == 2000 * bytes([found.facts["n"]])
