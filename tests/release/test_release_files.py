"""What belongs to a release beside its distributions: versions in step, its notes, the recipe for conda, the image."""

import hashlib
import re
import shutil
import tomllib
from pathlib import Path

import pytest
import yaml

from tools.distributions import projects
from tools.release import NO_HASH, faults, recipe, top_section, versions

ROOT = Path(__file__).parents[2]
PROJECTS = {
    project["name"]: project
    for project in (
        tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"] for folder in projects()
    )
}
VERSION = PROJECTS["porocore"]["version"]
# Texts throughout: a hash of digits is no number.
RECIPE = yaml.load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"), yaml.BaseLoader)
OUTPUTS = {output["package"]["name"]: output for output in RECIPE["outputs"]}
#: Names on conda-forge of packages that pip knows by another one.
ON_CONDA = {
    "gmsh": "python-gmsh",
    "matplotlib": "matplotlib-base",
    "torch": "pytorch",
    "typing-extensions": "typing_extensions",
}
#: What pip does not have.
BESIDE = {"porocore-fem-dolfinx": {"fenics-dolfinx >=0.5", "petsc4py"}}


@pytest.fixture
def copy(tmp_path):
    """A copy of the files that state a version, as a release has them."""
    for file in versions():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, tmp_path / file)
    changelog = tmp_path / "CHANGELOG.md"
    text = changelog.read_text("utf-8").replace(
        f"## {VERSION} (not released)", f"## {VERSION} (2027-01-31)", 1
    )
    changelog.write_text(text, "utf-8")
    return tmp_path


def test_all_files_of_this_checkout_state_one_version():
    assert faults(None) == []
    assert len(versions()) == len(PROJECTS) + 3


def test_a_release_has_its_tag_and_a_date(copy):
    assert faults(f"v{VERSION}", copy) == []
    assert faults(VERSION, copy) == [f"tag {VERSION}: expected v{VERSION}"]
    assert len(faults("v9.9.9", copy)) == len(versions())
    changelog = copy / "CHANGELOG.md"
    changelog.write_text(changelog.read_text("utf-8").replace("(2027-01-31)", "(not released)", 1), "utf-8")
    (fault,) = faults(f"v{VERSION}", copy)
    assert "the day of the release" in fault
    assert faults(None, copy) == []


@pytest.mark.parametrize("file", versions())
def test_a_file_of_another_version_is_named(copy, file):
    path = copy / file
    path.write_text(path.read_text("utf-8").replace(VERSION, "7.6.5", 1), "utf-8")
    if file == "pyproject.toml":
        assert f"{file}: version 7.6.5, expected {VERSION}" in faults(f"v{VERSION}", copy)
    else:
        assert faults(None, copy) == [f"{file}: version 7.6.5, expected {VERSION}"]


def test_notes_are_the_top_section_of_the_changelog(copy):
    text = (
        "# Changelog\n\n## 0.2.0 (2027-02-01)\n\n### Added\n\n- This.\n\n## 0.1.0 (2027-01-31)\n\n- That.\n"
    )
    (copy / "CHANGELOG.md").write_text(text, "utf-8")
    assert top_section(copy) == ("0.2.0 (2027-02-01)", "### Added\n\n- This.\n")


def test_notes_that_github_does_not_take_are_refused(copy):
    (copy / "CHANGELOG.md").write_text(
        f"# Changelog\n\n## {VERSION} (2027-01-31)\n\n{'x' * 130_000}\n", "utf-8"
    )
    (fault,) = faults(f"v{VERSION}", copy)
    assert "130001 characters" in fault


def on_conda(requirement: str) -> str:
    """A requirement of pip as conda writes it, with the version of this release as the recipe has it."""
    name, bound = re.fullmatch(r"([\w-]+)(>=[\d.]+)", requirement.partition(";")[0].strip()).groups()
    bound = ">=${{ version }}" if name == "porocore" else bound
    return f"{ON_CONDA.get(name, name)} {bound}"


@pytest.mark.parametrize("name", PROJECTS)
def test_the_recipe_needs_what_the_distribution_needs(name):
    """What pip installs on some platforms only is no requirement of a package for all of them, but bounded."""
    project, needs = PROJECTS[name], OUTPUTS[name]["requirements"]
    everywhere = {on_conda(text) for text in project["dependencies"] if ";" not in text}
    expected = everywhere | BESIDE.get(name, set()) | {"python >=${{ python_min }}"}
    assert set(needs["run"]) == expected, "packaging/conda/recipe.yaml follows pyproject.toml"
    elsewhere = [on_conda(text) for text in project["dependencies"] if ";" in text]
    assert needs.get("run_constraints", []) == elsewhere


def test_the_recipe_has_an_output_for_each_distribution():
    assert set(OUTPUTS) == set(PROJECTS)
    assert PROJECTS["porocore"]["requires-python"] == f">={RECIPE['context']['python_min']}"
    (script,) = OUTPUTS["porocore"]["build"]["python"]["entry_points"]
    assert script == " = ".join(*PROJECTS["porocore"]["scripts"].items())
    build = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["build-system"]["requires"]
    for name, output in OUTPUTS.items():
        host = {"python ${{ python_min }}.*", "pip", *map(on_conda, build)}
        assert set(output["requirements"]["host"]) == host
        assert output["about"]["summary"] == PROJECTS[name]["description"]
        assert output["tests"][0]["python"]["imports"] == [name.replace("-", "_")]
        assert output["source"]["sha256"] == NO_HASH


@pytest.mark.parametrize("place", [None, "https://example.org/v1"])
def test_the_recipe_of_a_release_has_the_places_and_hashes_of_its_sdists(dist, place):
    outputs = yaml.load(recipe(dist, place), yaml.BaseLoader)["outputs"]
    for output in outputs:
        source, file = output["source"], f"{output['package']['name'].replace('-', '_')}-{VERSION}.tar.gz"
        assert source["sha256"] == hashlib.sha256((dist / file).read_bytes()).hexdigest()
        assert source["url"].replace("${{ version }}", VERSION) == f"{place or dist.as_uri()}/{file}"


def test_the_image_has_the_packages_of_the_system_that_an_installation_takes():
    text = (ROOT / "Containerfile").read_text("utf-8").replace("\\\n", " ")
    setup = (ROOT / "tools/setup.sh").read_text("utf-8")
    taken = {
        word
        for name in ("dolfinx_packages", "library_packages")
        for word in re.search(rf'^{name}="(.*)"', setup, re.MULTILINE)[1].split()
    }
    (base, pip) = re.findall(r"apt-get install -y --no-install-recommends ([^&]*)", text)
    assert set(base.split()) == taken | {"python3-torch"}
    assert pip.split() == ["python3-pip"]


def test_the_image_takes_what_exists_and_its_context_lets_in():
    text = (ROOT / "Containerfile").read_text("utf-8").replace("\\\n", " ")
    copied = {
        word for line in re.findall(r"^COPY (?!--from)(.*) \S+$", text, re.MULTILINE) for word in line.split()
    }
    ignore = (ROOT / ".containerignore").read_text("utf-8")
    assert {line[1:] for line in ignore.splitlines() if line.startswith("!")} == copied
    installed = re.findall(r"\./(plugins/\w+)|-c (\S+)", text)
    for path in {*copied, *(a or b for a, b in installed)}:
        assert (ROOT / path).exists(), path
