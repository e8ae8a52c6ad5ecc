"""``porocore plugin new`` and ``check``, ``porocore plugins --json``, and the example plugins as a stranger's."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

from porocore.errors import ConfigurationError
from porocore.plugins.kinds import KINDS
from porocore.plugins.scaffold.project import write_project

KIND = {record.word: kind for kind, record in KINDS.items()}
ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples/plugins").glob("porocore-*"))
POROCORE = Path(sys.executable).with_name("porocore")


def porocore(site, *words, status=0):
    """Run the command where the distributions in ``site`` are installed: standard output, standard error."""
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "COLUMNS": "160"}
    done = subprocess.run(
        [POROCORE, *map(str, words)], env=environment, cwd=site, capture_output=True, text=True, check=False
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout, done.stderr


def install(project, site):
    """By hand, as an installer does it: the package's folder and what its metadata say."""
    settings = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for package in project.glob("porocore_*"):
        (site / package.name).symlink_to(package)
    info = site / f"{settings['name'].replace('-', '_')}-{settings['version']}.dist-info"
    info.mkdir()
    needs = "".join(f"Requires-Dist: {text}\n" for text in settings["dependencies"])
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {settings['name']}\nVersion: {settings['version']}\n{needs}"
    )
    points = settings["entry-points"]["porocore"].items()
    (info / "entry_points.txt").write_text("[porocore]\n" + "".join(f"{k} = {v}\n" for k, v in points))


@pytest.fixture
def site(tmp_path):
    folder = tmp_path / "site"
    folder.mkdir()
    return folder


