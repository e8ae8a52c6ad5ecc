"""A finished run that is resumed: it is recognised by its files, and another title is only written in."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from porocore.report.page import retitled
from porocore.study.run.folder import FinishedRun

RUN = FinishedRun("A & B", "A & B", "title: A & B\n", ("mind the gap",))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("solutions", "figures"):
        (tmp_path / name).mkdir()
    for name in ("samples.h5", "solutions/linear.h5", "figures/settlement.svg", ".lock"):
        (tmp_path / name).write_text("what was found")
    RUN.keep(tmp_path)
    return tmp_path


def test_a_folder_that_nobody_touched_is_finished(folder: Path) -> None:
    (folder / ".lock").write_text("of another process")
    (folder / "sweep" / "radius=0.2").mkdir(parents=True)
    for name in ("sweep.csv", "sweep/radius=0.2/linear.h5"):
        (folder / name).write_text("of a sweep")
    assert FinishedRun.find(folder) == RUN
    replace(RUN, title="C").keep(folder)
    found = FinishedRun.find(folder)
    assert found is not None
    assert found.title == "C"


def _changed(folder: Path) -> None:
    path = folder / "solutions" / "linear.h5"
    before = path.stat()
    path.write_text("what was FOUND")
    # As a copy or a disk may leave it: the same size, another time.
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))


def _removed(folder: Path) -> None:
    (folder / "samples.h5").unlink()


def _without_figures(folder: Path) -> None:
    shutil.rmtree(folder / "figures")


def _added(folder: Path) -> None:
    (folder / "solutions" / "potential.h5").write_text("more")


def _damaged(folder: Path) -> None:
    (folder / "finished.json").write_text('{"files": {}}')


def _truncated(folder: Path) -> None:
    path = folder / "finished.json"
    path.write_text(path.read_text()[:-9])


def _of_another_version(folder: Path) -> None:
    path = folder / "finished.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"porocore": "0.0.1"}))


@pytest.mark.parametrize(
    "change", [_changed, _removed, _without_figures, _added, _damaged, _truncated, _of_another_version]
)
def test_a_folder_that_was_changed_is_not(folder: Path, change: Callable[[Path], None]) -> None:
    change(folder)
    assert FinishedRun.find(folder) is None


PAGE = "<title>A &amp; B – porocore report</title><h1>A &amp; B</h1><p>A &amp; B</p><pre>title: A &amp; B\n</pre>"


def test_a_page_gets_another_title() -> None:
    new = retitled(PAGE, ("A & B", "<C>"), ("title: A & B\n", "title: <C>\n"))
    assert new == (
        "<title>&lt;C&gt; – porocore report</title><h1>&lt;C&gt;</h1><p>A &amp; B</p><pre>title: &lt;C&gt;\n</pre>"
    )


@pytest.mark.parametrize("page", ["", PAGE + PAGE, PAGE.replace("<h1>A", "<h1>a")])
def test_a_page_of_another_form_is_left_alone(page: str) -> None:
    assert retitled(page, ("A & B", "C"), ("title: A & B\n", "title: C\n")) is None
