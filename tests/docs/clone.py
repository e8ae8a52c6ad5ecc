"""A folder that looks to the commands of a page as a clone of the repository does, after its set-up."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from tests.docs.pages import ROOT

_CACHES = shutil.ignore_patterns("__pycache__", "*.egg-info", "images", "_build", ".pytest_cache")
_PORO = """#!{python}
import os, sys
sys.path.insert(0, {here!r})
import pytest
from tests.docs.coarse import begin, make_coarse
make_coarse(pytest.MonkeyPatch())
begin(sys.argv[1] if len(sys.argv) > 1 else "")
from porocore.cli import main
main()
"""
#: Python reads this at its start; it makes the projects that are installed for editing importable.
_STARTUP = "import site\nsite.addsitedir({site!r})\n"


class Clone:
    """Its folder, ``bin`` with a porocore whose studies are coarse, and ``site``, into which plugins are installed."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.bin, self.site = folder / "porocore", folder / "bin", folder / "site"
        for made in (self.folder, self.bin, self.site):
            made.mkdir(parents=True)
        for name in ("examples", "benchmarks", "docs"):
            shutil.copytree(ROOT / name, self.folder / name, ignore=_CACHES)
        (self.folder / "docs" / "images").mkdir()
        (self.folder / ".venv").symlink_to(sys.prefix)
        (self.site / "sitecustomize.py").write_text(_STARTUP.format(site=str(self.site)), encoding="utf-8")
        command = self.bin / "porocore"
        command.write_text(_PORO.format(python=sys.executable, here=str(ROOT)), encoding="utf-8")
        command.chmod(0o755)

    def place(self, page: str) -> Path:
        """Where the commands of a page are given: a plugin's README is read in the plugin's folder."""
        folder = self.folder / page
        return folder.parent if page.startswith("examples/") else self.folder
