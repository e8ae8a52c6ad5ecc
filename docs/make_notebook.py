"""The notebook with its outputs: what its cells print and draw, as Jupyter stores it.

.venv/bin/python docs/make_notebook.py
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).parent / "notebook.ipynb"


def executed(notebook: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Execute the cells of code in the current folder, as one program, and give each with its outputs."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    names: dict[str, Any] = {}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, 1):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile("".join(cell["source"]), f"<{cell['id']}>", "exec"), names)
        outputs = [_text(said.getvalue())] if said.getvalue() else []
        outputs += [_picture(plt.figure(number)) for number in plt.get_fignums()]
        plt.close("all")
        yield cell | {"execution_count": count, "outputs": outputs}


def _text(said: str) -> dict[str, Any]:
    return {"name": "stdout", "output_type": "stream", "text": said.splitlines(keepends=True)}


def _picture(figure: Any) -> dict[str, Any]:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100, metadata={"Software": None})
    data = {"image/png": base64.b64encode(file.getvalue()).decode(), "text/plain": ["<Figure>"]}
    return {"data": data, "metadata": {}, "output_type": "display_data"}


def main() -> None:
    """Execute docs/notebook.ipynb in an empty folder and write it back with the outputs."""
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        done = {cell["id"]: cell for cell in executed(notebook)}
    notebook["cells"] = [done.get(cell["id"], cell) for cell in notebook["cells"]]
    text = json.dumps(notebook, indent=1, ensure_ascii=False)
    NOTEBOOK.write_text(text + "\n", encoding="utf-8")
    print(NOTEBOOK)


if __name__ == "__main__":
    main()
