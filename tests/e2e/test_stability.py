"""``porocore stability`` from outside: a small map, its files, and going on after a stop."""

import csv
import shutil

import h5py
import numpy as np
import pytest

from porocore.cell.stability.map import EVENTS, load
from tests.e2e.study import porocore, succeeded, write_study

PLAN = ("--along", "H22=-0.3", "--across", "p=0,0.1", "--steps", "5", "--tolerance", "0.02")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    changes = {"cell.mesh": {"size": 0.25, "fluid_size": 0.2, "element": "linear"}}
    return write_study(tmp_path_factory.mktemp("stability") / "study.yaml", changes)


@pytest.fixture(scope="module")
def mapped(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("mapped") / "map"
    done = porocore("stability", study, *PLAN, "--out", out)
    lines = succeeded(done).splitlines()
    assert lines[-1] == str(out / "stability.png")
    return out, lines


def test_the_onset_of_period_two_comes_before_that_of_one_and_later_under_pressure(mapped):
    out, _ = mapped
    lines = load(out / "stability.h5")
    assert [line.start[9] for line in lines] == [0.0, 0.1]
    onsets = [line.onset("110", "101", "011")[4] for line in lines]
    assert -0.3 < onsets[1] < onsets[0] < -0.2
    for line in lines:
        low, high = line.onsets[EVENTS.index("110")] * -0.3
        assert 0 < low - high <= 0.02 + 1e-12
        before, after = line.share * -0.3 >= low, line.share * -0.3 <= high
        assert (line.pivots[before] == 0).all()
        assert (line.pivots[after].sum(axis=1) > 0).all()
        assert np.isnan(line.onset("000")).all()
        assert line.acoustic[0] > line.acoustic[-1]


def test_the_tables_say_the_same_as_the_file(mapped):
    out, _ = mapped
    lines = load(out / "stability.h5")
    with open(out / "states.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(map(len, lines))
    first = rows[: len(lines[0])]
    np.testing.assert_allclose([float(row["H22"]) for row in first], lines[0].states()[:, 4], atol=1e-7)
    np.testing.assert_allclose([float(row["acoustic"]) for row in first], lines[0].acoustic, rtol=1e-6)
    assert [int(row["negative_pivots_110"]) for row in first] == list(lines[0].pivots[:, 6])
    with open(out / "onsets.csv", encoding="utf-8") as file:
        onsets = list(csv.DictReader(file))
    between = float(onsets[0]["H22_110_from"]), float(onsets[0]["H22_110_to"])
    assert sum(between) / 2 == pytest.approx(lines[0].onset("110")[4], abs=1e-7)
    with h5py.File(out / "stability.h5") as file:
        assert "radius: 0.25" in file.attrs["config"]
    assert (out / "stability.png").read_bytes().startswith(b"\x89PNG")


def test_finished_lines_are_kept(mapped, study, tmp_path):
    """A map stopped behind its first line ends as the undisturbed one, and solves no state of that line again."""
    out, _ = mapped
    stopped = tmp_path / "map"
    shutil.copytree(out, stopped)
    with h5py.File(stopped / "stability.h5", "a") as file:
        del file["lines/1"]
    again = porocore("stability", study, *PLAN, "--out", stopped)
    assert again.returncode == 2
    assert "--resume" in again.stderr
    done = porocore("stability", study, *PLAN, "--out", stopped, "--resume")
    succeeded(done)
    assert (stopped / "states.csv").read_bytes() == (out / "states.csv").read_bytes()
    assert (stopped / "onsets.csv").read_bytes() == (out / "onsets.csv").read_bytes()


def test_another_plan_does_not_go_on(mapped, study):
    out, _ = mapped
    done = porocore("stability", study, "--across", "p=0,0.2", "--out", out, "--resume")
    assert done.returncode == 2
    assert "another cell, backend or plan" in done.stderr


def test_one_line_shows_its_states_and_eigenvalues(study, tmp_path):
    words = ("--along", "H22=-0.1", "--across", "p=0", "--steps", "1", "--eigenvalues")
    text = succeeded(porocore("stability", study, *words, "--out", tmp_path / "line"))
    assert text.splitlines()[0].split()[:3] == ["H22", "status", "contact"]
    (line,) = load(tmp_path / "line" / "stability.h5")
    assert (line.eigenvalues > 0).all()
    assert (np.diff(line.eigenvalues, axis=0) < 0).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--along", "H12=0.1"), "unknown input 'H12'"),
        (("--along", "H22"), "expected goals of inputs such as H22=-0.36"),
        (("--along", "H22=0"), "go nowhere"),
        (("--across", "p=0,x"), "expected an input and its values such as p=0,0.1"),
        (("--across", "H22=0.1"), "runs both along the lines and across them"),
        (("--across", "p=0.1,0.1"), "expected different values of p"),
        (("--steps", "0"), "--steps: expected 1 to 10000"),
        (("--tolerance", "-1"), "--tolerance: expected at least 1e-09"),
    ],
    ids=str,
)
def test_what_is_refused(study, tmp_path, words, message):
    done = porocore("stability", study, *words, "--out", tmp_path / "map")
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "map").exists()


def test_a_cell_without_mirror_planes_is_refused(tmp_path):
    config = write_study(tmp_path / "study.yaml", {"cell.symmetry": "none"})
    done = porocore("stability", config, *PLAN, "--out", tmp_path / "map")
    assert done.returncode == 2
    assert "cell.symmetry" in done.stderr
