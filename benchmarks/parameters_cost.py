"""(u) What parameters cost: a law call at 2,862 points, as many as the column of the benchmark has.

The law of a family, with the same parameters everywhere, ten sets of them, those of each point, and others at every
call, against the law of the one cell without parameters; all take turns. Two inputs (H22, p) and seven (six
components of the stretch, and p), beside the two parameters. The status is 1 where the two, constant in time, take more
than 1.3² times a call without any, or ten sets or ten regions more than 1.3 times the same parameters everywhere.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from common import in_turn, table

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.composed import RegionLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.plugins.registry import registry
from porocore.states import Array, BodyPlace, MacroState
from porocore.testing.synthetic.porous_family import (
    PARAMETERS,
    porosity,
    porous_training_set,
    respond,
)

N, REGIONS = 2862, 10
MIDDLE = np.array([0.22, 0.3])
RANGES = {
    "two inputs": {"H22": (-0.12, 0.04), "p": (0.0, 0.1)},
    "seven inputs": {f"H{ij}": (-0.06, 0.06) for ij in ("11", "22", "33", "23", "13", "12")}
    | {"p": (0.0, 0.1)},
}
SURROGATES = {
    "polynomial": ("polynomial", {}),
    "torch": ("torch", {"model": "potential", "iterations": 30}),
    "jax": ("jax", {"model": "potential", "iterations": 30}),
}
#: States from which the surrogates learn; how well does not matter here.
STATES = 60
#: Largest share of one more parameter, and of ten sets of them in place of one.
LIMIT = 1.3


def alone(inputs: InputSpace) -> TrainingSet:
    """The member in the middle as a cell without parameters."""
    random = np.random.default_rng(1)
    states = inputs.scatter(random.uniform(inputs.lower, inputs.upper, (STATES, len(inputs))))
    rest = MacroState.zeros(1)
    responses, reference = (
        replace(respond(each.with_parameters(MIDDLE)), slopes=None, conductivity=None)
        for each in (states, rest)
    )
    return TrainingSet(states, responses, inputs, reference, "made-up", {}, CUBIC, 0.01)


def of_family(inputs: InputSpace) -> TrainingSet:
    """States of all members."""
    data = porous_training_set(STATES, seed=1, inputs=inputs)
    return replace(data, responses=replace(data.responses, conductivity=None), tolerance=0.01)


def law_of(surrogate: Surrogate, folder: Path) -> ClosedLaw:
    """The potential closure of a copy, which keeps what it knows of its own parameters."""
    surrogate.save(folder / "surrogate.h5")
    surrogate = type(surrogate).load(folder / "surrogate.h5")
    K = np.eye(3) * 0.01
    return ClosedLaw(surrogate, make_closure("potential", float(1 - porosity(MIDDLE[0])), NeoHookean(), K))


def calls(
    cell: Surrogate, family: Surrogate, states: MacroState, grad_p: Array, folder: Path
) -> dict[str, Callable[[], Any]]:
    """Calls that are compared, by name."""
    random = np.random.default_rng(3)
    low, high = np.array(list(PARAMETERS.values())).T
    sets = low + (high - low) * random.random((N, 2))
    region = np.arange(N) * REGIONS // N
    placed = replace(states.with_parameters(sets[region]), place=BodyPlace(region))

    def call(at: MacroState, surrogate: Surrogate = family) -> Callable[[], Any]:
        law: MacroLaw = law_of(surrogate, folder)
        if at.place is not None:
            law = RegionLaw([law] * REGIONS)
        memory = law.initial_at(at)
        return lambda: law.respond(at, grad_p, memory)

    changed = law_of(family, folder)
    start = changed.initial_at(states.with_parameters(MIDDLE))

    def changing() -> Any:
        at = states.with_parameters(low + (high - low) * random.random((N, 2)))
        return changed.respond(at, grad_p, start)

    return {
        "no parameters": call(states, cell),
        "the same everywhere": call(states.with_parameters(MIDDLE)),
        "ten sets": call(states.with_parameters(sets[region])),
        "ten regions": call(placed),
        "of each point": call(states.with_parameters(sets)),
        "others at every call": changing,
    }


def main() -> int:
    rows, failed, names = [], False, []
    for name, (backend, options) in SURROGATES.items():
        for title, ranges in RANGES.items():
            plain, inputs = InputSpace.from_ranges(ranges), InputSpace.from_ranges(ranges, PARAMETERS)
            make = registry().get("surrogate", backend)
            fitted = [make(**options).fit(data, seed=0) for data in (alone(plain), of_family(inputs))]
            random = np.random.default_rng(2)
            states = plain.scatter(random.uniform(plain.lower, plain.upper, (N, len(plain))))
            with TemporaryDirectory() as folder:
                works = calls(*fitted, states, random.normal(size=(N, 3)), Path(folder))
            times, _ = in_turn(list(works.values()), 20)
            names = list(works)
            shares = [time / times[0] for time in times]
            rows.append([name, title, f"{1e3 * times[0]:.1f}", *(f"{share:.2f}" for share in shares[1:])])
            failed |= max(shares[1:5]) > LIMIT ** len(PARAMETERS) or max(shares[2:4]) > LIMIT * shares[1]
    header = ["", "", f"{names[0]}, ms", *names[1:]]
    print(table(f"(u) A law call at {N:,} points, times that without parameters", header, rows))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
