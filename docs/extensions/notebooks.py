"""Notebooks as pages: their words, their code, and the outputs that are stored in them; nothing is executed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser


def blocks(notebook: dict[str, Any]) -> Iterator[str]:
    """Return the parts of a page in Markdown, in order."""
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield source
            continue
        yield f"```python\n{source}\n```"
        for output in cell["outputs"]:
            if output["output_type"] == "stream":
                yield f"```text\n{''.join(output['text']).rstrip()}\n```"
            elif "image/png" in output.get("data", {}):
                yield f"![What the lines above draw](data:image/png;base64,{output['data']['image/png']})"


class NotebookParser(MystParser):  # type: ignore[misc]
    """Parser of .ipynb files."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        super().parse("\n\n".join(blocks(json.loads(inputstring))), document)


def setup(app: Any) -> dict[str, Any]:
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
