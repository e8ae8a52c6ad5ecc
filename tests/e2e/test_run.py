"""A whole run ends well and leaves everything that it should; so do its steps, with the same numbers."""

import html
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from porocore.interfaces.solution import MacroSolution
from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.study import (
    HELD_OUT,
    LOADS,
    ONE_LOAD,
    assert_same_results,
    assert_tidy,
    figures,
    fingerprint,
    porocore,
    succeeded,
    write_study,
)

NAMES = {f"{law}_load{load!r}" for law in ("mean-gradient", "linear") for load in LOADS}


def test_a_run_leaves_every_file(finished):
    present = {path.name for path in finished.iterdir()}
    assert present == {
        ".lock",
        "cell.json",
        "checkpoints",
        "config.yaml",
        "fields",
        "figures",
        "finished.json",
        "histories",
        "metrics.json",
        "report.html",
        "run.json",
        "samples.h5",
        "solutions",
        "surrogate.h5",
        "test.h5",
        "timings.json",
        "training.csv",
    }
    assert_tidy(finished)
    config = yaml.safe_load((finished / "config.yaml").read_text(encoding="utf-8"))
    assert config["macro"]["newton"] == {"tolerance": 1e-9, "iterations": 25}  # defaults are spelt out
    record = json.loads((finished / "run.json").read_text(encoding="utf-8"))
    assert {"porocore", "porocore-fem-skfem", "porocore-surrogate-torch", "numpy", "torch"} <= set(
        record["versions"]
    )
    reference = CellReference.load(finished / "cell.json", record["stages"]["cell"])
    assert reference.conductivity.shape == (3, 3)
    assert len(Dataset.open(finished / "samples.h5")) >= 18
    assert len(Dataset.open(finished / "test.h5")) == HELD_OUT


def test_the_solutions_can_be_looked_at(finished):
    assert {path.stem for path in (finished / "solutions").iterdir()} == NAMES
    series = {path.stem: path for path in (finished / "fields").glob("*.pvd")}
    assert set(series) == NAMES
    shown = set()
    for name, path in series.items():
        solution = MacroSolution.load_file(finished / "solutions" / f"{name}.h5")
        entries = list(ElementTree.parse(path).iter("DataSet"))
        assert [float(entry.attrib["timestep"]) for entry in entries] == [0, 1, 10, 40, 240]
        assert [profile.time for profile in solution.profiles] == [0, 1, 10, 40, 240]
        for entry in entries:
            shown.add(entry.attrib["file"])
            piece = next(ElementTree.parse(finished / "fields" / entry.attrib["file"]).iter("Piece"))
            assert int(piece.attrib["NumberOfPoints"]) == len(solution.points)
            assert int(piece.attrib["NumberOfCells"]) == 8
    assert shown == {path.name for path in (finished / "fields").glob("*.vtu")}


def test_the_metrics_hold_figures_of_merit_and_times(finished):
    metrics = json.loads((finished / "metrics.json").read_text(encoding="utf-8"))
    parts = {"cell", "sampling", "surrogate", "closure", "macro", "linear_systems", "stages", "stage_runs"}
    assert set(metrics) == {*parts, "warnings"}
    told = json.loads((finished / "finished.json").read_text(encoding="utf-8"))["warnings"]
    assert metrics["warnings"] == told
    for each in metrics["linear_systems"]:
        assert "are solved for by a direct factor" in each["solver"]
        assert each["systems"] >= each["set_ups"] > 0
        assert each["iterations"] == each["most_iterations"] == 0
        assert each["step_seconds"] > 0
    assert metrics["stage_runs"] == dict.fromkeys(metrics["stages"], 1)
    stages = {"cell", "sampling", "held-out states", "training", "report"}
    stages |= {f"macro, {law}, load {load:g}" for law in ("mean-gradient", "linear") for load in LOADS}
    assert set(metrics["stages"]) == stages
    assert all(seconds > 0 for seconds in metrics["stages"].values())
    assert metrics["sampling"]["states"] == sum(metrics["sampling"]["statuses"].values())
    assert metrics["sampling"]["held_out_states"] == metrics["surrogate"]["test_states"] == HELD_OUT


