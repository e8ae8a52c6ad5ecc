"""The documentation site: it is built without a warning, and its reference has every public name and command."""

from __future__ import annotations

import html
import os
import re
import subprocess
import sys
from importlib.util import find_spec

import pytest
import typer
from pages import ROOT

import porocore
import porocore.testing
from porocore.cli.entry import app


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site."""
    if find_spec("sphinx") is None and not os.environ.get("CI"):
        pytest.skip("Sphinx is not installed: pip install -e '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    words = ["-m", "sphinx", "-q", "-W", "--keep-going", "-c", "docs", "-b", "html", ".", str(folder)]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def text_of(site, name):
    """What a reader sees of a page."""
    text = re.sub(r"<[^>]+>", "", (site / name).read_text(encoding="utf-8"))
    return re.sub(r"\s+", " ", html.unescape(text))


def test_it_opens_at_the_front_page(site):
    (address,) = re.findall(r"url=([^\"]+)", (site / "index.html").read_text(encoding="utf-8"))
    assert "porocore" in (site / address).read_text(encoding="utf-8")


def test_every_public_name_is_in_the_reference(site):
    pages = "".join(path.read_text(encoding="utf-8") for path in (site / "docs/reference").glob("*.html"))
    documented = set(re.findall(r'<dt class="sig sig-object py" id="([\w.]+)"', pages))
    assert {f"porocore.{name}" for name in porocore.__all__} <= documented
    assert {f"porocore.testing.{name}" for name in porocore.testing.__all__} <= documented


def test_every_command_and_option_is_in_the_reference(site):
    text = text_of(site, "docs/reference/commands.html")

    def check(command, words):
        for name, below in getattr(command, "commands", {}).items():
            check(below, [*words, name])
        if not getattr(command, "commands", {}):
            assert f"{' '.join(words)} [OPTIONS]" in text
            for parameter in command.params:
                assert all(spelling in text for spelling in parameter.opts if spelling.startswith("-"))

    check(typer.main.get_command(app), ["porocore"])


def test_links_to_files_lead_to_the_files(site):
    """A link to a file that is no page, such as an example, hands out a copy of it."""
    links = re.findall(
        r'href="([^"]+cartilage-confined\.yaml)"', (site / "docs/bodies.html").read_text("utf-8")
    )
    (link,) = set(links)
    copied = (site / "docs" / link).resolve()
    assert copied.read_bytes() == (ROOT / "examples/cartilage-confined.yaml").read_bytes()


def test_equations_and_tables_are_rendered(site):
    page = (site / "docs/theory.html").read_text(encoding="utf-8")
    assert page.count('class="math notranslate') > 10
    assert "$$" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_every_law_of_the_kit_is_in_the_reference(site):
    text = text_of(site, "docs/reference/testing.html")
    suites = [getattr(porocore.testing, name) for name in porocore.testing.__all__ if name.endswith("Suite")]
    laws = {law for suite in suites for law in dir(suite) if law.startswith("test_")} - set(
        dir(porocore.testing.Suite)
    )
    assert len(laws) > 80
    assert not {law for law in laws if law.removeprefix("test_").replace("_", " ") not in text}
