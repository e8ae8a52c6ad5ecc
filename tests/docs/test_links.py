"""Links between the pages lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, name_of


def anchors(path: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", PAGES, ids=name_of)
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
    assert {
        "README.md",
        "CONTRIBUTING.md",
        "docs/configuration.md",
        "docs/cell.md",
        "docs/plugins.md",
        "docs/benchmark.md",
        "plugins/surrogate_torch/README.md",
        "examples/plugins/porocore-sampler-halton/README.md",
    } <= set(map(name_of, PAGES))
