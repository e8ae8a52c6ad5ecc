"""Makes what autodoc shows of porocore's classes readable."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy
import numpy.typing
from docutils import nodes
from sphinx.domains.python import PyObject


class _NDArray:
    """``ndarray`` in signatures, in place of ``ndarray[tuple[Any, ...], dtype[float64]]``."""

    def __class_getitem__(cls, scalar: Any) -> type[numpy.ndarray]:
        return numpy.ndarray


class ArrayLike:
    """Under its name in signatures, in place of all that it may be."""


# Before porocore is imported for the first time.
numpy.typing.NDArray = _NDArray
numpy.typing.ArrayLike = ArrayLike
ArrayLike.__module__ = "numpy.typing"


def process_docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """What napoleon would misread.

    The first colon of an attribute's description is no end of a type, and ``a, b`` before a description are two names.
    """
    if what in ("attribute", "data", "property") and lines:
        lines[0] = f": {lines[0]}"
    lines[:] = _one_name_each(lines)


def _one_name_each(lines: list[str]) -> Iterator[str]:
    listing = False
    for i, line in enumerate(lines):
        following = lines[i + 1] if i + 1 < len(lines) else ""
        if re.fullmatch(r"-{3,}", following.strip()):
            listing = line.strip() == "Attributes"
        names, colon, kind = line.partition(" : ")
        if listing and re.fullmatch(r"\w+(, \w+)+", names) and following.startswith(" "):
            end = next((j for j in range(i + 1, len(lines)) if not lines[j].startswith(" ")), len(lines))
            *first, last = names.split(", ")
            for name in first:
                yield f"{name}{colon}{kind}"
                yield from lines[i + 1 : end]
            line = f"{last}{colon}{kind}"
        yield line


def process_signature(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, None] | None:
    """No signature for settings: what they take are the keys of the configuration, which its page explains."""
    from pydantic import BaseModel

    if what == "class" and isinstance(obj, type) and issubclass(obj, BaseModel):
        return "", None
    return None


def draw_dashes(app: Any, doctree: nodes.document) -> None:
    """Between a name and its description; nowhere else, so that ``--resume`` stays what it is."""
    for text in [node for node in doctree.findall(nodes.Text) if re.match(r"\)? -- ", node.astext())]:
        if text.parent.index(text) > 0:
            text.parent.replace(text, nodes.Text(text.astext().replace(" -- ", " – ", 1)))


def setup(app: Any) -> dict[str, Any]:
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    # Before napoleon, whose priority is 500.
    app.connect("autodoc-process-docstring", process_docstring, priority=400)
    app.connect("autodoc-process-signature", process_signature)
    app.connect("doctree-read", draw_dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
