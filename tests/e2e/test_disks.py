"""A disk that is read-only or full: one message, nothing lost, and the run goes on once there is room.

The disks are mounted in a namespace of their own, so nothing of them outlives the command.
"""

from __future__ import annotations

import subprocess

import pytest

from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.study import ENVIRONMENT, POROCORE, contents, fingerprint, message, seconds, write_study


def namespace(script, *words):
    """Run a shell script with words $1, $2, … where it may mount; the command is in $POROCORE."""
    return subprocess.run(
        ["unshare", "--user", "--map-root-user", "--mount", "sh", "-euc", script, "sh", *map(str, words)],
        env=ENVIRONMENT | {"POROCORE": str(POROCORE)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture(scope="module", autouse=True)
def _may_mount(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mount")
    try:
        tried = namespace('mount -t tmpfs -o size=64k tmpfs "$1"', folder)
    except FileNotFoundError:
        pytest.skip("there is no 'unshare' here to mount a small disk with")
    if tried.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {tried.stderr.strip()}")


READ_ONLY = 'mount --bind "$1" "$1"; mount -o remount,bind,ro "$1"; shift; exec "$POROCORE" "$@"'


def test_a_read_only_folder(study, finished, a_copy, tmp_path):
    run = a_copy("report.html")
    before = fingerprint(run)
    for words, expected in (
        (["run", study, "--out", run, "--resume"], "Read-only file system"),
        (["run", study, "--out", run / "below"], "whose files belong to its run"),
        (["sample", run], "Read-only file system"),
        (["report", run], "Read-only file system"),
    ):
        refused = message(namespace(READ_ONLY, run, *words))
        assert str(run) in refused
        assert expected in refused
    assert fingerprint(run) == before
    # What writes nothing works there.
    done = namespace(READ_ONLY, run, "train", "--help")
    assert done.returncode == 0


@pytest.mark.parametrize(
    "workers",
    [
        (),
        pytest.param(("--executor", "processes"), marks=pytest.mark.slow),
        pytest.param(("--executor", "dask"), marks=pytest.mark.slow),
    ],
    ids=["serial", "processes", "dask"],
)
def test_a_disk_that_fills_while_sampling(finished, tmp_path, workers):
    """Finished states are kept, and with more room sampling goes on to the same dataset."""
    config = write_study(tmp_path / "study.yaml", {"sampling.workers": 2} if workers else None)
    disk, kept, ended = tmp_path / "disk", tmp_path / "kept", tmp_path / "ended"
    disk.mkdir()
    done = namespace(
        """
        mount -t tmpfs -o size=400k tmpfs "$2"
        config=$1 disk=$2 kept=$3 ended=$4; shift 4
        status=0; "$POROCORE" sample "$config" --out "$disk/run" "$@" || status=$?
        cp -r "$disk/run" "$kept"
        mount -o remount,size=20m "$disk"
        "$POROCORE" sample "$disk/run" "$@" >/dev/null 2>&1
        cp -r "$disk/run" "$ended"
        exit $status
        """,
        config,
        disk,
        kept,
        ended,
        *workers,
    )
    refused = message(done)
    assert "No space left on device; make room" in refused
    solved = seconds(kept)
    assert 3 <= len(solved) < len(Dataset.open(finished / "samples.h5"))
    assert solved.items() <= seconds(ended).items()
    assert not list(kept.rglob("*.part"))
    assert Dataset.open(ended / "samples.h5").digest() == Dataset.open(finished / "samples.h5").digest()


@pytest.mark.parametrize(
    ("step", "without", "room"),
    [
        pytest.param("train", ("surrogate.h5", "training.csv"), 8, marks=pytest.mark.slow),
        ("solve", ("solutions",), 72),
        pytest.param("report", ("report.html", "fields"), 40, marks=pytest.mark.slow),
    ],
)
def test_a_disk_that_fills_later(finished, a_copy, tmp_path, step, without, room):
    """The stage before is untouched; nothing half-written stays."""
    run = a_copy(*without)
    disk, after = tmp_path / "disk", tmp_path / "after"
    disk.mkdir()
    done = namespace(
        """
        mount -t tmpfs -o size=20m tmpfs "$2"
        cp -r "$1" "$2/run"
        dd if=/dev/zero of="$2/fill" bs=1k 2>/dev/null || true
        truncate -s "-$4k" "$2/fill"
        status=0; "$POROCORE" "$5" "$2/run" || status=$?
        rm "$2/fill"
        cp -r "$2/run" "$3"
        exit $status
        """,
        run,
        disk,
        after,
        room,
        step,
    )
    refused = message(done)
    assert "No space left on device; make room" in refused
    assert f"{disk}/run/" in refused
    left = fingerprint(after)
    assert fingerprint(run).items() <= left.items()
    assert not [name for name in left if name.endswith(".part")]
    for name in left.keys() - fingerprint(run).keys():
        if name.startswith("solutions/"):
            assert contents(after / name) == contents(finished / name)
