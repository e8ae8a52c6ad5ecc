"""A plugin from nothing, where only the wheels of porocore, its usual backends and their dependencies are installed."""

import json
import shutil
from pathlib import Path

import pytest

from porocore.plugins.kinds import KINDS

ROOT = Path(__file__).parents[2]
EXAMPLES = {"cell": "layered", "sampler": "halton", "surrogate": "gaussian-process"}
#: How the new name takes part in a study.
USED = {
    "cell": ("run", "--fem", "my-cell", "--macro", "skfem"),
    "macro": ("run", "--macro", "my-macro"),
    "surrogate": ("run", "--surrogate", "my-surrogate"),
    "sampler": ("sample",),
    "command": ("my-command",),
}
pytestmark = pytest.mark.slow


def test_nothing_but_the_wheels_is_there(usual):
    out = usual.pip("list", "--format", "json")
    names = {row["name"] for row in json.loads(out) if row["name"].startswith("porocore")}
    assert names == {"porocore", "porocore-fem-skfem", "porocore-surrogate-torch"}
    assert {name: state for (_, name), state in usual.states().items()} == {
        "skfem": "ready",
        "torch": "ready",
        "dolfinx": "not installed",
        "jax": "not installed",
    }
    code = "import porocore; print(porocore.__file__)"
    assert usual.run(usual.python, "-I", "-c", code, cwd=usual.folder)[0].startswith(str(usual.folder))


@pytest.mark.parametrize("kind", [record.word for record in KINDS.values()])
def test_a_new_plugin_is_installed_checked_and_used_without_an_edit(usual, write_coarse, kind, tmp_path):
    study = write_coarse(tmp_path / "study.yaml")
    name, folder = f"my-{kind}", f"porocore-{kind}-my-{kind}"
    out, err = usual.porocore("plugin", "new", name, "--kind", kind, cwd=tmp_path)
    assert out.strip() == folder
    assert f"next: pip install -e '{folder}[test]', then porocore plugin check {name} --kind {kind}" in err
    usual.pip("install", "-q", f"{tmp_path / folder}[test]")
    # Nothing of the folder is needed any more.
    shutil.rmtree(tmp_path / folder)
    out, _ = usual.porocore("plugin", "check", name, cwd=tmp_path)
    assert "passed" in out.splitlines()[-1]
    assert "failed" not in out.splitlines()[-1]
    if kind == "sampler":
        text = study.read_text("utf-8").replace("  tolerance: 0.05\n", "  sampler: my-sampler\n")
        study.write_text("\n".join(line for line in text.splitlines() if "step: 0.04" not in line), "utf-8")
    command, *words = USED[kind]
    out, _ = usual.porocore(command, study, *words, "--out", "run", cwd=tmp_path)
    if command == "run":
        assert (tmp_path / out.strip()).name == "report.html"
        assert len(list((tmp_path / "run/solutions").glob("*.h5"))) == 2
    if kind == "command":
        assert (tmp_path / "run/my-command.csv").read_text("utf-8").startswith("size,porosity\n")
    else:
        record = (tmp_path / "run/config.yaml").read_text("utf-8")
        assert f"{'sampler' if kind == 'sampler' else 'backend'}: {name}" in record
    usual.pip("uninstall", "-q", "-y", folder)


@pytest.mark.parametrize("kind", EXAMPLES)
def test_an_example_is_installed_and_checked_as_a_strangers(usual, kind, tmp_path):
    project = f"porocore-{kind}-{EXAMPLES[kind]}"
    folder = shutil.copytree(ROOT / "examples/plugins" / project, tmp_path / project)
    usual.pip("install", "-q", f"{folder}[test]")
    shutil.rmtree(folder)
    (row,) = [row for row in usual.plugins() if row["name"] == EXAMPLES[kind]]
    assert (row["distribution"], row["state"]) == (project, "ready")
    out, _ = usual.porocore("plugin", "check", EXAMPLES[kind], cwd=tmp_path)
    assert "passed" in out.splitlines()[-1]
    assert "failed" not in out.splitlines()[-1]
    usual.pip("uninstall", "-q", "-y", project)
