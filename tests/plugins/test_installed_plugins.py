"""Faulty plugins as pip installs them: what the command says about each, and that all else goes on working."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from porocore.sampling.datasets.dataset import Dataset

sys.path.insert(0, str(Path(__file__).parents[1] / "e2e"))
from tests.e2e.study import STUDY
from tests.helpers.faulty_plugins import SOURCES, install

POROCORE = Path(sys.executable).with_name("porocore")
INPUTS = {"p": {"range": [-0.02, 0.06]}, "H22": {"range": [-0.1, 0.02]}}
NEWER = "made for version 2 of the surrogate interface, newer than this porocore, which takes version 1"
MISSPELT = "there is no hook 'porocore_macro_solver'; did you mean 'porocore_macro_solvers'?"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"))


@pytest.fixture
def porocore(site, tmp_path):
    """A function that runs the command beside the installed plugins: status, standard output, standard error."""

    def run(*words):
        path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "COLUMNS": "200"}
        done = subprocess.run(
            [POROCORE, *words], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout, done.stderr

    return run


def write_study(folder, sampler="sobol", **options):
    """The small study, by the cell of the plugin without a fault."""
    held_out = {"count": 2, "seed": 7}
    sampling = {"inputs": INPUTS, "workers": 1, "sampler": sampler, "options": options, "test": held_out}
    study = STUDY | {"fem": {"backend": "acme-cell"}, "macro": {**STUDY["macro"], "backend": "skfem"}}
    study |= {"sampling": sampling, "surrogate": {"backend": "polynomial"}, "closure": "mean-gradient"}
    (folder / "my.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")


def test_all_are_listed_each_with_its_state_and_what_to_do(porocore, site):
    status, out, err = porocore("plugins", "--json")
    assert (status, err) == (0, "")
    rows = {row["distribution"]: row for row in json.loads(out) if row["distribution"] in SOURCES}
    assert {name: (row["state"], row["works"], row["kind"]) for name, row in rows.items()} == {
        "acme-cell": ("ready", True, "cell solver"),
        "acme-grid-one": ("offered twice", False, "sampler"),
        "acme-grid-two": ("offered twice", False, "sampler"),
        "acme-broken": ("broken", False, None),
        "acme-misspelt": ("broken", False, None),
        "acme-newer": ("other interface", False, "surrogate"),
        "acme-lacking": ("missing dependency", False, "sampler"),
    }
    assert {name: row["advice"] for name, row in rows.items()} == {
        "acme-cell": None,
        "acme-grid-one": "uninstall one: pip uninstall acme-grid-one",
        "acme-grid-two": "uninstall one: pip uninstall acme-grid-two",
        "acme-broken": f"OSError: libacme.so.3: cannot open shared object file ({site}/acme_broken.py:2)",
        "acme-misspelt": f"{MISSPELT} ({site}/acme_misspelt.py)",
        "acme-newer": f"{NEWER}; upgrade porocore: pip install --upgrade porocore",
        "acme-lacking": "pip install 'acme-lacking[mathematics]'",
    }
    assert {row["version"] for row in rows.values()} == {"1.0"}
    assert rows["acme-lacking"]["requirements"] == ["porocore", "acme-mathematics>=2"]
    assert rows["acme-lacking"]["modules"] == ["numpy", "acme_mathematics"]
    # What was there before is there as ever.
    others = {(row["kind"], row["name"]) for row in json.loads(out) if row["works"]}
    assert {("sampler", "sobol"), ("surrogate", "polynomial"), ("sampler", "density-sweep")} <= others


def test_the_table_shows_them_too(porocore, site):
    status, out, err = porocore("plugins")
    assert (status, err) == (0, "")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    for first, second in (
        ("cell solver acme-cell ready acme-cell 1.0 a cell in closed form", None),
        (
            "sampler acme-grid offered twice acme-grid-one 1.0 a grid",
            "uninstall one: pip uninstall acme-grid-one",
        ),
        (
            "plugin acme-broken broken acme-broken 1.0",
            "OSError: libacme.so.3: cannot open shared object file",
        ),
        ("plugin acme-misspelt broken acme-misspelt 1.0", f"{MISSPELT} ({site}/acme_misspelt.py)"),
        ("surrogate acme-newer other interface acme-newer 1.0", f"{NEWER}; upgrade porocore: pip install"),
        ("sampler acme-lacking missing dependency acme-lacking 1.0 a sampler", "pip install 'acme-lacking["),
    ):
        place = lines.index(first)
        assert second is None or lines[place + 1].startswith(second)


@pytest.mark.parametrize(
    ("command", "sampler", "expected"),
    [
        (
            ["sample", "my.yaml"],
            "acme-grid",
            [
                "sampler 'acme-grid' is offered by acme-grid-one 1.0 and acme-grid-two 1.0; uninstall all but one: "
                "pip uninstall acme-grid-two"
            ],
        ),
        (
            ["sample", "my.yaml"],
            "acme-lacking",
            [
                "sampler 'acme-lacking' (acme-lacking 1.0) needs acme_mathematics, not installed here; install: "
                "pip install 'acme-lacking[mathematics]'"
            ],
        ),
        (
            ["run", "my.yaml", "--fem", "acme-broken"],
            "sobol",
            [
                "unknown cell solver 'acme-broken'",
                "the plugin of acme-broken 1.0 is broken: OSError: libacme.so.3: cannot open shared object file",
            ],
        ),
        (
            ["run", "my.yaml", "--macro", "acme-misspelt"],
            "sobol",
            [
                "unknown macro solver 'acme-misspelt'",
                f"the plugin of acme-misspelt 1.0 is broken: {MISSPELT}",
            ],
        ),
        (
            ["run", "my.yaml", "--surrogate", "acme-newer"],
            "sobol",
            [
                "unknown surrogate 'acme-newer'",
                f"the plugin of acme-newer 1.0 was {NEWER}; upgrade porocore: pip install --upgrade porocore",
            ],
        ),
    ],
    ids=["one name", "missing dependency", "fails at import", "misspelt hook", "another interface"],
)
def test_who_asks_for_one_is_told_what_is_wrong_with_it(porocore, tmp_path, command, sampler, expected):
    write_study(tmp_path, sampler)
    status, out, err = porocore(*command, "--out", "run")
    assert (status, out) == (2, "")
    (message,) = err.splitlines()
    for words in ("error: ", *expected):
        assert words in message
    assert [path.name for path in tmp_path.iterdir()] == ["my.yaml"], "something was written"


def test_beside_them_all_a_study_is_sampled(porocore, tmp_path):
    """By another sampler, and by the cell solver of a stranger."""
    write_study(tmp_path, "sobol", count=4, seed=1)
    status, _, err = porocore("sample", "my.yaml", "--out", "run")
    assert status == 0, err
    assert "4 states: 4 converged" in err
    sampled = Dataset.open(tmp_path / "run" / "samples.h5")
    assert len(sampled) == 4
    assert sampled.responses().valid.all()