def test_the_report_is_one_self_contained_page(finished):
    page = (finished / "report.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "A small study" in page
    assert page.count("<svg") + page.count("data:image") >= 10
    linked = re.findall(
        r"""<(?:script|link|img|iframe|object|source)\b[^>]*?(?:src|href|data)=["']([^"']*)""", page
    )
    assert [target for target in linked if not target.startswith(("data:", "#"))] == []
    assert not re.findall(r"""@import|url\(["']?(?!data:|#|["'])""", page)


@pytest.mark.slow
def test_the_steps_give_the_numbers_of_the_run(finished, tmp_path):
    config = write_study(tmp_path / "study.yaml", ONE_LOAD)
    out = tmp_path / "steps"
    assert succeeded(porocore("sample", config, "--out", out)) == str(out / "samples.h5")
    assert succeeded(porocore("train", out)) == str(out / "surrogate.h5")
    solutions = succeeded(porocore("solve", out)).splitlines()
    assert [Path(path).name for path in solutions] == ["mean-gradient_load-0.04.h5", "linear_load-0.04.h5"]
    assert_same_results(out, finished)
    assert_tidy(out)


@pytest.mark.slow
def test_the_last_step_gives_the_figures_and_pages_of_the_run(a_copy, finished):
    run = a_copy("report.html", "metrics.json", "fields")
    assert succeeded(porocore("report", run)) == str(run / "report.html")
    assert figures(run) == figures(finished)
    left, expected = fingerprint(run), fingerprint(finished)
    assert left.keys() == expected.keys()
    assert {name for name in left if left[name] != expected[name]} <= {"metrics.json", "report.html"}


@pytest.mark.slow
def test_the_figures_of_a_run_are_drawn(a_copy, finished):
    """Elsewhere here they are left empty; tests/report draws them of made-up solutions."""
    run = a_copy("report.html", "metrics.json", "figures")
    succeeded(porocore("report", run, drawn=True))
    empty = {path.name: path.stat().st_size for path in (finished / "figures").iterdir()}
    drawn = {path.name: path.stat().st_size for path in (run / "figures").iterdir()}
    assert drawn.keys() == empty.keys()
    assert all(drawn[name] > empty[name] for name in empty)


def test_a_finished_run_is_resumed_without_work(a_copy, study, tmp_path):
    run = a_copy()
    before, times = fingerprint(run), (run / "timings.json").read_bytes()
    done = porocore("run", study, "--out", run, "--resume")
    assert succeeded(done) == str(run / "report.html")
    assert done.stderr.splitlines()[-1].startswith("the run is finished; ")
    assert "took" not in done.stderr
    assert fingerprint(run) == before
    # Another title is written into the page, and nothing else is done; nor with the next.
    page = (run / "report.html").read_text(encoding="utf-8")
    for title in ("Another & better", "A small study"):
        named = write_study(tmp_path / "named.yaml", {"title": title})
        done = porocore("run", named, "--out", run, "--resume")
        assert "the run is finished; " in succeeded(done) + done.stderr
        now = (run / "report.html").read_text(encoding="utf-8")
        assert f"<h1>{html.escape(title)}</h1>" in now
        changed = {name for name, digest in fingerprint(run).items() if before[name] != digest}
        assert changed == ({"report.html"} if title.startswith("Another") else set())
    assert now == page
    assert (run / "timings.json").read_bytes() == times


def test_a_run_with_a_changed_file_is_not_taken_as_finished(a_copy, study):
    run = a_copy()
    (run / "histories" / "linear_load-0.04.csv").unlink()
    done = porocore("run", study, "--out", run, "--resume")
    assert succeeded(done) == str(run / "report.html")
    assert "the run is finished" not in done.stderr
    assert (run / "histories" / "linear_load-0.04.csv").exists()
    assert "the run is finished" in porocore("run", study, "--out", run, "--resume").stderr


def test_a_finished_step_is_not_done_again(a_copy):
    run = a_copy()
    before = fingerprint(run)
    done = porocore("solve", run)
    assert len(succeeded(done).splitlines()) == 4
    assert done.stderr.count("is there already") == 4
    assert "surrogate.h5 is there already" in porocore("train", run).stderr
    assert fingerprint(run) == before


def test_only_the_law_that_is_asked_for_is_solved(a_copy):
    """Which needs no surrogate."""
    run = a_copy("solutions", "surrogate.h5")
    printed = succeeded(porocore("solve", run, "--law", "linear")).splitlines()
    names = {f"linear_load{load!r}.h5" for load in LOADS}
    assert (
        {Path(path).name for path in printed}
        == {path.name for path in (run / "solutions").iterdir()}
        == names
    )
