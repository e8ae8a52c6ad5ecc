"""Claim of a folder: what it may hold, who may hold it, and that a refusal leaves it as it was."""

from __future__ import annotations

import os

import pytest

from porocore.core.files.claim import LOCK, claim_folder, lock_folder
from porocore.errors import RunFolderError

RECORD = "work.json"


class Lock:
    """Lock of a folder as a context manager."""

    def __init__(self, path):
        self.path = path

    def __enter__(self):
        self.held = lock_folder(self.path)

    def __exit__(self, *_):
        os.close(self.held)


def claim(path, mine="mine", *, resume=False, lock=None, **how):
    def check():
        if (path / RECORD).read_text() != mine:
            raise RunFolderError("other work")

    def begin():
        (path / RECORD).write_text(mine)

    claim_folder(
        path, RECORD, "work", resume=resume, lock=lock or Lock(path), begin=begin, check=check, **how
    )


def test_a_folder_is_made_and_opened_again_by_the_same_work_alone(tmp_path):
    path = tmp_path / "a" / "b"
    claim(path)
    assert (path / RECORD).read_text() == "mine"
    with pytest.raises(RunFolderError, match="b already holds this work; add --resume to continue it"):
        claim(path)
    claim(path, resume=True)
    for resume in (False, True):
        with pytest.raises(RunFolderError, match="other work"):
            claim(path, "yours", resume=resume)
    assert (path / RECORD).read_text() == "mine"


def test_files_of_others_are_named_and_left(tmp_path):
    for name in "abcdef":
        (tmp_path / name).touch()
    with pytest.raises(RunFolderError, match=r"holds no work of porocore \(found a, b, c, d and 2 more\)"):
        claim(tmp_path)
    assert {entry.name for entry in tmp_path.iterdir()} == set("abcdef")


def test_what_a_start_that_died_has_left_is_no_hindrance(tmp_path):
    for name in (LOCK, f".{RECORD}.4711.part", "first.yaml"):
        (tmp_path / name).touch()
    with pytest.raises(RunFolderError, match=r"\(found first.yaml\)"):
        claim(tmp_path)
    claim(tmp_path, left_by_a_start=lambda name: name == "first.yaml")


def test_a_record_that_another_process_writes_meanwhile_is_seen(tmp_path):
    class Late(Lock):
        def __enter__(self):
            super().__enter__()
            (tmp_path / RECORD).write_text("yours")

    with pytest.raises(RunFolderError, match="other work"):
        claim(tmp_path, lock=Late(tmp_path))
    assert (tmp_path / RECORD).read_text() == "yours"


def test_a_folder_in_work_names_its_process(tmp_path):
    with Lock(tmp_path), pytest.raises(RunFolderError, match=rf"\(process {os.getpid()}\) is working in"):
        claim(tmp_path)


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RunFolderError, match="expected a folder, got a file"):
        claim(tmp_path / "file")
    with pytest.raises(RunFolderError, match="file is a file, not a folder; choose another --out"):
        claim(tmp_path / "file" / "below")
