"""The folder of the built site opens at its front page, although that is one of the pages in docs/."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_PAGE = """<!doctype html>
<html lang="en">
  <head>
    <meta charset="utf-8">
    <title>{title}</title>
    <meta http-equiv="refresh" content="0; url={address}">
  </head>
  <body><a href="{address}">{title}</a></body>
</html>
"""


def write_front_page(app: Any, failure: Exception | None) -> None:
    """Write ``index.html``, which leads to the root document."""
    if failure is None and app.builder.name == "html":
        address = app.builder.get_target_uri(app.config.root_doc)
        text = _PAGE.format(title=app.config.project, address=address)
        (Path(app.outdir) / "index.html").write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, Any]:
    app.connect("build-finished", write_front_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
