"""(y) What it is worth to sample a family of cells where the body is: errors on the body's states.

    python benchmarks/body_samples.py --cache DIR

A column whose radius grows with the height from 0.2 to 0.25, a third of its range, with one Poisson's ratio, on coarse
meshes. The states that are compared are those that the column goes through with the surrogate of the largest design,
some of each time and height, solved as cells of their own. Errors are root mean squares over the range, of the worst
component of P_E and of φ. Studies stay in the folder of ``--cache`` and go on from there.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from common import table
from solved_states import worst_share

from porocore import Study
from porocore.plugins.border import prediction_of
from porocore.states import CellResponse, MacroState
from porocore.study.run.composition import explorer, prepare_family, training_set
from porocore.study.run.results import load_reference

SIDE = {"displacement": [0, None, 0]}
SIZES = (16, 24, 32, 48)
SAMPLERS = (
    ("sobol", "ranges"),
    ("sobol", "body"),
    ("active", "ranges"),
    ("active", "body"),
    ("macro-driven", "body"),
)
#: States that are compared.
COMPARED = 60


def study(folder: Path, sampler: str, parameters: str, count: int) -> Study:
    """The study with so many states of a sampler."""
    options: dict[str, Any] = {"count": count, "states_per_member": 4}
    if sampler == "macro-driven":
        options |= {"elements": 8, "steps": 10}
    tolerance = {"tolerance": 1e-9} if sampler == "macro-driven" else {}  # all of them
    return Study(
        {
            "cell": {
                "geometry": {"radius": {"range": [0.15, 0.3]}},
                "material": {"poisson_ratio": {"range": [0.2, 0.45]}},
                "mesh": {"size": 0.4, "fluid_size": 0.4, "element": "linear"},
            },
            "closure": "potential",
            "sampling": {
                "sampler": sampler,
                "parameters": parameters,
                "inputs": {"H22": {"range": [-0.12, 0.04]}, "p": {"range": [-0.02, 0.08]}},
                "options": options,
                "test": {"count": 1},
                "workers": 1,
                **tolerance,
            },
            "surrogate": {"backend": "polynomial"},
            "macro": {
                "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 16, 1]},
                "boundary": {
                    **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
                    "y-": {"displacement": [0, 0, 0]},
                    "y+": {"traction": [0, 1, 0], "pressure": 0},
                },
                "loads": [-0.05],
                "fields": {"radius": "0.2 + 0.05*y/7.5", "poisson_ratio": 0.35},
                "time": {"end": 150, "step": 5, "ramp_increments": 5, "ramp_step": 0.5},
            },
        },
        out=folder / f"{sampler}-{parameters}-{count}",
        store=folder / "store",
    )


def states_of_the_body(of: Study) -> MacroState:
    """States of the column, some of each eighth of its height."""
    one = of.config
    data = training_set(of.folder)
    visited = explorer(one, load_reference(of.folder))(data, elements=8, steps=20).states
    moved = np.flatnonzero(np.abs(visited.grad_u[:, 1, 1]) > 1e-4)
    visited = visited[moved]
    assert visited.parameters is not None
    radii = np.unique(visited.parameters[:, 0])
    random = np.random.default_rng(1)
    rows = []
    for radius in radii[:: max(len(radii) // 12, 1)]:
        there = np.flatnonzero(visited.parameters[:, 0] == radius)
        rows.append(random.choice(there, COMPARED // 12, replace=False))
    return visited[np.concatenate(rows)]


def errors(of: Study, states: MacroState, truth: CellResponse) -> list[str]:
    """Errors of P_E and φ in per cent."""
    found = prediction_of(of.train(), states, tangent=False)
    pairs = (found.stress, truth.stress), (found.fluid_volume, truth.fluid_volume)
    return [f"{100 * worst_share(a - b, b):.2g}" for a, b in pairs if a is not None and b is not None]


def main() -> None:
    """Sample, learn, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True, help="folder of the studies")
    folder = parser.parse_args().cache
    best = study(folder, "sobol", "body", max(SIZES))
    best.train()
    states = states_of_the_body(best)
    config = best.config
    solver, family = prepare_family(config.fem.backend, config.fem.options, config.cell)
    truth = solver.solve(family, states, tangent=False).response
    rows = []
    for sampler, parameters in SAMPLERS:
        shares = []
        for count in SIZES:
            shares.append(" / ".join(errors(study(folder, sampler, parameters, count), states, truth)))
        rows.append([f"`{sampler}`", parameters, *shares])
        print(rows[-1], flush=True)
    title = "(y) Errors of P_E and φ on the states of a body, per cent"
    print(table(title, ["sampler", "parameters", *(f"{count} states" for count in SIZES)], rows))


if __name__ == "__main__":
    main()
