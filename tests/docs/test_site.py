"""The documentation site: it is built without a warning, and its reference has every public name and command."""

from __future__ import annotations

import html
import os
import re
import subprocess
import sys
from importlib.util import find_spec

import pytest

import porocore
import porocore.testing
from porocore.cli.entry import whole_program
from tests.docs.pages import ROOT


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


def test_the_site_opens_at_the_front_page(site):
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

    check(whole_program(), ["porocore"])


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
    assert page.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">') > 10
    shown = re.sub(r"<(script|math).*?</\1>", "", page, flags=re.DOTALL)
    assert "$$" not in shown
    assert "\\mathrm" not in shown


def test_nothing_is_fetched_from_a_network(site):
    """What a browser loads without being asked; a link that a reader follows may lead anywhere."""
    for path in [*site.rglob("*.html"), *site.rglob("*.css")]:
        assert not list(fetched(path.read_text(encoding="utf-8"))), path
    scripts = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.js"))
    assert not re.search(r"\b(import|fetch|importScripts)\(\s*[\"'](https?:)?//", scripts)


def fetched(text):
    """Addresses on other machines that a page or a style sheet loads."""
    tags = re.findall(r"<(?:script|img|iframe|source|video|audio|embed|link)\b[^>]*>", text)
    loaded = [
        address for tag in tags for address in re.findall(r"\b(?:src|srcset|href|data)=\"([^\"]*)\"", tag)
    ]
    loaded += re.findall(r"(?:@import\s+|url\()\s*[\"']?([^\"')\s]+)", text)
    return (address for address in loaded if re.match(r"(?:https?:)?//", address))


def test_an_address_on_another_machine_is_found():
    seen = '<script defer src="https://cdn.example.org/a.js"></script> @import "//fonts.example.org/b"; url(c.png)'
    assert list(fetched(seen)) == ["https://cdn.example.org/a.js", "//fonts.example.org/b"]


def test_the_notebook_is_a_page_with_its_outputs(site):
    page = (site / "docs/notebook.html").read_text(encoding="utf-8")
    assert "<h1>A first study in a notebook" in page
    assert 'src="data:image/png;base64,' in page
    assert "settlement 0.0" in text_of(site, "docs/notebook.html")


def test_the_front_page_says_what_it_is_for_and_what_it_cannot_do(site):
    page = (site / "docs/index.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h2>(.*?)<a", page)
    assert headings[:4] == ["What it is for", "What it cannot do", "How to get it", "How to cite"]
    pictures = re.findall(r'<img[^>]*src="([^"]+)"', page)
    assert sum("example-" in picture for picture in pictures) >= 3
    assert all((site / "docs" / picture).is_file() for picture in pictures)


def test_every_check_of_the_kit_is_in_the_reference(site):
    text = text_of(site, "docs/reference/testing.html")
    suites = [getattr(porocore.testing, name) for name in porocore.testing.__all__ if name.endswith("Suite")]
    checks = {check for suite in suites for check in dir(suite) if check.startswith("test_")} - set(
        dir(porocore.testing.Suite)
    )
    assert len(checks) > 80
    assert not {check for check in checks if check.removeprefix("test_").replace("_", " ") not in text}
