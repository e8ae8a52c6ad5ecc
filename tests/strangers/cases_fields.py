"""Bodies whose fields and axes change in time, against values by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import porocore
from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import Case

STRAIN = 0.002


def fluid_is_counted_in_the_axes_of_its_time(folder: Path, ended: Ended | None) -> None:
    """Drained and held at u₂ = −ε y, the cell has given off α_22 ε, and α_11 ε after its axes have turned."""
    study = porocore.Study("study.yaml", out="runs")
    found = next(iter(study.solve().values()))
    at_rest = porocore.CellProblem(study.config.cell).response(np.zeros((3, 3)))
    alpha = at_rest.tangent.fluid_volume_grad_u[0]
    assert alpha[1, 1] / alpha[0, 0] > 1.05
    # The cell itself at the strain, for the law of the potential.
    compressed = [np.diag([0, -STRAIN, 0]), np.diag([-STRAIN, 0, 0])]
    own = porocore.CellProblem(study.config.cell).response(np.array(compressed)).fluid_volume
    taken = {"linear": STRAIN * np.diag(alpha)[[1, 0]], "nonlinear": at_rest.fluid_volume[0] - own}
    for name, (before, after) in taken.items():
        history = getattr(found, name)
        within = 1e-6 if name == "linear" else 1e-4
        assert history.drained[np.argmin(np.abs(history.time - 5))] == pytest.approx(before, rel=within)
        assert history.drained[-1] == pytest.approx(after, rel=within)


CASES: list[Case] = [
    Case(
        "axes_in_time",
        "what is drained follows axes that turn in a held element",
        check=fluid_is_counted_in_the_axes_of_its_time,
        slow=True,
    ),
]
