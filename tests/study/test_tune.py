"""``porocore tune``: the grid, the choice, what is kept, and what is refused."""

from __future__ import annotations

import csv
import importlib
import io
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.cli import main
from porocore.core.console import Console
from porocore.core.inputs import NAMES
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.records import SolvedState
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.reference import CellReference
from porocore.plugins import registry
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.samplers.density import DensitySweep
from porocore.sampling.samplers.designs import RandomStates
from porocore.states import MacroState
from porocore.study import tuning as tune
from porocore.study.api.study import Study
from porocore.study.config.loading import crosscheck_path, load_config
from porocore.study.run.folder import RunFolder
from porocore.study.tuning import Candidate, Result, candidates, held_out_errors
from porocore.testing.synthetic.cell import INPUTS, respond, synthetic_training_set

#: Read by the plugin of tune_fakes.
LOG = "POROCORE_TUNE_LOG"


@pytest.fixture(autouse=True, scope="module")
def fakes(tmp_path_factory):
    """The plugin of tune_fakes, found beside the installed ones."""
    site = tmp_path_factory.mktemp("site")
    info = site / "porocore_sized-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: porocore-sized\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[porocore]\nsized = tune_fakes\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[1] / "helpers"))
        patch.syspath_prepend(str(site))
        registry.registry.cache_clear()
        yield site
    registry.registry.cache_clear()


@pytest.fixture
def folder(sampled, tmp_path):
    """A copy of the run folder, beside its configuration."""
    shutil.copytree(sampled, tmp_path, dirs_exist_ok=True)
    return RunFolder.open(tmp_path / "run")


@pytest.fixture(scope="module")
def sampled(fakes, tmp_path_factory):
    """A folder with a run whose states are those of the made-up cell. Not to be changed."""
    home = tmp_path_factory.mktemp("sampled")
    settings = yaml.safe_load(crosscheck_path().read_text(encoding="utf-8"))
    settings["surrogate"] = {"backend": "sized"}
    settings["closure"] = "mean-gradient"
    settings["sampling"] = {
        "sampler": "density-sweep",
        "tolerance": 1.0,
        "test": {"count": 30, "seed": 1},
        "inputs": {
            "p": {"range": [-0.02, 0.24], "step": 0.13},
            "H22": {"range": [-0.20, 0.04], "step": 0.06},
        },
    }
    (home / "study.yaml").write_text(yaml.safe_dump(settings))
    config = load_config(home / "study.yaml")
    folder = RunFolder.claim(home / "run", config)
    inputs, stages = config.sampling.input_space(), config.stages
    sweep = DensitySweep(inputs, **config.sampling.sampler_options())
    for path, identity, sampler in (
        (folder.dataset, stages.sampling, sweep),
        (folder.test_dataset, stages.test, RandomStates(inputs, count=30, seed=1)),
    ):
        dataset = Dataset.create(path, inputs=inputs, identity=identity)
        while requests := sampler.ask():
            for request in requests:
                state = inputs.scatter([request.x])
                response = respond(state)
                dataset.append(SolvedState(request.key, request.x, state, response, 0.1, request.start, None))
                sampler.tell(request.key, response)
        dataset.consolidate()
    CellReference(stages.cell, respond(MacroState.zeros(1)), np.eye(3), {}).save(folder.reference)
    return home


@pytest.fixture
def log(tmp_path, monkeypatch):
    path = tmp_path / "log"
    path.write_text("")
    monkeypatch.setenv(LOG, str(path))
    return lambda: [line.split() for line in path.read_text().splitlines()]