# ---- new ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KIND)
def test_a_new_project_is_complete(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    folder = write_project("my-own", kind)
    assert [path.name for path in tmp_path.iterdir()] == [folder.name] == [f"porocore-{kind}-my-own"]
    texts = {str(p.relative_to(folder)): p.read_text("utf-8") for p in folder.rglob("*") if p.is_file()}
    package = folder.name.replace("-", "_")
    assert set(texts) == {
        *("pyproject.toml", "README.md", "LICENSE", ".gitignore", ".github/workflows/test.yml"),
        *(
            f"{package}/{name}.py"
            for name in ("__init__", "hooks", KIND[kind].replace(" ", "_"), "conformance")
        ),
        "tests/test_conformance.py",
    }
    for name, text in texts.items():
        # The workflow's own variables stay as they are.
        assert not re.search(r"\$\{\w", text), name
        assert text.endswith("\n"), name
        if name.endswith(".py"):
            ast.parse(text)
    project = tomllib.loads(texts["pyproject.toml"])["project"]
    assert project["name"] == folder.name
    assert list(project["entry-points"]["porocore"].values()) == [f"{package}.hooks"]
    assert "python-version: ${{ matrix.python }}" in texts[".github/workflows/test.yml"]


def test_new_projects_pass_a_strangers_linter(tmp_path):
    ruff = Path(sys.executable).with_name("ruff")
    if not ruff.exists():
        pytest.skip("ruff is not installed")
    words = ["check", "--isolated", "--select", "E,F,I,UP,B", "--line-length", "120", "."]
    for kind in KIND:
        folder = write_project("my-own", kind, tmp_path / kind)
        done = subprocess.run([ruff, *words], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_new_projects_pass_strict_mypy(tmp_path):
    """By the settings of their own, against the types of the installed porocore."""
    pytest.importorskip("mypy")
    folders = [write_project("my-own", kind, tmp_path / kind) for kind in KIND]
    packages = [word for kind in KIND for word in ("-p", f"porocore_{kind}_my_own")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", tmp_path / "cache", *packages],
        env=os.environ | {"MYPYPATH": os.pathsep.join(map(str, folders))},
        cwd=folders[0],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_the_plugin_of_the_page_is_the_example():
    """docs/plugin-tutorial.md shows the files of the sampler as they are."""
    page = (ROOT / "docs/plugin-tutorial.md").read_text(encoding="utf-8")
    (project,) = [path for path in EXAMPLES if path.name == "porocore-sampler-halton"]
    for name in (
        "pyproject.toml",
        *(f"porocore_sampler_halton/{n}.py" for n in ("hooks", "sampler", "conformance")),
    ):
        language = "toml" if name.endswith("toml") else "python"
        assert f"```{language}\n{(project / name).read_text(encoding='utf-8')}```" in page, name


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("My-Own", "cell", r"NAME: expected small letters, .* such as my-cell; got 'My-Own'"),
        ("../my", "cell", "NAME: expected"),
        ("my--own", "cell", "NAME: expected"),
        ("x" * 41, "cell", "at most 40"),
        ("sobol", "sampler", "there is a sampler 'sobol' already, of porocore .*; choose another name"),
        ("jax", "surrogate", "there is a surrogate 'jax' already"),
        ("my-own", "solver", "--kind: expected cell, macro, surrogate, sampler, command, got 'solver'"),
    ],
)
def test_names_and_kinds_of_no_use_are_refused(tmp_path, name, kind, message):
    with pytest.raises(ConfigurationError, match=message):
        write_project(name, kind, tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_overwritten(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "kept").touch()
    with pytest.raises(ConfigurationError, match="mine is there already and is not overwritten"):
        write_project("my-own", "sampler", tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["kept"]
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=r"file is a file, not a folder; choose another --to"):
        write_project("my-own", "sampler", tmp_path / "file" / "new")


# ---- check ----------------------------------------------------------------------------------------


def test_new_and_check_by_the_command(site):
    out, err = porocore(site, "plugin", "new", "my-own", "--kind", "sampler")
    assert out.strip() == "porocore-sampler-my-own"
    assert "next: pip install -e 'porocore-sampler-my-own[test]', then porocore plugin check my-own" in err
    install(site / "porocore-sampler-my-own", site)
    (row,) = [r for r in json.loads(porocore(site, "plugins", "--json")[0]) if r["name"] == "my-own"]
    assert (row["distribution"], row["version"]) == ("porocore-sampler-my-own", "0.1.0")
    assert (row["kind"], row["interface"], row["state"], row["works"]) == ("sampler", 1, "ready", True)
    assert row["requirements"] == [f"porocore>={version('porocore')}", "numpy>=1.26"]
    assert row["modules"] == ["numpy"]
    out, _ = porocore(site, "plugin", "check", "my-own")
    assert re.search(r"any number of inputs \[three inputs\] +│ passed", out)
    assert out.splitlines()[-1] == "19 checks: 18 passed, 1 skipped"
    out, _ = porocore(site, "plugin", "check", "my-own", "--only", "it is deterministic")
    assert out.splitlines()[-1] == "1 check: 1 passed"
    _, err = porocore(site, "plugin", "check", "my-own", "--only", "test_its_deterministic", status=2)
    assert "--only: there is no check 'its deterministic'; did you mean 'it is deterministic'" in err


def test_a_failed_check_is_listed_and_ends_with_status_1(site):
    project = write_project("my-own", "sampler", site / "project")
    install(project, site)
    code = project / "porocore_sampler_my_own" / "sampler.py"
    code.write_text(code.read_text("utf-8").replace("self._told == self._count", "self._told > 3"), "utf-8")
    suite = code.with_name("conformance.py")
    suite.write_text(
        suite.read_text("utf-8").replace(
            "    budget = 16\n",
            '    budget = 9\n    expected_failures = {"test_it_keeps_to_its_budget": "it is a grid"}\n',
        ),
        "utf-8",
    )
    document = json.loads(porocore(site, "plugin", "check", "my-own", "--json", status=1)[0])
    found = {each["law"]: each for each in document["laws"]}
    assert found["test_it_says_when_it_is_done"]["result"] == "failed"
    assert "it was done while" in found["test_it_says_when_it_is_done"]["reason"]
    assert found["test_it_keeps_to_its_budget"]["result"] == "expected failure"
    assert found["test_it_keeps_to_its_budget"]["reason"] == "it is a grid"
    assert found["test_requests_are_what_they_should_be"]["result"] == "passed"


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        pytest.param(
            *(
                "sampler",
                "def ask(self)",
                "def asks(self)",
                r"does not implement ask \(.*/porocore_sampler_my_own/hooks\.py\); report this to its authors$",
            ),
            marks=pytest.mark.slow,
        ),
        ("conformance", "SamplerSuite)", "object)", "expected suites of porocore.testing, got"),
        pytest.param(
            *("conformance", "Any, ClassVar", "Any, Nothing", "cannot be loaded: ImportError"),
            marks=pytest.mark.slow,
        ),
        (
            "sampler",
            "ready, self._ready = self._ready, []",
            "__import__('os')._exit(7)",
            "with exit status 7",
        ),
        pytest.param(
            *("hooks", '"sampler": 1', '"sampler": 7', "made for version 7 of the sampler interface, newer"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_cannot_be_checked_is_one_message(site, file, old, new, message):
    project = write_project("my-own", "sampler", site / "project")
    install(project, site)
    code = project / "porocore_sampler_my_own" / f"{file}.py"
    text = code.read_text("utf-8")
    assert old in text
    code.write_text(text.replace(old, new), "utf-8")
    _, err = porocore(site, "plugin", "check", "my-own", "--kind", "sampler", status=2)
    assert re.search(message, err.splitlines()[-1])
    assert "Traceback" not in err


def test_unknown_names_are_told(site):
    _, err = porocore(site, "plugin", "check", "my-own", status=2)
    assert "expected the name of an installed plugin, got 'my-own'; there are active, calibrate" in err
    _, err = porocore(site, "plugin", "check", "sobol", "--kind", "colour", status=2)
    assert "--kind: expected cell, macro, surrogate, sampler, command, got 'colour'" in err


# ---- as a stranger would --------------------------------------------------------------------------


@pytest.mark.parametrize("project", EXAMPLES, ids=lambda path: path.name)
def test_an_example_plugin_passes_its_tests(project):
    """Those of its own folder, with nothing of this repository but the installed porocore."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "pyproject.toml", "tests"],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([".", os.environ.get("PYTHONPATH", "")]),
            "OMP_NUM_THREADS": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
        },
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_there_are_examples_of_three_kinds():
    assert [path.name.split("-")[1] for path in EXAMPLES] == ["cell", "sampler", "surrogate"]


def pip_install(site, *projects):
    words = ["install", "--no-deps", "--no-build-isolation", "--no-index", "--target", site, *projects]
    subprocess.run([sys.executable, "-m", "pip", "-q", *words], capture_output=True, check=True)


@pytest.mark.slow
def test_new_projects_work_in_a_study(tmp_path, site):
    """All four in one: cell and sampler sample, the surrogate learns, and the macro solver solves."""
    import yaml

    from tests.e2e.study import STUDY

    pip_install(site, *(write_project("my-own", kind, tmp_path / kind) for kind in KIND))
    inputs = {"p": {"range": [-0.02, 0.06]}, "H22": {"range": [-0.1, 0.02]}}
    study = STUDY | {
        "fem": {"backend": "my-own"},
        "sampling": {"sampler": "my-own", "inputs": inputs, "workers": 1, "test": {"count": 4, "seed": 7}},
        "surrogate": {"backend": "my-own", "seed": 7},
    }
    (site / "my.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
    porocore(site, "run", "my.yaml", "--out", "run")
    assert (site / "run" / "report.html").is_file()
    assert len(list((site / "run" / "solutions").glob("*.h5"))) == 4


@pytest.mark.slow
def test_a_class_that_cannot_be_imported_is_seen_where_it_is_loaded(site):
    project = write_project("my-own", "sampler", site / "project")
    install(project, site)
    (project / "porocore_sampler_my_own" / "sampler.py").write_text("import no_such_module\n", "utf-8")
    for words, state in (((), "ready"), (("--load",), "broken")):
        rows = json.loads(porocore(site, "plugins", "--json", *words)[0])
        (row,) = [row for row in rows if row["name"] == "my-own"]
        assert row["state"] == state
        assert row["works"] == (state == "ready")
    assert "cannot be loaded: ModuleNotFoundError: No module named 'no_such_module'" in row["advice"]
