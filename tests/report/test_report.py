"""The report page: what is in it, that it stands alone, and that nothing in it can be executed."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.files.atomic import file_stem
from porocore.core.parallel.calls import CallProcesses
from porocore.errors import RunFolderError
from porocore.report.context import LoadingMode
from porocore.report.figures.style import named, new_figure, svg_bytes
from porocore.report.html import render, write_report
from porocore.report.metrics import LoadCase
from porocore.report.page import Pictures
from tests.helpers.report_page import ODD, Page


def test_stands_alone_and_runs_nothing(html, page):
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "link", "iframe", "object", "embed", "base"})
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), f"{tag} has a handler {name}"
            if name in {"src", "href", "srcset", "action", "style"}:
                assert value is not None
                assert value.startswith(("data:image/", "#")), f"{tag} refers to {value[:60]}"
    css = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in css
    assert "@import" not in css
    targets = {a["href"] for a in page.all("a")}
    assert targets == {f"#{section['id']}" for section in page.all("section")}


def test_has_all_sections(page):
    sections = [section["id"] for section in page.all("section")]
    assert sections == ["summary", "cell", "sampling", "surrogate", "macro", "times", "provenance", "cite"]


def test_figures_are_whole_images_with_a_text(page):
    images = page.all("img")
    # the cell, the samples, one output, the training, two histories and seven profiles
    assert len(images) == 1 + 1 + 1 + 1 + 2 + 7
    for image in images:
        assert image["alt"]
        kind, data = image["src"].split(";base64,")
        decoded = base64.b64decode(data, validate=True)
        if kind == "data:image/png":
            assert decoded.startswith(b"\x89PNG")
        else:
            assert kind == "data:image/svg+xml"
            assert ET.fromstring(decoded).tag.endswith("svg")
    assert len({image["alt"] for image in images}) == len(images)


def test_text_of_the_user_is_shown_and_not_interpreted(page):
    for text in (ODD, "60 states <i>", "seed <1>", "cell: <radius> & {0.25}", "Handed in <first> & shown"):
        assert text in page.words


@pytest.mark.usefixtures("undrawn")
def test_is_the_same_bytes_again(context):
    """The page; that each figure is, too, is tested in test_report_figures."""
    assert render(context) == render(context)


def test_written_whole_or_not_at_all(context, html, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("the old one")
    monkeypatch.setattr("porocore.report.html.render", lambda *arguments: html)
    with monkeypatch.context() as patch:
        patch.setattr("porocore.core.files.atomic.os.replace", disk_full)
        with pytest.raises(RunFolderError, match=r"cannot write .*report\.html"):
            write_report(path, context)
    assert path.read_text() == "the old one"
    write_report(path, context)
    assert path.read_text(encoding="utf-8") == html
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture
def block(context, column):
    """A report on a block that is pushed, whose fields are drawn on its surface."""
    solution = column(elements=(2, 2, 1))
    pushed = replace(solution, reactions={"y+": np.outer(solution.history.time, [0, -1, 0])})
    mode = LoadingMode(displaced=("y+",))
    return replace(context, cases=(LoadCase(pushed, None),), loading_mode=mode, published=None)


def test_figures_drawn_in_processes_are_the_same_bytes(context, html, block, tmp_path):
    with CallProcesses(2) as processes:
        for i, (each, alone) in enumerate([(context, html), (block, render(block))]):
            folder, told = tmp_path / str(i), []
            assert render(each, Pictures(folder, told.append, processes)) == alone
            assert {path.stem for path in folder.glob("*.svg")} == {
                path.stem for path in folder.glob("*.png")
            }
            assert len(told) == len(list(folder.glob("*.svg")))
        assert any(name.startswith("body") for name in told)


@pytest.mark.usefixtures("undrawn")
def test_every_figure_of_the_page_is_a_file_too(context, tmp_path):
    write_report(tmp_path / "report.html", context, tmp_path / "figures")
    images = Page((tmp_path / "report.html").read_text(encoding="utf-8")).all("img")
    by_ending = {
        ending: {path.stem for path in (tmp_path / "figures").glob(f"*.{ending}")}
        for ending in ("png", "svg")
    }
    assert by_ending["png"] == by_ending["svg"]
    assert len(by_ending["png"]) == len(images)
    assert {"cell", "samples", "history_load-0.2", "history_log_load-0.2", "profile_p_load-0.2"} <= by_ending[
        "png"
    ]
    assert len(list((tmp_path / "figures").iterdir())) == 2 * len(images)


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("potential_predicted_K₁₁", "potential_predicted_K11"),
        ("fluid volume φ", "fluid-volume"),
        ("body_t=0.2_load-1.0", "body_t=0.2_load-1.0"),
        ("../a b/c", "..-a-b-c"),
    ],
)
def test_names_of_figures_are_names_of_files(name, stem):
    assert file_stem(name) == stem


def test_figures_of_different_names_have_different_files():
    pictures = Pictures()
    stems = [pictures._stem(name) for name in ("fit_中", "fit_水", "fit_a/b", "fit_a b", "fit_A b", "fit_中")]
    assert len({stem.lower() for stem in stems}) == 5
    assert stems[0] == stems[-1] == "fit_"
    assert stems[2] == "fit_a-b"


@pytest.mark.parametrize("name", ["$\\x$", "cost $5 and $6", "_hidden", "a\\frac{b", "中", "$"])
def test_a_name_is_drawn_as_it_is(name, recwarn):
    figure = new_figure(2, 2)
    axes = figure.add_subplot()
    axes.plot([0, 1], label=f"{named(name)} $u_1$")
    axes.set_xlabel(named(name))
    (text,) = axes.legend().get_texts()
    assert name in text.get_text().replace(r"\$", "$")
    svg_bytes(figure)
    assert not recwarn.list


def disk_full(*_):
    raise OSError(28, "No space left on device")


def test_pyplot_is_not_used():
    script = (
        "import sys, json, matplotlib; before = dict(matplotlib.rcParams)\n"
        "from porocore.report import figures, html\n"
        "import numpy as np; from porocore.report.context import TrainingCurve\n"
        "e = np.arange(1.0, 9); figures.svg_bytes(figures.training_figure(TrainingCurve(e, 1 / e, 2 / e)))\n"
        "print(json.dumps(['matplotlib.pyplot' in sys.modules, dict(matplotlib.rcParams) == before]))"
    )
    # With a backend named, reading the settings does not itself import pyplot to choose one.
    ran = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert json.loads(ran.stdout) == [False, True]
