"""What all tests share: modules in ``helpers``, a made-up solution of a consolidating column, figures left empty."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest
import typer.main

from porocore.interfaces.solution import MacroSolution
from tests.helpers.made_up_column import make_column

# A process has one command line; here it serves a thousand, and building it takes longer than what most of them do.
typer.main.get_command = cache(typer.main.get_command)


@pytest.fixture(scope="session")
def column() -> Callable[..., MacroSolution]:
    """Make a column: see :func:`make_column`."""
    return make_column


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave figures empty: drawing takes longer than a small study, and what is on them is tested elsewhere."""
    from matplotlib.figure import Figure

    monkeypatch.setattr(Figure, "draw", lambda figure, renderer: None)
