"""What GitHub runs is what a developer runs, and what it names exists; that the files are valid, `make lint` says."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml

from tools.distributions import projects

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / ".github/workflows"
TEST, RELEASE = (yaml.safe_load((FOLDER / f"{name}.yml").read_text("utf-8")) for name in ("test", "release"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))


def steps(workflow: dict) -> list[dict]:
    return [step for job in workflow["jobs"].values() for step in job.get("steps", [])]


#: Commands of all steps, each with its words.
COMMANDS = [
    shlex.split(line)
    for workflow in (TEST, RELEASE)
    for step in steps(workflow)
    for line in re.split(r"\n|&&", step.get("run", ""))
    if line.strip()
]


def made(text: str) -> set[str]:
    return set(re.findall(r"^make ([a-z-]+)\b", text, re.MULTILINE))


def given(workflow: dict, action: str, key: str) -> list[str]:
    """Values of a key of all steps with an action."""
    return [step["with"][key] for step in steps(workflow) if step.get("uses", "").startswith(f"{action}@")]


def test_the_workflow_runs_everything_that_must_pass_before_a_change_lands():
    found = {name for step in steps(TEST) for name in made(step.get("run", ""))}
    assert found <= TARGETS
    assert found >= made((ROOT / ".ci/run").read_text(encoding="utf-8")) >= {"lint", "test", "dist"}


def test_the_workflow_keeps_what_the_makefile_writes():
    assert given(TEST, "actions/upload-artifact", "path") == ["dist/", "build/docs/", "build/coverage/"]
    assert "--out dist\n" in MAKEFILE
    assert " build/docs\n" in MAKEFILE
    assert "html:build/coverage\n" in MAKEFILE


def test_a_release_publishes_what_was_tested_and_nothing_else():
    kept = set(given(TEST, "actions/upload-artifact", "name"))
    assert set(given(RELEASE, "actions/download-artifact", "name")) == {"distributions", "site"} <= kept
    jobs = RELEASE["jobs"]
    assert jobs["test"]["uses"] == "./.github/workflows/test.yml"
    names = [
        tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]["name"]
        for folder in projects()
    ]
    published = jobs["publish"]["strategy"]["matrix"]["distribution"]
    assert sorted(published) == sorted(name.replace("-", "_") for name in names)


def test_nothing_is_released_before_all_tests_have_passed():
    jobs = RELEASE["jobs"]
    assert {name: job.get("needs") for name, job in jobs.items()} == {
        "check": None,
        "test": "check",
        "publish": "test",
        "github": "publish",
        "site": "publish",
    }


def test_jobs_may_no_more_than_they_must():
    assert (TEST["permissions"], RELEASE["permissions"]) == ({"contents": "read"}, {})
    assert not [name for name, job in TEST["jobs"].items() if "permissions" in job]
    assert {name: job["permissions"] for name, job in RELEASE["jobs"].items()} == {
        "check": {"contents": "read"},
        "test": {"contents": "read"},
        "publish": {"id-token": "write"},
        "github": {"contents": "write"},
        "site": {"pages": "write", "id-token": "write"},
    }
    # No credentials of git are left for the commands that follow.
    for workflow in (TEST, RELEASE):
        assert not any(given(workflow, "actions/checkout", "persist-credentials"))


def test_an_action_is_pinned_to_one_commit_with_its_version():
    text = "".join((FOLDER / f"{name}.yml").read_text("utf-8") for name in ("test", "release"))
    used = {line for line in re.findall(r"uses: (\S.*)", text) if not line.startswith("./")}
    pins = [re.fullmatch(r"([\w./-]+)@[0-9a-f]{40}  # v[\d.]+", line) for line in used]
    assert all(pins), used
    assert len({pin[1] for pin in pins if pin}) == len(used), used


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_command_names_what_exists(words):
    for word in words:
        if re.match(r"(tools|tests|plugins|constraints)/|--ignore=|Containerfile$", word):
            assert (ROOT / word.removeprefix("--ignore=")).exists(), word
        if match := re.fullmatch(r"\.\[(.*)\]", word):
            project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
            assert set(match[1].split(",")) <= set(project["optional-dependencies"])
    scripts = [word for word in words if word.startswith("tools/")]
    for script in scripts:
        text = (ROOT / script).read_text("utf-8")
        assert not [w for w in words if w.startswith("--") and f'"{w}"' not in text]
