"""(v) How many cells the surrogate of a family needs: errors on 100 held-out states against the number of cells.

    python benchmarks/family_samples.py --cache DIR [four six nine]

The family of the benchmark, radius 0.15 … 0.3 and Poisson's ratio 0.2 … 0.45; each cell is another member. Four inputs
(H22, p and both parameters), six (all diagonal components of H) and nine (all six of a stretch). Cells are the first of
one Sobol sequence, beside the undeformed members, which are linear solves. Errors are root mean squares over the range,
of the worst component; at rest they are the largest ones of stiffness, Biot's coefficient and modulus at members
between the solved ones, as shares of the largest entry. Studies stay in the folder of ``--cache`` and go on from there.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import table
from solved_states import worst_share

from porocore import Study
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.plugins.registry import registry
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, CellResponse, MacroState
from porocore.study.run.composition import training_set

DIAGONAL, SHEAR = [-0.06, 0.04], [-0.05, 0.05]
INPUTS = {
    "four": {"H22": [-0.12, 0.04], "p": [0.0, 0.1]},
    "six": dict.fromkeys(("H11", "H22", "H33"), DIAGONAL) | {"p": [0.0, 0.1]},
    "nine": dict.fromkeys(("H11", "H22", "H33"), DIAGONAL)
    | dict.fromkeys(("H23", "H13", "H12"), SHEAR)
    | {"p": [0.0, 0.1]},
}
SIZES = {"four": (8, 24, 32, 96), "six": (8, 32, 96), "nine": (32, 96)}
SURROGATES = {"polynomial": {}, "torch": {"model": "potential"}, "jax": {"model": "potential"}}
#: Members between the solved ones at which the rest is compared, solved as states of their own.
RESTS = 12
SIDE = {"displacement": [0, None, 0]}


def study(name: str, folder: Path) -> Study:
    """The cells of one set of inputs; K_ref of the deformed pore is learned with four."""
    return Study(
        {
            "title": f"family with {name} inputs",
            "cell": {
                "geometry": {"radius": {"range": [0.15, 0.3]}},
                "material": {"poisson_ratio": {"range": [0.2, 0.45]}},
            },
            "conductivity": "deformed" if name == "four" else "piola",
            "closure": "potential",
            "sampling": {
                "sampler": "sobol",
                "inputs": {key: {"range": ends} for key, ends in INPUTS[name].items()},
                "parameters": "ranges",
                "options": {"count": max(SIZES[name]), "states_per_member": 1},
                "test": {"count": 100},
            },
            "surrogate": {"backend": "polynomial"},
            "macro": {
                "body": {"kind": "box", "size": [0.1, 1, 0.1], "elements": [1, 2, 1]},
                "boundary": {
                    **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
                    "y-": {"displacement": [0, 0, 0]},
                    "y+": {"pressure": 0},
                },
                "loads": [-0.02],
                "fields": {"radius": 0.24, "poisson_ratio": 0.3},
            },
        },
        out=folder / name,
        store=folder / "store",
    )


def first(data: TrainingSet, count: int) -> TrainingSet:
    """The first cells, as far as they are stable."""
    return replace(data, states=data.states[:count], responses=data.responses[:count])


def errors(surrogate: Surrogate, states: MacroState, truth: CellResponse) -> list[str]:
    """Errors of P_E, φ and, where it was learned, ln K_ref, in per cent."""
    found = surrogate.predict(states, tangent=False)
    assert found.stress is not None
    assert found.fluid_volume is not None
    shares = [
        worst_share(found.stress - truth.stress, truth.stress),
        worst_share(found.fluid_volume - truth.fluid_volume, truth.fluid_volume),
    ]
    if found.conductivity is not None and truth.conductivity is not None:
        there = np.isfinite(truth.conductivity).all(axis=(1, 2))
        logs, known = (_logarithms(K[there]) for K in (found.conductivity, truth.conductivity))
        shares.append(worst_share(logs - known, known))
    return [f"{100 * share:.2g} %" for share in shares]


def _logarithms(K: Array) -> Array:
    """Logarithms of the diagonal (n, 3)."""
    return np.log(np.einsum("nii->ni", K))


def at_rest(surrogate: Surrogate, cells: Study) -> list[str]:
    """Largest errors of stiffness, Biot's coefficient and modulus, and the stress, of members at rest."""
    from porocore import CellProblem

    names, low, high = zip(
        *((each.name, each.lower, each.upper) for each in cells.config.cell.parameters), strict=True
    )
    theta = np.array(low) + (np.array(high) - low) * np.random.default_rng(5).random((RESTS, len(names)))
    found = surrogate.predict(MacroState.zeros(RESTS).with_parameters(theta))
    truth = [
        CellProblem(cells.config.cell, parameters=dict(zip(names, map(float, row), strict=True))).response(
            np.zeros((3, 3))
        )
        for row in theta
    ]
    shares = []
    for name in ("stress_grad_u", "stress_p", "fluid_volume_p"):
        known = np.concatenate([getattr(one.tangent, name) for one in truth])
        value = getattr(found.tangent, name)
        largest = np.abs(known).reshape(RESTS, -1).max(axis=1)
        shares.append(float((np.abs(value - known).reshape(RESTS, -1).max(axis=1) / largest).max()))
    assert found.stress is not None
    return [*(f"{share:.1e}" for share in shares), f"{np.abs(found.stress).max():.0e}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for the studies; made if missing")
    parser.add_argument("--surrogates", nargs="*", choices=list(SURROGATES), default=list(SURROGATES))
    parser.add_argument("inputs", nargs="*", help="four, six, nine; by default all")
    arguments = parser.parse_args()
    rows, rests = [], []
    for name in arguments.inputs or INPUTS:
        cells = study(name, arguments.cache)
        cells.sample()
        data = training_set(cells.folder)
        held_out = Dataset.open(cells.folder.test_dataset)
        kept = np.flatnonzero(held_out.responses().stable)
        states, truth = held_out.states()[kept], held_out.responses()[kept]
        for size in SIZES[name]:
            for backend in arguments.surrogates:
                fitted = registry().get("surrogate", backend)(**SURROGATES[backend])
                fitted.fit(first(data, size), seed=0)
                found = errors(fitted, states, truth)
                rows.append([name, str(size), backend, *found, *[""] * (3 - len(found))])
                print(*rows[-1], flush=True)
        if name == "four":
            rests.append(["polynomial", *at_rest(fitted, cells)])
    print(
        table(
            "(v) Errors over the range on held-out states",
            ["inputs", "cells", "", "P_E", "φ", "ln K_ref"],
            rows,
        )
    )
    if rests:
        header = ["", "stiffness", "α", "1/M_B", "stress"]
        print(table("(v) Largest errors of members at rest", header, rests))


if __name__ == "__main__":
    main()
