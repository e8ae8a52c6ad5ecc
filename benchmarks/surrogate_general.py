"""(g) Surrogates of general states: all nine H_ij within ±0.1 and p from 0 to 0.1, from 10, 25 and 50 solves.

    python benchmarks/surrogate_general.py --cache DIR

The states to learn from are the first of a Sobol sequence in the ten inputs; errors are root mean squares of the worst
component on 50 random states that nobody trained on, as a share of the range; of tangents, root mean squares of all
entries, as a share of those of the tangent itself.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from common import table
from solved_states import Given, Library, random_points, sobol_points, worst_share

from porocore.core.inputs import NAMES, InputSpace
from porocore.interfaces.surrogate import Surrogate
from porocore.plugins.registry import registry
from porocore.states import CellResponse, MacroState

INPUTS = InputSpace(NAMES, (-0.1,) * 9 + (0.0,), (0.1,) * 10)
SIZES = (10, 25, 50)
#: Name → backend and options.
SURROGATES = {
    "polynomial": ("polynomial", {}),
    "network alone, torch": ("torch", {"model": "potential", "anchor": "none"}),
    "network alone, jax": ("jax", {"model": "potential", "anchor": "none"}),
    "network on a polynomial, torch": ("torch", {"model": "potential", "anchor": "polynomial"}),
    "network on a polynomial, jax": ("jax", {"model": "potential", "anchor": "polynomial"}),
}
TANGENTS = {"∂P_E/∂H": "stress_grad_u", "∂P_E/∂p": "stress_p", "∂φ/∂p": "fluid_volume_p"}


def errors(surrogate: Surrogate, states: MacroState, truth: CellResponse) -> list[float]:
    """Of P_E, φ and the tangents."""
    found = surrogate.predict(states)
    tangents = []
    for name in TANGENTS.values():
        known = getattr(truth.tangent, name)
        wrong = getattr(found.tangent, name) - known
        tangents.append(float(np.linalg.norm(wrong) / np.linalg.norm(known)))
    return [
        worst_share(found.stress - truth.stress, truth.stress),
        worst_share(found.fluid_volume - truth.fluid_volume, truth.fluid_volume),
        *tangents,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for solved states; made if missing")
    arguments = parser.parse_args()
    library = Library(arguments.cache, INPUTS)
    unseen = library.solve("unseen", Given(INPUTS, random_points(INPUTS, 50, seed=7)))
    states, responses = library.solve("sobol", Given(INPUTS, sobol_points(INPUTS, max(SIZES), seed=1)))
    rows = []
    for name, (backend, options) in SURROGATES.items():
        make = registry().get("surrogate", backend)
        for n in SIZES:
            began = time.perf_counter()
            fitted = make(**options).fit(library.training_set(states[:n], responses[:n]), seed=0)
            seconds = time.perf_counter() - began
            found = [f"{100 * e:.2g} %" for e in errors(fitted, *unseen)]
            rows.append([name, str(n), *found, f"{seconds:.1f}"])
    header = ["", "solves", "P_E", "φ", *TANGENTS, "training s"]
    print(table("(g) Errors on 50 unseen general states", header, rows))


if __name__ == "__main__":
    main()
