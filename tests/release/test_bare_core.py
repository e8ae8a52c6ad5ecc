"""``pip install porocore`` alone: light to import, and every command works or says what it wants to be installed."""

import json
import shutil

import pytest

from porocore.cli.entry import whole_program
from tests.release.environments import CONSTRAINTS, Environment

pytestmark = pytest.mark.slow

#: What each command says; None where it does its work.
SKFEM = "cell solver 'skfem' is not installed; install it: pip install porocore-fem-skfem"
TORCH = "surrogate 'torch' is not installed; install it: pip install porocore-surrogate-torch"
BOTH = f"2 faults\n  {SKFEM}\n  {TORCH}"
ELSEWHERE = "; ".join(
    f"{name} (not installed): pip install porocore-fem-{name}" for name in ("skfem", "dolfinx")
)
COMMANDS = [
    ("init", None),
    ("init cartilage-confined --to plug.yaml", None),
    ("schema --to porocore.schema.json", None),
    ("units time=38", None),
    ("plugins", None),
    ("plugins --json --load", None),
    ("plugin new my-grid --kind sampler", None),
    ("plugin check sobol", "checking a plugin needs pytest, which is not installed here: pip install pytest"),
    ("plugin check skfem", SKFEM),
    ("check study.yaml", BOTH),
    ("run", BOTH),
    ("run study.yaml --out new", BOTH),
    ("run study.yaml --surrogate polynomial --closure potential --out new", SKFEM),
    ("run study.yaml --out run --resume", BOTH),
    ("reproduce dehghani2022 --no-pictures --out new", BOTH),
    (
        "reproduce dehghani2022 --out new",
        "need pyvista, which is not installed: pip install pyvista",
    ),
    ("reproduce dehghani2022 --figure 13 --out new", BOTH),
    ("sweep study.yaml --over radius=0.2:0.3:3 --out new", BOTH),
    ("calibrate test.yaml --synthetic --out new", BOTH),
    ("calibrate draws.yaml --synthetic --out new", "pip install emcee"),
    ("sample study.yaml --out new", SKFEM),
    ("train run", TORCH),
    ("solve run", "macro solver 'skfem' is not installed; install it: pip install porocore-fem-skfem"),
    ("report run", TORCH),
    ("tune run", TORCH),
    ("stability study.yaml --out new", SKFEM),
    ("sensitivity study.yaml --out new", SKFEM),
    ("crosscheck --out new", f"no cell solver takes part; install one: {ELSEWHERE}"),
    ("verify", f"there is no finite-element backend; install one: {ELSEWHERE}"),
    ("cell state study.yaml --p 0.01", SKFEM),
    ("cell fields study.yaml --at p=0.01 --out new", SKFEM),
    ("cell rev study.yaml --out new", SKFEM),
    ("cell show study.yaml --out cell", "pictures need pyvista, which is not installed"),
    ("data info run", None),
    ("data check run", None),
    ("data merge run run --out all.h5", None),
    ("data export run --out states.csv", None),
    ("data export run --out states.parquet", "pip install pyarrow"),
    ("data plot run --out states.png", None),
    ("store list --store kept", None),
    ("store check --store kept", None),
    ("store clear --store kept", None),
]

#: A calibration of the study's modulus.
TEST = """
unknowns: {modulus: {lower: 0.5, upper: 2}}
experiments:
  creep:
    study: study.yaml
    load: -0.01
    observations:
      settlement: {quantity: settlement, times: {first: 1, last: 3, count: 3}, deviation_share: 0.01}
"""


@pytest.fixture(scope="module")
def bare(dist, tmp_path_factory):
    environment = Environment(tmp_path_factory.mktemp("bare") / "environment")
    environment.install("--find-links", dist, "-c", CONSTRAINTS, "porocore")
    yield environment
    environment.remove()


@pytest.fixture(scope="module")
def place(finished, write_coarse, tmp_path_factory):
    """A folder with a study and with a run that somebody else has made."""
    folder = tmp_path_factory.mktemp("place")
    write_coarse(folder / "study.yaml")
    (folder / "test.yaml").write_text(TEST)
    (folder / "draws.yaml").write_text(f"{TEST}posterior: {{}}\n")
    shutil.copytree(finished, folder / "run")
    (folder / "kept").mkdir()
    return folder


def leaves(command, words=()):
    for name, sub in command.commands.items():
        if hasattr(sub, "commands"):
            yield from leaves(sub, (*words, name))
        else:
            yield " ".join((*words, name))


def test_every_command_is_tried():
    tried = {text for text, _ in COMMANDS}
    for name in leaves(whole_program()):
        assert any(text == name or text.startswith(f"{name} ") for text in tried), name


@pytest.mark.parametrize(("text", "message"), COMMANDS, ids=[text for text, _ in COMMANDS])
def test_a_command_works_or_says_what_to_install(bare, place, text, message):
    _, err = bare.porocore(*text.split(), cwd=place, status=0 if message is None else 2)
    if message is not None:
        assert message in err.rpartition("error: ")[2]
    assert not (place / "new").exists()


def test_nothing_but_the_core_is_there(bare):
    rows = bare.plugins()
    assert {row["distribution"] for row in rows if row["works"]} == {"porocore"}
    names = {row["name"] for row in json.loads(bare.pip("list", "--format", "json"))}
    assert not names & {"torch", "jax", "scikit-fem", "pyamg", "pytest", "pyvista"}
