"""The notebook of the documentation runs, and the outputs that are stored in it are those that it prints."""

from __future__ import annotations

import json
import re

import make_notebook
import pytest

from tests.docs.pages import name_of

NOTEBOOK = json.loads(make_notebook.NOTEBOOK.read_text(encoding="utf-8"))
CODE = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
NUMBER = re.compile(r"-?\d+\.\d+")


def printed(cell):
    return "".join("".join(o["text"]) for o in cell["outputs"] if o["output_type"] == "stream")


def pictures(cell):
    return [o for o in cell["outputs"] if "image/png" in o.get("data", {})]


def test_the_notebook_runs_and_prints_what_is_stored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for stored, now in zip(CODE, make_notebook.executed(NOTEBOOK), strict=True):
        assert NUMBER.sub("#", printed(now)) == NUMBER.sub("#", printed(stored))
        numbers = [[float(x) for x in NUMBER.findall(printed(cell))] for cell in (now, stored)]
        assert numbers[0] == pytest.approx(numbers[1], rel=5e-3)
        assert len(pictures(now)) == len(pictures(stored))
    assert (tmp_path / "runs/notebook/run.json").is_file()


def test_the_notebook_is_short_and_stored_with_its_outputs():
    assert sum(len(cell["source"]) for cell in CODE) < 60
    assert [cell["execution_count"] for cell in CODE] == list(range(1, len(CODE) + 1))
    assert all(printed(cell) for cell in CODE[:-1])
    assert pictures(CODE[-1])


def test_the_notebook_needs_porocore_and_matplotlib_alone():
    source = "".join("".join(cell["source"]) + "\n" for cell in CODE)
    assert set(re.findall(r"^(?:import|from) (\w+)", source, flags=re.MULTILINE)) == {
        "porocore",
        "matplotlib",
    }
    assert "torch" not in source


def test_its_links_lead_somewhere():
    text = "".join("".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "markdown")
    targets = [target.partition("#")[0] for target in re.findall(r"\]\(([^)]+)\)", text)]
    assert targets
    assert all((make_notebook.NOTEBOOK.parent / target).exists() for target in targets)
    assert name_of(make_notebook.NOTEBOOK) == "docs/notebook.ipynb"
