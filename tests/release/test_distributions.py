"""What is in the sdists and wheels: all that is needed, and nothing else."""

import configparser
import email
import re
import subprocess
import sys
import tarfile
import zipfile
from email.message import Message
from pathlib import Path

import pytest
import yaml

from porocore.plugins.kinds import FIRST_PARTY, OWN_HOOKS
from tests.release.environments import Environment, link_libraries

ROOT = Path(__file__).parents[2]
FOLDERS = {
    "porocore": ROOT,
    **{
        f"porocore_{folder.name}": folder
        for folder in sorted((ROOT / "plugins").iterdir())
        if folder.is_dir()
    },
}
READY = {(kind, name) for name, (_, kinds) in FIRST_PARTY.items() for kind in kinds}


@pytest.fixture(params=FOLDERS)
def name(request):
    return request.param


@pytest.fixture
def wheel(dist, name):
    (path,) = dist.glob(f"{name}-*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


@pytest.fixture
def sdist(dist, name):
    (path,) = dist.glob(f"{name}-*.tar.gz")
    with tarfile.open(path) as archive:
        yield archive


def metadata(archive: zipfile.ZipFile) -> Message:
    (path,) = [path for path in archive.namelist() if path.endswith(".dist-info/METADATA")]
    return email.message_from_string(archive.read(path).decode())


def tracked(package: Path) -> set[str]:
    """Files of a package, as the repository has them."""
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard", package.name]
    done = subprocess.run(words, cwd=package.parent, capture_output=True, text=True, check=True)
    return {path for path in done.stdout.splitlines() if (package.parent / path).is_file()}


def test_there_is_a_wheel_and_an_sdist_of_each_and_nothing_else(dist):
    found = sorted(
        re.sub(r"-\d[^-]*?(-py3-none-any)?\.(whl|tar\.gz)$", r" \2", path.name) for path in dist.iterdir()
    )
    assert found == sorted(f"{name} {kind}" for name in FOLDERS for kind in ("tar.gz", "whl"))


def test_an_index_would_take_them(dist):
    words = ["check", "--strict", *sorted(map(str, dist.iterdir()))]
    done = subprocess.run(
        [sys.executable, "-m", "twine", "--no-color", *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("PASSED") == 2 * len(FOLDERS)


def test_a_wheel_holds_its_package_and_no_more(wheel, name):
    packaged = {path for path in wheel.namelist() if ".dist-info/" not in path}
    # Data that the repository keeps in examples/.
    data = (
        {f"porocore/data/{path.name}" for path in (ROOT / "examples").glob("*.yaml")}
        if name == "porocore"
        else set()
    )
    assert packaged == tracked(FOLDERS[name] / name) | data
    assert not {"tests", "__pycache__"} & {part for path in packaged for part in Path(path).parts}


def test_the_core_is_typed_and_brings_what_it_reads(dist):
    (path,) = dist.glob("porocore-*.whl")
    with zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
        assert (
            archive.read("porocore/data/dehghani2022.yaml")
            == (ROOT / "examples/dehghani2022.yaml").read_bytes()
        )
    assert "porocore/py.typed" in names
    assert {
        "porocore/report/template.html.j2",
        "porocore/plugins/scaffold/templates/common/pyproject.toml.txt",
    } <= names


def test_metadata_say_what_the_project_says(wheel, name):
    found = metadata(wheel)
    assert found["Name"].replace("-", "_") == name
    assert found["License-Expression"] == "MIT"
    assert found["License-File"] == "LICENSE"
    assert found["Requires-Python"] == ">=3.11"
    (points,) = [path for path in wheel.namelist() if path.endswith("entry_points.txt")]
    parser = configparser.ConfigParser()
    parser.read_string(wheel.read(points).decode())
    # The hooks of the core itself are known without metadata.
    assert parser.has_section("porocore") == (name != "porocore")
    for target in parser["porocore"].values() if name != "porocore" else OWN_HOOKS:
        assert f"{target.replace('.', '/')}.py" in wheel.namelist()


def test_the_licence_comes_with_it(wheel, sdist):
    text = (ROOT / "LICENSE").read_bytes()
    (path,) = [path for path in wheel.namelist() if path.endswith("licenses/LICENSE")]
    assert wheel.read(path) == text
    (member,) = [member for member in sdist.getmembers() if member.name.endswith("/LICENSE")]
    assert sdist.extractfile(member).read() == text


def test_the_page_of_an_index_has_no_link_that_leads_nowhere(wheel, name):
    found = metadata(wheel)
    assert found["Description-Content-Type"] == "text/markdown"
    page = found.get_payload()
    for target in re.findall(r"\]\(([^)]*)\)", page):
        assert target.startswith("https://"), target
    # Only the links are gone.
    readme = (FOLDERS[name] / "README.md").read_text(encoding="utf-8")
    assert len(page) > 0.8 * len(readme)
    assert re.findall(r"^#+ .*", page, re.MULTILINE) == re.findall(r"^#+ .*", readme, re.MULTILINE)


def test_an_sdist_holds_what_builds_and_explains_it(sdist, name):
    files = {member.name.partition("/")[2] for member in sdist.getmembers() if member.isfile()}
    extra = {
        "CHANGELOG.md",
        *(f"examples/{path.name}" for path in (ROOT / "examples").iterdir() if path.is_file()),
    }
    expected = {"PKG-INFO", "README.md", "LICENSE", "pyproject.toml", ".gitignore"} | (
        extra if name == "porocore" else set()
    )
    assert files == expected | tracked(FOLDERS[name] / name)


def test_in_an_environment_without_the_checkout_every_plugin_is_ready(dist, tmp_path):
    """Plugins before the core, then one of them taken away; the libraries are those of this Python."""
    environment = Environment(tmp_path / "environment", pip=False)
    link_libraries(environment)
    plugins = [dist / path.name for path in dist.glob("porocore_*.whl")]
    offline = ("install", "-q", "--no-index", "--no-deps")
    environment.pip(*offline, *plugins)
    environment.pip(*offline, *dist.glob("porocore-*.whl"))
    before = {key: row for key, row in environment.states().items() if row != "missing dependency"}
    assert set(before.values()) == {"ready"}
    assert {name for _, name in before} >= {"skfem", "torch"}
    environment.pip("uninstall", "-q", "-y", "porocore-surrogate-torch")
    assert environment.states() == before | {("surrogate", "torch"): "not installed"}
    out, _ = environment.porocore("init", "cartilage-confined", "--to", "plug.yaml", cwd=tmp_path)
    example = (ROOT / "examples/cartilage-confined.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load((tmp_path / out.strip()).read_text("utf-8")) == yaml.safe_load(example)
