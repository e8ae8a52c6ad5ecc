"""(d) 2,250 predictions with all derivatives, as in an increment of the paper: in one call, and one by one.

Two inputs (H22, p) and seven (six components of the stretch, and p); potentials of the default size.
"""

from __future__ import annotations

import numpy as np
from common import best, table

from porocore.core.inputs import NAMES, InputSpace
from porocore.core.tensors import CUBIC
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.plugins.registry import registry
from porocore.states import MacroState
from porocore.testing.synthetic.potential_cell import respond

N = 2250
INPUTS = {
    "two inputs": InputSpace(("H22", "p"), (-0.2, 0.0), (0.0, 0.2)),
    "seven inputs": InputSpace(NAMES, (-0.1,) * 9 + (0.0,), (0.1,) * 10),
}
#: Backend, options, and how many milliseconds the call may take on a quiet machine.
SURROGATES = {
    "polynomial": ("polynomial", {}, (1, 15)),
    "potential, torch": ("torch", {"model": "potential", "iterations": 30}, (8, 15)),
    "potential, jax": ("jax", {"model": "potential", "iterations": 30}, (5, 12)),
    "the paper's network, torch": ("torch", {"model": "mlp", "epochs": 50}, None),
    "the paper's network, jax": ("jax", {"model": "mlp", "epochs": 50}, None),
}


def trained(backend: str, options: dict[str, object], inputs: InputSpace) -> Surrogate:
    """How well does not matter here."""
    states = states_in(inputs, 60, seed=1)
    data = TrainingSet(states, respond(states), inputs, respond(MacroState.zeros(1)), "made-up", {}, CUBIC)
    return registry().get("surrogate", backend)(**options).fit(data, seed=0)


def states_in(inputs: InputSpace, count: int, seed: int) -> MacroState:
    random = np.random.default_rng(seed)
    return inputs.scatter(random.uniform(inputs.lower, inputs.upper, (count, len(inputs))))


def main() -> str:
    rows = []
    for name, (backend, options, limits) in SURROGATES.items():
        for i, (title, inputs) in enumerate(INPUTS.items()):
            surrogate, states = trained(backend, options, inputs), states_in(inputs, N, seed=0)
            surrogate.predict(states)
            together, _ = best(lambda s=surrogate, x=states: s.predict(x), 200)
            singles = [states[k : k + 1] for k in range(0, N, 10)]
            surrogate.predict(singles[0])
            one_by_one, _ = best(lambda s=surrogate, x=singles: [s.predict(one) for one in x], 2)
            one_by_one *= N / len(singles)
            limit = "" if limits is None else str(limits[i])
            rows.append(
                [name, title, f"{1e3 * together:.1f}", limit, f"{1e3 * one_by_one:.0f}",
                 f"1/{one_by_one / together:.0f}"]
            )  # fmt: skip
    text = table(
        f"(d) {N:,} predictions with all derivatives",
        ["", "", "in one call, ms", "at most", "one by one, ms", "ratio"],
        rows,
    )
    return text + "\nThe paper: 450 ms without derivatives, two inputs (other hardware).\n"


if __name__ == "__main__":
    print(main())
