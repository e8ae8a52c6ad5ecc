"""Lock files: one holder, named to the others; no link is followed, and a killed holder leaves nothing held."""

import os
import subprocess
import sys

import pytest

from porocore.core.files import claim as lock_module
from porocore.core.files.claim import Locked, take_lock
from tests.helpers.platform_parts import POSIX

HOLD = """
import sys
from pathlib import Path
from porocore.core.files.claim import take_lock
take_lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path / "lock"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_the_holder_is_named_and_its_end_releases_the_lock(tmp_path, holder):
    with pytest.raises(Locked) as refused:
        take_lock(tmp_path / "lock")
    assert refused.value.holder == str(holder.pid)
    holder.kill()
    holder.wait()
    os.close(take_lock(tmp_path / "lock"))
    assert (tmp_path / "lock").read_text().strip() == str(os.getpid())


def test_closing_releases_it(tmp_path):
    held = take_lock(tmp_path / "lock")
    with pytest.raises(Locked):
        take_lock(tmp_path / "lock")
    os.close(held)
    os.close(take_lock(tmp_path / "lock"))


@POSIX
def test_a_lock_whose_file_was_removed_guards_nothing(tmp_path, holder):
    """Its holder ends: whoever comes next makes a new file."""
    (tmp_path / "lock").unlink()
    os.close(take_lock(tmp_path / "lock"))


@POSIX
@pytest.mark.parametrize("flag", [True, False], ids=["flag", "no flag, as on Windows"])
@pytest.mark.parametrize("target", ["mine", "nothing"])
def test_a_link_is_not_followed(tmp_path, monkeypatch, flag, target):
    if not flag:
        monkeypatch.setattr(lock_module, "_FLAGS", lock_module._FLAGS & ~os.O_NOFOLLOW)
        monkeypatch.setattr(lock_module, "_NO_LINK", 0)
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "lock").symlink_to(target)
    with pytest.raises(OSError, match="its lock lock is a symbolic link; remove that"):
        take_lock(tmp_path / "lock")
    assert (tmp_path / "mine").read_text() == "mine"
    assert not (tmp_path / "nothing").exists()


@POSIX
def test_what_is_no_ordinary_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "lock")
    with pytest.raises(OSError, match="its lock lock is no ordinary file; remove that"):
        take_lock(tmp_path / "lock")


def test_descriptors_are_not_left_open(tmp_path):
    held = take_lock(tmp_path / "lock")
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(Locked):
        take_lock(tmp_path / "lock")
    assert len(os.listdir("/proc/self/fd")) == before
    os.close(held)
