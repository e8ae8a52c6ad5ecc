"""The glossary has the terms that readers asked about, and pages link to them."""

import re

import pytest

from tests.docs.pages import PAGES, ROOT

GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
TERMS = {
    "closure": "Closure",
    "m-and-q": "M and Q",
    "flagged": "Flagged",
    "direct": "Direct",
    "piola-and-piola-unrotated": "Piola and piola-unrotated",
    "load": "Load",
    "column": "Column",
}


@pytest.mark.parametrize("anchor", TERMS)
def test_a_term_is_explained_and_linked(anchor):
    assert re.search(rf"^## {TERMS[anchor]}\n\n\w", GLOSSARY, flags=re.MULTILINE)
    linking = [path for path in PAGES if f"glossary.md#{anchor})" in path.read_text(encoding="utf-8")]
    assert linking
