"""The documents say what the code does: keys, defaults, commands, links and the example plugin."""

import os
import re
import shlex
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest
import typer
import yaml

from porocore.benchmark import benchmark_path
from porocore.cli.entry import app
from porocore.config import load_config
from porocore.plugin_kinds import HOOKS
from porocore.report.words import MEANINGS
from porocore.states import Status

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("benchmarks/*.md"),
        *ROOT.glob("plugins/*/README.md"),
    ]
)


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def rows(text):
    """Cells of every table row, without the bars and the code marks."""
    for line in text.splitlines():
        if line.startswith("| "):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            yield [cell.strip() for cell in cells]


# ---- commands -----------------------------------------------------------------------------------


def commands():
    for path in PAGES:
        for block in blocks(path.read_text(encoding="utf-8"), "sh"):
            for line in block.splitlines():
                words = shlex.split(line, comments=True)
                if words:
                    yield path.relative_to(ROOT), words


PORO = [
    (str(path), " ".join(words[1:]), words[1:]) for path, words in commands() if words[0].endswith("porocore")
]


@pytest.mark.parametrize(
    "words", [words for _, _, words in PORO], ids=[f"{path}: {text}" for path, text, _ in PORO]
)
def test_a_command_that_is_shown_is_one(words):
    group = typer.main.get_command(app)
    context = group.make_context("porocore", list(words))
    name, command, rest = group.resolve_command(context, [*context._protected_args, *context.args])
    command.make_context(name, rest, parent=context)


def test_the_readme_shows_every_command():
    shown_in_readme = {words[0] for path, _, words in PORO if path == "README.md"}
    assert shown_in_readme == set(typer.main.get_command(app).commands)


def test_a_make_target_that_is_shown_is_one():
    targets = set(re.findall(r"^([a-z-]+):", page("Makefile"), flags=re.MULTILINE))
    named = {words[1] for _, words in commands() if words[0] == "make"}
    assert {"run", "test"} <= named <= targets


def test_the_readme_names_the_two_commands_first():
    first = page("README.md").splitlines()[:8]
    assert [line.split("#")[0].strip() for line in first if line.startswith("make")] == [
        "make run",
        "make test",
    ]


def test_the_readme_changes_what_is_in_the_example(tmp_path):
    (sed,) = [words for path, words in commands() if words[0] == "sed" and path.name == "README.md"]
    text = benchmark_path().read_text(encoding="utf-8")
    for old, new in re.findall(r"s/([^/]+)/([^/]+)/", sed[2]):
        assert text.count(f"{old} ") + text.count(f"{old}\n") == 1, old
        text = text.replace(old, new)
    changed = tmp_path / "my.yaml"
    changed.write_text(text, encoding="utf-8")
    cell = load_config(changed).cell
    assert (cell.geometry.radius, cell.material.poisson_ratio) == (0.22, 0.3)


# ---- links --------------------------------------------------------------------------------------


def anchors(path):
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_resolve(path):
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)]+)\)", text):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        found = (path.parent / file).resolve() if file else path
        assert found.exists(), target
        assert found == ROOT or ROOT in found.parents, target
        assert not anchor or anchor in anchors(found), target


def test_there_are_pages_to_look_at():
    names = {str(path.relative_to(ROOT)) for path in PAGES}
    assert {
        "README.md",
        "docs/configuration.md",
        "docs/cell.md",
        "docs/plugins.md",
        "docs/benchmark.md",
    } <= names


# ---- statuses and hooks ---------------------------------------------------------------------------


def test_every_status_is_explained():
    table = {cells[0].strip("`"): cells[1] for cells in rows(page("docs/cell.md")) if len(cells) == 3}
    assert {status.name for status in Status} == {status.name for status in MEANINGS}
    for status in Status:
        assert table[status.name] == ("yes" if status.has_values else "no")


def test_every_hook_is_listed():
    listed = {cells[0].strip("`") for cells in rows(page("docs/plugins.md"))}
    assert set(HOOKS.values()) <= listed


# ---- the plugin of docs/plugin-tutorial.md ----------------------------------------------------------------


@pytest.fixture
def halton(tmp_path):
    """The files of docs/plugin-tutorial.md, installed by hand; returns a function that runs Python with them."""
    text = page("docs/plugin-tutorial.md")
    project = tomllib.loads(blocks(text, "toml")[0])
    package = tmp_path / "porocore_sampler_halton"
    package.mkdir()
    (package / "__init__.py").touch()
    named = re.findall(
        r"^`porocore_sampler_halton/(\w+\.py)`.*?^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL
    )
    assert [name for name, _ in named] == ["sampler.py", "hooks.py", "conformance.py"]
    for name, code in named:
        (package / name).write_text(code, encoding="utf-8")
    name, version = project["project"]["name"], project["project"]["version"]
    info = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    points = project["project"]["entry-points"]["porocore"]
    (info / "entry_points.txt").write_text(
        "[porocore]\n" + "".join(f"{k} = {v}\n" for k, v in points.items())
    )

    def python(*arguments):
        environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [sys.executable, *arguments],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    return python


def test_the_example_plugin_is_found(halton):
    out = halton(
        "-c", "import sys; sys.argv = ['porocore', 'plugins']; from porocore.cli import main; main()"
    )
    assert re.search(r"^sampler +halton +ready +porocore-sampler-halton 0\.1\.0", out, re.MULTILINE)


def test_the_example_plugin_samples(halton, tmp_path):
    config = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    config |= yaml.safe_load(blocks(page("docs/plugin-tutorial.md"), "yaml")[0])
    study = tmp_path / "my.yaml"
    study.write_text(yaml.safe_dump(config), encoding="utf-8")
    code = """
        import sys
        import numpy as np
        from porocore.config import load_config
        from porocore.registry import get
        from porocore import ConfigurationError

        settings = load_config("my.yaml").sampling
        make, options = get("sampler", settings.sampler), settings.sampler_options()
        samplers = [make(settings.input_space(), **options) for _ in range(2)]
        asked = [sampler.ask() for sampler in samplers]
        assert asked[0] == asked[1] and len(asked[0]) == settings.options["count"] == samplers[0].expected
        assert samplers[0].ask() == [] and not samplers[0].done
        space = settings.input_space()
        x = np.array([request.x for request in asked[0]])
        assert (x >= space.lower).all() and (x <= space.upper).all() and len(np.unique(x, axis=0)) == len(x)
        for request in reversed(asked[0]):
            samplers[0].tell(request.key, None)
        assert samplers[0].done
        try:
            type(samplers[0])(space, number=3)
        except ConfigurationError as error:
            print(error)
    """
    out = halton("-W", "ignore", "-c", textwrap.dedent(code))
    assert "unknown option 'number'" in out
