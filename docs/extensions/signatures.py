"""Makes what autodoc shows of porocore's classes readable."""

from __future__ import annotations

from typing import Any

import numpy
from sphinx.domains.python import PyObject

import porocore.states

# A name for signatures, in place of ndarray[tuple[Any, ...], dtype[float64]].
porocore.states.Array = porocore.states.IntArray = numpy.ndarray


def process_docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep the colons of an attribute's description, of which napoleon would take the first for the end of a type."""
    if what in ("attribute", "data", "property") and lines:
        lines[0] = f": {lines[0]}"


def process_signature(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, None] | None:
    """No signature for settings: what they take are the keys of the configuration, which its page explains."""
    from pydantic import BaseModel

    if what == "class" and isinstance(obj, type) and issubclass(obj, BaseModel):
        return "", None
    return None


def setup(app: Any) -> dict[str, Any]:
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    # Before napoleon, whose priority is 500.
    app.connect("autodoc-process-docstring", process_docstring, priority=400)
    app.connect("autodoc-process-signature", process_signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
