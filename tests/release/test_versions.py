"""The distributions are released together: one version, and lower bounds that say so."""

import re
import tomllib
from pathlib import Path

import pytest

import porocore
from porocore.plugins.kinds import FIRST_PARTY

ROOT = Path(__file__).parents[2]
FILES = [ROOT / "pyproject.toml", *sorted((ROOT / "plugins").glob("*/pyproject.toml"))]
PROJECTS = {
    project["name"]: project
    for project in (tomllib.loads(path.read_text(encoding="utf-8"))["project"] for path in FILES)
}
(CORE, *PLUGINS) = PROJECTS.values()
VERSION = CORE["version"]


def test_these_are_the_distributions_that_the_core_knows():
    assert {project["name"] for project in PLUGINS} == {name for name, _ in FIRST_PARTY.values()}


@pytest.mark.parametrize("name", PROJECTS)
def test_versions_are_in_step(name):
    assert PROJECTS[name]["version"] == VERSION
    assert re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?(\.dev\d+)?", VERSION)


@pytest.mark.parametrize("project", PLUGINS, ids=lambda project: project["name"])
def test_a_plugin_needs_the_core_of_its_own_release_at_least(project):
    """No upper bound: a core with another interface says so in words, and pip would only hold back what works."""
    assert [text for text in project["dependencies"] if text.startswith("porocore")] == [
        f"porocore>={VERSION}"
    ]


def test_each_plugin_has_an_extra_and_all_has_every_one():
    extras = CORE["optional-dependencies"]
    for name, (distribution, _) in FIRST_PARTY.items():
        assert extras[name] == [f"{distribution}>={VERSION}"]
    (everything,) = extras["all"]
    assert sorted(re.findall(r"\w+", everything)) == sorted(["porocore", *FIRST_PARTY])
    assert extras["default"] == ["porocore[skfem,torch]"]


@pytest.mark.parametrize("name", PROJECTS)
def test_bounds_are_lower_ones(name):
    project = PROJECTS[name]
    texts = [
        *project["dependencies"],
        *(t for e in project.get("optional-dependencies", {}).values() for t in e),
    ]
    for text in texts:
        requirement = text.partition(";")[0].strip()
        if not requirement.startswith(("porocore[", "types-")):
            assert re.fullmatch(r"[A-Za-z0-9-]+>=[\d.]+", requirement), f"{name}: {text}"


def test_what_is_installed_here_is_this_version():
    assert porocore.__version__ == VERSION, "install again: make test"
