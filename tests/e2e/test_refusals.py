"""A wrong word, number, file or backend: one message, status 2, no traceback, and nothing written."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.e2e.study import ENVIRONMENT, PLAIN, fingerprint, message, porocore, write_study

FAULTS = {
    "unknown key": (
        {"cell.geometry.radios": 0.2},
        "cell.geometry.radios: unknown key; did you mean 'radius'?",
    ),
    "wrong type": ({"macro.time.end": "long"}, "macro.time.end: expected a number, got 'long'"),
    "r too large": ({"cell.geometry.radius": 0.5}, "expected a number with 0 < radius < 0.5, got 0.5"),
    "r negative": ({"cell.geometry.radius": -0.1}, "expected a number with 0 < radius < 0.5, got -0.1"),
    "r zero": ({"cell.geometry.radius": 0}, "expected a number with 0 < radius < 0.5, got 0"),
    "nu too large": (
        {"cell.material.poisson_ratio": 0.5},
        "cell.material.poisson_ratio: expected a number with -1 < poisson_ratio < 0.5, got 0.5",
    ),
    "not finite": ({"cell.viscosity": float("inf")}, "cell.viscosity: expected a finite number"),
    "empty range": (
        {"sampling.inputs.H22.range": [0.02, -0.12]},
        "sampling.inputs.H22: range [0.02, -0.12] is empty; give [lower, upper] with lower < upper",
    ),
    "no range": ({"sampling.inputs": None}, "sampling.inputs: missing; add 'inputs:' under 'sampling:'"),
    "unknown input": (
        {"sampling.inputs.H24": {"range": [0, 1]}},
        "sampling.inputs.H24: unknown key; remove it; the keys here are H11, H12,",
    ),
    "unknown closure": ({"closure": "mean-grad"}, "did you mean 'mean-gradient'?"),
    "unknown sampler": ({"sampling.sampler": "density-swep"}, "did you mean 'density-sweep'?"),
    "unknown fem backend": ({"fem.backend": "skfen"}, "unknown cell solver 'skfen'; did you mean 'skfem'?"),
    "unknown surrogate": ({"surrogate.backend": "troch"}, "unknown surrogate 'troch'; did you mean 'torch'?"),
    # What only the backends can tell, and used to tell when the folder was bound to it already.
    "option of the cell solver": ({"fem.options": {"solvr": "amg"}}, "fem.options: unknown key 'solvr'"),
    "option of the surrogate": ({"surrogate.options": {"epoch": 5}}, "did you mean 'epochs'?"),
    "step of the sampler": ({"sampling.inputs.H22.step": None}, "give the default step of 'H22'"),
    "range of the sampler": ({"sampling.inputs.p.range": [0.02, 0.1]}, "must include 0"),
    "loose column": ({"macro.boundary.y-": {}}, "macro.boundary: nothing holds the body in direction 2"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_configuration_that_cannot_be_used(fault, tmp_path):
    changes, expected = FAULTS[fault]
    config = write_study(tmp_path / "study.yaml", changes)
    refused = message(porocore("run", config, "--out", tmp_path / "run"))
    assert expected in refused
    assert len(refused.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_every_fault_is_told_at_once_with_its_line(tmp_path):
    changes = {"cell.geometry.radius": 0.6, "macro.time.stop": 3, "cell.material.poisson_ratio": "rubber"}
    config = write_study(tmp_path / "study.yaml", changes)
    lines = config.read_text().splitlines()
    first, *told = message(porocore("run", config, "--out", tmp_path / "run")).splitlines()
    assert first == "3 faults"
    assert [int(line.split(":")[1]) for line in told] == [
        1 + next(i for i, text in enumerate(lines) if key in text)
        for key in ("radius", "poisson_ratio", "stop")
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected sections such as 'cell:' and 'macro:', got an empty file"),
        ("just words", "got a text"),
        ("cell: {geometry: [", "not valid YAML"),
        ("a: 1\n\ta: 2", "study.yaml:2: expected an indentation by spaces, got a tab"),
        ("!!python/object/apply:os.system ['touch hacked']", "not valid YAML"),
        (b"\x89HDF\r\n\x1a\n\xff", "which is YAML text, got an HDF5 file"),
    ],
)
def test_a_file_that_is_no_configuration(text, expected, tmp_path):
    config = tmp_path / "study.yaml"
    config.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert expected in message(porocore("cell", config, cwd=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


def test_a_path_that_is_no_file(finished, tmp_path):
    assert "no.yaml: no such file" in message(
        porocore("run", tmp_path / "no.yaml", "--out", tmp_path / "run")
    )
    assert message(porocore("run", tmp_path)).endswith("expected a configuration file, got a folder")
    assert f"porocore run {finished}/config.yaml --out {finished} --resume" in message(
        porocore("run", finished)
    )
    assert "is not a run folder" in message(porocore("train", tmp_path))
    assert not list(tmp_path.iterdir())


def test_a_folder_that_belongs_to_something_else(study, finished, other_cell, tmp_path):
    before = fingerprint(finished), fingerprint(other_cell)
    refused = message(porocore("run", study, "--out", finished))
    assert refused.endswith("already holds this run; add --resume to continue it, or choose another --out")
    for words in ([], ["--resume"]):
        refused = message(porocore("run", study, "--out", other_cell, *words))
        assert (
            f"{other_cell} holds another run; this one has cell.material.poisson_ratio (0.35, not 0.3)"
            in refused
        )
    assert (fingerprint(finished), fingerprint(other_cell)) == before
    (tmp_path / "thesis.tex").write_text("years of work")
    refused = message(porocore("run", study, "--out", tmp_path, "--resume"))
    assert f"{tmp_path} is not empty and holds no run of porocore (found thesis.tex)" in refused
    refused = message(porocore("run", study, "--out", tmp_path / "thesis.tex"))
    assert "expected a folder, got a file" in refused
    assert fingerprint(tmp_path).keys() == {"thesis.tex"}


@pytest.mark.parametrize(
    ("missing", "words", "expected"),
    [
        (
            "the plugin",
            [],
            "surrogate 'torch' is not installed; install it: pip install porocore-surrogate-torch",
        ),
        ("torch", [], "needs torch, not installed here; install: pip install "),
        ("the plugin", ["--fem", "sckfem"], "unknown cell solver 'sckfem'; did you mean 'skfem'?"),
    ],
)
def test_a_backend_that_is_not_installed(study, tmp_path, missing, words, expected):
    hide = {
        "the plugin": "import importlib.metadata as m; real = m.distributions\n"
        "m.distributions = lambda **k: (d for d in real(**k) if d.name != 'porocore-surrogate-torch')",
        "torch": "import importlib.util as u; real = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'torch' else real(name, *a)",
    }[missing]
    program = [sys.executable, "-c", f"{hide}\nfrom porocore.cli import main; main()"]
    done = subprocess.run(
        [*program, "run", study, *words, "--out", tmp_path / "run"],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert expected in message(done)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--p", "nan"], "--p: expected a finite number, got nan"),
        (["--p", "-inf"], "--p: expected a finite number, got -inf"),
        (["--p=much"], "--p: expected a number, or a pressure, such as 2 kPa, got 'much'"),
        (["--grad-u", "0 0 0; 0 0"], "expected nine finite numbers as 'a b c; d e f; g h i'"),
        (["--grad-u", "0 0 0; 0 x 0; 0 0 0"], "(not all are numbers)"),
        (["--grad-u", "0 0 0; 0 nan 0; 0 0 0"], "expected nine finite numbers"),
        (["--grad-u", ""], "expected nine finite numbers"),
    ],
)
def test_a_state_that_is_no_state(study, words, expected):
    done = porocore("cell", study, *words, "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "Traceback" not in done.stderr
    assert expected in " ".join(done.stderr.replace("│", " ").split())


def test_a_reader_that_goes_away(study):
    """As in 'porocore plugins | head -1': no traceback."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as closed:
        done = subprocess.run(
            [*PLAIN, "plugins"],
            env=ENVIRONMENT,
            stdout=closed,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.stderr == ""
    assert done.returncode in (0, 1)
    with subprocess.Popen(
        [*PLAIN, "plugins"], env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as one:
        assert one.stdout is not None
        assert one.stderr is not None
        assert one.stdout.readline().startswith(b"kind")
        one.stdout.close()
        assert one.stderr.read() == b""


def test_a_closure_that_does_not_exist_is_refused(study, finished, tmp_path):
    before = fingerprint(finished)
    for words in (("solve", finished), ("train", finished)):
        refused = message(porocore(*words, "--closure", "potental"))
        assert "unknown closure 'potental'; did you mean 'potential'?" in refused
    assert fingerprint(finished) == before
    assert "the closures are" in message(
        porocore("run", study, "--closure", "mean", "--out", tmp_path / "new")
    )
    assert not (tmp_path / "new").exists()
