"""Equations as MathML, which a browser draws by itself: no script, and nothing is fetched from a network."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.errors import ExtensionError


def mathml(text: str, *, block: bool) -> str:
    """Return an equation in LaTeX as MathML; ``block``: on lines of its own."""
    try:
        return tex2mathml(text, as_block=block)
    except MathError as error:
        raise ExtensionError(f"the equation {text!r} has no MathML: {error}") from error


def visit_math(translator: Any, node: nodes.math) -> None:
    """Write an equation within a sentence."""
    translator.body.append(f'<span class="math">{mathml(node.astext(), block=False)}</span>')
    raise nodes.SkipNode


def visit_math_block(translator: Any, node: nodes.math_block) -> None:
    """Write an equation between two paragraphs."""
    translator.body.append(f'<div class="math">{mathml(node.astext(), block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
