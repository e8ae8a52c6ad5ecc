"""One run with both closures and with the cell itself at every point: side by side, resumable, refused in words."""

from __future__ import annotations

import json
import re
import shutil
import signal

import h5py
import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from tests.e2e.study import ONE_LOAD, Running, contents, message, porocore, seconds, succeeded, write_study

#: Two elements and five steps, so that direct FE² takes seconds.
SHORT = ONE_LOAD | {
    "surrogate": {"backend": "polynomial"},
    "macro.body.elements": [1, 2, 1],
    "macro.time": {"end": 30, "step": 10, "ramp_increments": 2, "ramp_step": 1.5, "profiles": [10]},
    "macro.options": {"checkpoint_seconds": 0},
}
PAPER, EXACT = "solutions/mean-gradient_load-0.04.h5", "solutions/potential_load-0.04.h5"
DIRECT = "solutions/direct-potential_load-0.04.h5"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("short") / "short.yaml", SHORT)


@pytest.fixture(scope="module")
def paper(config, tmp_path_factory):
    """A run with the paper's closure, done by its steps; its report is an old one. Not to be changed."""
    out = tmp_path_factory.mktemp("paper") / "run"
    succeeded(porocore("sample", config, "--out", out))
    succeeded(porocore("train", out))
    succeeded(porocore("solve", out))
    (out / "report.html").write_text("of yesterday")
    return out


@pytest.fixture(scope="module")
def both(config, paper, tmp_path_factory):
    """The same, gone on with direct FE² and with the exact closure. Not to be changed."""
    out = tmp_path_factory.mktemp("both") / "run"
    shutil.copytree(paper, out)
    assert succeeded(porocore("solve", out, "--law", "direct")) == str(out / DIRECT)
    succeeded(porocore("run", config, "--closure", "potential", "--out", out, "--resume"))
    return out


def settlement(run, name):
    return MacroSolution.load_file(run / name).history.settlement


@pytest.mark.slow
def test_another_closure_is_added_and_nothing_is_done_again(paper, both):
    assert seconds(both) == seconds(paper)
    for name in ("surrogate.h5", PAPER, "solutions/linear_load-0.04.h5"):
        assert contents(both / name) == contents(paper / name)
    assert {path.name for path in both.glob("surrogate*")} == {"surrogate.h5", "surrogate-potential.h5"}
    assert (both / "config.yaml").read_bytes() == (paper / "config.yaml").read_bytes()
    assert not list((both / "checkpoints").iterdir())


@pytest.mark.slow
def test_the_exact_closure_agrees_with_the_cell_itself_and_the_papers_does_not(both):
    direct, exact, paper = (settlement(both, name)[1:] for name in (DIRECT, EXACT, PAPER))
    assert np.abs(exact / direct - 1).max() < 2e-3
    assert np.abs(paper / direct - 1)[-1] > 5e-3


@pytest.mark.slow
def test_the_report_and_the_metrics_set_them_side_by_side(both):
    metrics = json.loads((both / "metrics.json").read_text(encoding="utf-8"))
    (case,) = metrics["macro"]
    assert case["nonlinear"]["law"] == "mean-gradient"
    assert [other["law"] for other in case["others"]] == ["potential", "direct-potential"]
    gaps = {(gap["law"], gap["reference"]): gap["settlement"] for gap in case["gaps"]}
    paper, direct = settlement(both, PAPER), settlement(both, DIRECT)
    found = gaps["mean-gradient", "direct-potential"]
    assert found["end_percent"] == pytest.approx(100 * (paper[-1] - direct[-1]) / direct.max(), rel=1e-6)
    assert found["largest_percent"] == pytest.approx(
        100 * np.abs(paper - direct).max() / direct.max(), rel=1e-6
    )
    (cost,) = metrics["direct"]
    assert 30 < cost["solves"] < cost["points"]
    assert cost["failed"] == 0
    assert cost["speed_up"] > 1
    assert cost["solve_seconds"] > 0
    page = (both / "report.html").read_text(encoding="utf-8")
    assert "Comparison of the laws" in page
    assert "Cost of direct FE²" in page
    assert "It adds no error to them" in page
    assert {path.stem.split("_")[0] for path in (both / "fields").glob("*.pvd")} == {
        "mean-gradient", "potential", "direct-potential", "linear",
    }  # fmt: skip


@pytest.mark.slow
def test_the_steps_add_a_closure_too(paper, both, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(paper, run)
    refused = message(porocore("solve", run, "--closure", "potential"))
    assert f"porocore train --closure potential {run}" in refused
    assert succeeded(porocore("train", run, "--closure", "potential")) == str(run / "surrogate-potential.h5")
    printed = succeeded(porocore("solve", run, "--closure", "potential")).splitlines()
    assert printed == [str(run / EXACT), str(run / "solutions/linear_load-0.04.h5")]
    np.testing.assert_array_equal(settlement(run, EXACT), settlement(both, EXACT))


@pytest.mark.slow
def test_a_direct_solve_that_was_interrupted_goes_on(paper, both, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(paper, run)
    checkpoint = run / "checkpoints" / "direct-potential_load-0.04.h5"
    running = Running(tmp_path / "scratch", "solve", run, "--law", "direct")
    try:
        running.until(lambda: checkpoint.exists() and h5py.File(checkpoint).attrs["time"] >= 3)
        assert running.stop(signal.SIGINT) == 130
        running.assert_gone()
    finally:
        running.kill_all()
    assert re.search(r"continue with: porocore solve .* --law direct", running.err.read_text())
    begun = json.loads((run / "direct.json").read_text())["direct-potential_load-0.04"]["solves"]
    done = porocore("solve", run, "--law", "direct")
    assert succeeded(done) == str(run / DIRECT)
    here = int(re.search(r"(\d+) cells solved in this session", done.stderr).group(1))
    record = json.loads((run / "direct.json").read_text())["direct-potential_load-0.04"]
    assert record["solves"] == record["converged"] == begun + here
    np.testing.assert_allclose(settlement(run, DIRECT), settlement(both, DIRECT), rtol=1e-8)
    assert not checkpoint.exists()


def test_a_surrogate_without_stress_is_refused_before_anything_is_solved(tmp_path):
    changes = SHORT | {"closure": "potential", "surrogate": {"backend": "torch", "model": "mlp"}}
    config = write_study(tmp_path / "wrong.yaml", changes)
    refused = message(porocore("run", config, "--out", tmp_path / "run"))
    assert "'potential' needs stress, fluid_volume of the cell" in refused
    assert "surrogate 'torch' with model 'mlp' does not provide" in refused
    assert not (tmp_path / "run").exists()
