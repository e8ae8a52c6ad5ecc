"""Images of tomographs, and the porosity that belongs to the results of a cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_run import Ended
from stranger_case import Case

import porocore

CHANNELS = {"kind": "orthogonal-channels", "radius": 0.25}


def porosity_is_that_of_the_mesh(folder: Path, ended: Ended | None) -> None:
    exact = 3 * np.pi * 0.25**2 - 8 * np.sqrt(2) * 0.25**3
    for element, of_mesh in (("quadratic-curved", 0.412245), ("linear", 0.401544)):
        mesh = {"size": 0.4, "fluid_size": 0.25, "element": element}
        for swelling in (1.0, 1.05):
            material = {"kind": "neo-hookean", "poisson_ratio": 0.3, "swelling": swelling}
            problem = porocore.CellProblem({"geometry": CHANNELS, "material": material, "mesh": mesh})
            assert problem.porosity == pytest.approx(of_mesh, abs=1e-6)
            assert problem.geometric_porosity == pytest.approx(exact, abs=1e-12)
            at_rest = problem.response(np.zeros((3, 3))).fluid_volume[0]
            assert (at_rest == problem.porosity) == (swelling == 1.0)


CASES: list[Case] = [
    Case(
        "porosity_of_mesh",
        "CellProblem.porosity is the fluid volume of the mesh before it swells",
        check=porosity_is_that_of_the_mesh,
    ),
]
