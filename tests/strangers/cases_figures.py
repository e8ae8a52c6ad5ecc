"""Settings of matplotlib that a reader has made for figures of his own."""

from __future__ import annotations

from pathlib import Path

from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import Case


def _drawn(folder: Path, ended: Ended | None) -> None:
    assert len(list((folder / "r/figures").glob("*.svg"))) >= 5


CASES = [
    Case("matplotlibrc_usetex", ("run", "base.yaml", "--out", "r"), check=_drawn, own_process=True, slow=True)
]