@pytest.fixture
def command(monkeypatch, capsys):
    """``porocore tune …`` in this process: status, standard output, standard error."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["porocore", "tune", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


SMALL = ("--depths", "1,2", "--widths", "4,8,16", "--workers", "1")


@pytest.mark.usefixtures("undrawn")
def test_the_smallest_within_the_margin_is_chosen(folder, command):
    """Errors are 1 % over the number of neurons: 4, 8, 16 and twice as many; at 110 % of the best only that is left."""
    status, out, err = command(folder.path, *SMALL, "--activations", "tanh")
    assert status == 0
    assert yaml.safe_load(out) == {
        "surrogate": {
            "backend": "sized",
            "model": "mlp",
            "options": {"hidden": [16, 16], "activation": "tanh"},
        }
    }
    assert "6 of 6 candidates" in err
    assert len([line for line in err.splitlines() if line.startswith("[")]) == 6
    status, out, _ = command(folder.path, *SMALL, "--activations", "tanh", "--margin", 110)
    assert yaml.safe_load(out)["surrogate"]["options"]["hidden"] == [16]


@pytest.mark.usefixtures("undrawn")
def test_the_lines_are_a_configuration(folder, command, tmp_path):
    _, out, _ = command(folder.path, *SMALL)
    settings = yaml.safe_load((tmp_path / "study.yaml").read_text())
    (tmp_path / "tuned.yaml").write_text(yaml.safe_dump(settings | yaml.safe_load(out)))
    config = load_config(tmp_path / "tuned.yaml")
    assert config.surrogate.options == {"hidden": [16, 16], "activation": "tanh"}


def test_tables_and_figure_are_kept(folder, command):
    tune_fakes = importlib.import_module("tests.helpers.tune_fakes")
    command(folder.path, *SMALL)
    document = json.loads((folder.path / "tune.json").read_text())
    assert document["format"] == "porocore-tune"
    assert document["chosen"]["width"] == 16
    with open(folder.path / "tune.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(document["candidates"]) == 12
    sizes = [int(row["parameters"]) for row in rows]
    assert sizes == sorted(sizes)
    # Two inputs, three components of <∇u¹> that vary.
    assert sizes[0] == 3 * 4 + 5 * 3
    for row in rows:
        hidden = [int(row["width"])] * int(row["depth"])
        truth = respond(folder_states(folder)).mean_grad.reshape(-1, 9)
        wrong = tune_fakes.known_error(hidden, row["activation"]) * truth
        expected = np.sqrt((wrong**2).mean(axis=0)).max() / np.ptp(truth, axis=0).max()
        assert float(row["error"]) == pytest.approx(expected, rel=1e-12)
    assert (folder.path / "tune.png").read_bytes().startswith(b"\x89PNG")


def folder_states(folder):
    return Dataset.open(folder.test_dataset).states()


@pytest.mark.usefixtures("undrawn")
def test_what_is_trained_is_not_trained_again(folder, command, log):
    command(folder.path, *SMALL, "--activations", "tanh")
    assert len(log()) == 6
    _, _, err = command(folder.path, "--depths", "1,2", "--widths", "4,32", "--workers", 1)
    assert len(log()) == 6 + 6  # tanh of width 4 was there
    kept = next(folder.path.glob("tune/*/1x4-tanh.json"))
    kept.write_text(kept.read_text()[:20])
    command(folder.path, *SMALL, "--activations", "tanh")
    assert len(log()) == 13
    assert "6 of 6 candidates" in err or "8 of 8 candidates" in err


@pytest.mark.usefixtures("undrawn")
def test_other_settings_are_not_mixed_up(folder, log):
    """A seed is part of what a candidate belongs to."""
    grid, console = candidates(folder.config, [1], [4], ["tanh"]), Console(io.StringIO())
    tune.tune(folder, folder.config, grid, console=console)
    surrogate = folder.config.surrogate.model_copy(update={"seed": 5})
    tune.tune(folder, folder.config.model_copy(update={"surrogate": surrogate}), grid, console=console)
    assert len(log()) == 2
    assert len(list(folder.path.glob("tune/*"))) == 2


@pytest.mark.usefixtures("undrawn")
def test_another_run_on_the_same_samples_trains_none_again(folder, tmp_path, log, command):
    """What is reported is what it took; on other samples all are trained."""
    words = ("--depths", 1, "--widths", "4,8,16", "--activations", "tanh", "--store", tmp_path / "store")
    status, out, err = command(folder.path, *words)
    assert (status, len(log())) == (0, 3)
    assert "came from the store" not in err
    table = json.loads((folder.path / "tune.json").read_text())
    shutil.rmtree(folder.path / "tune")
    status, again, err = command(folder.path, *words)
    assert (status, len(log())) == (0, 3)
    assert "tuning: 3 candidates came from the store, which saved " in err
    assert again == out
    assert json.loads((folder.path / "tune.json").read_text()) == table
    shutil.rmtree(folder.path / "tune")
    command(folder.path, *words[:-2], "--no-store")
    assert len(log()) == 6


def test_a_search_that_is_interrupted_says_how_it_goes_on(folder, command, monkeypatch):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(tune.TuningSeries, "function", interrupted)
    words = ("--depths", "1", "--widths", "4,8", "--margin", "20.0", "--workers", "1")
    status, _, err = command(folder.path, *words)
    assert status == 130
    assert f"continue with: porocore tune {folder.path} {' '.join(words)}" in err


@pytest.mark.usefixtures("undrawn")
def test_a_training_that_diverges_is_in_the_table_and_never_chosen(folder, command):
    status, out, err = command(
        folder.path, "--depths", 3, "--widths", 16, "--activations", "sigmoid", "--workers", 1
    )
    assert (status, out) == (2, "")
    assert "all trainings diverged" in err
    status, out, err = command(folder.path, "--depths", 3, "--widths", "4,16", "--workers", 1)
    assert status == 0
    assert "diverged" in err
    assert yaml.safe_load(out)["surrogate"]["options"]["activation"] == "tanh"
    assert "NaN" not in (folder.path / "tune.json").read_text()


def test_a_surrogate_without_architecture_is_refused(folder, command):
    status, out, err = command(folder.path, "--surrogate", "polynomial")
    assert (status, out) == (2, "")
    assert err.startswith("error: surrogate.backend: 'polynomial' has no options hidden and activation")
    assert len(err.strip().splitlines()) == 1
    assert not (folder.path / "tune").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--widths", "8,x"), "--widths: expected whole numbers with commas between"),
        (("--depths", "0"), "--depths: expected whole numbers from 1 to 20"),
        (("--activations", "relu"), "--activations: expected some of sigmoid, tanh, got 'relu'"),
        (("--margin", "-1"), "--margin: expected a percentage of at least 0"),
        (("--workers", "0"), "--workers: expected 1 to 512"),
        (("--surrogate", "torhc"), "torhc"),
    ],
)
def test_what_cannot_be_used_is_refused(folder, command, words, message):
    status, out, err = command(folder.path, *words)
    assert (status, out) == (2, "")
    assert message in err
    assert "Traceback" not in err


def test_a_run_without_samples_names_the_command(folder, command):
    folder.dataset.unlink()
    status, _, err = command(folder.path, *SMALL)
    assert status == 2
    assert "sample" in err


def test_only_the_stress_that_does_work_counts():
    """The lateral stress of confined compression is not learned."""
    data = synthetic_training_set(20, seed=0)
    truth = data.responses
    wrong = truth.stress.copy()
    wrong[:, 0, 0] += 1.0
    assert held_out_errors(replace(truth, stress=wrong), truth, data)["stress"] == 0.0
    wrong[:, 1, 1] += 0.01 * np.ptp(truth.stress[:, 1, 1])
    assert held_out_errors(replace(truth, stress=wrong), truth, data)["stress"] == pytest.approx(0.01)
    everything = TrainingSet(data.states, truth, type(INPUTS)(NAMES, (-1.0,) * 10, (1.0,) * 10),
                             data.reference, "", {})  # fmt: skip
    assert held_out_errors(replace(truth, stress=wrong), truth, everything)["stress"] > 1


def test_the_first_good_one_is_chosen():
    def result(parameters, error):
        return Result(1, parameters, "tanh", parameters, error, {}, 0.0)

    results = [result(1, None), result(2, 0.0111), result(3, 0.0109), result(4, 0.01), result(5, 0.02)]
    assert tune.smallest_good(results, 0.1).parameters == 3
    assert tune.smallest_good(results, 0.0).parameters == 4
    with pytest.raises(DataError, match="all trainings diverged"):
        tune.smallest_good(results[:1], 0.1)


def test_the_grid(folder):
    grid = candidates(folder.config)
    assert len(grid) == 3 * 4 * 2
    assert Candidate(3, 40, "sigmoid") in grid
    assert Candidate(3, 40, "sigmoid").size(2, 3) == 3 * 40 + 2 * 41 * 40 + 41 * 3
    with pytest.raises(ConfigurationError):
        candidates(folder.config, [1], [])


@pytest.mark.usefixtures("undrawn")
def test_a_study_tunes_its_network_from_python(folder):
    study = Study(folder.config, out=folder.path, progress=False)
    found = study.tune(depths=[1], widths=[4, 8], activations=["tanh"], workers=1)
    assert [result.width for result in found.results] == [4, 8]
    assert found.chosen.width == 8
    assert [path.name for path in found.files] == ["tune.json", "tune.csv", "tune.png"]
