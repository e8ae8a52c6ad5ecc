"""Fragments of configurations: what a page shows of a study, put into the example that it belongs to."""

from __future__ import annotations

import copy
import re
from typing import Any

import yaml

from tests.docs.pages import ROOT, Block

#: A remark for tests above a block, which readers do not see; see :func:`role`.
_REMARK = re.compile(r"tests: (?P<role>file|in|continues)\b ?(?P<name>\S*)")
#: Sections of which a part alone says nothing: who does something, and with which options.
WHOLE = ("fem", "sampling", "surrogate")


def role(block: Block) -> tuple[str, str]:
    """What a block is, and for which file.

    ``file NAME``: the whole content of a file that the reader writes; ``in NAME``: what that file says beside the
    example's settings; ``continues``: belongs to the fragment above; empty: nothing of these.
    """
    found = _REMARK.fullmatch(block.note)
    assert found or not block.note.startswith("tests"), f"{block}: unknown remark '{block.note}'"
    return (found["role"], found["name"]) if found else ("", "")


def example() -> dict[str, Any]:
    """The configuration that fragments are part of."""
    text = (ROOT / "examples" / "dehghani2022.yaml").read_text(encoding="utf-8")
    data: dict[str, Any] = yaml.safe_load(text)
    return data


def with_fragment(base: dict[str, Any], fragment: dict[str, Any]) -> dict[str, Any]:
    """``base`` with the keys of a fragment: those below a section replace the same ones there.

    What is prescribed is replaced surface by surface.
    """
    merged = copy.deepcopy(base)
    for section, value in fragment.items():
        if isinstance(value, dict) and isinstance(merged.get(section), dict) and section not in WHOLE:
            boundary = merged[section].get("boundary", {}) | value.get("boundary", {})
            merged[section].update(value | ({"boundary": boundary} if boundary else {}))
        else:
            merged[section] = value
    if "materials" in merged.get("cell", {}):
        merged["cell"].pop("material", None)
    return merged
