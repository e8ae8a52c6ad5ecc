"""(d) 2,250 surrogate predictions with derivatives, as in an increment of the paper: one call against one by one."""

from __future__ import annotations

import numpy as np
from common import best, table

from porocore.states import MacroState
from porocore.testing.synthetic_cell import synthetic_training_set
from porocore_surrogate_torch.surrogate import TorchSurrogate

N = 2250


def main() -> str:
    surrogate = TorchSurrogate(epochs=200).fit(synthetic_training_set(100), seed=0)
    rng = np.random.default_rng(0)
    H = np.zeros((N, 3, 3))
    H[:, 1, 1] = rng.uniform(-0.2, 0.0, N)
    states = MacroState(H, rng.uniform(0.0, 0.2, N))
    surrogate.predict(states)
    together, _ = best(lambda: surrogate.predict(states), 20)
    singles = [states[i : i + 1] for i in range(N)]
    one_by_one, _ = best(lambda: [surrogate.predict(state) for state in singles], 2)
    rows = [
        ["one by one", f"{1e3 * one_by_one:.0f}", "1"],
        ["in one call", f"{1e3 * together:.1f}", f"1/{one_by_one / together:.0f}"],
    ]
    text = table(
        f"(d) {N:,} predictions with exact derivatives, 3 × 40 sigmoid network, two inputs",
        ["", "milliseconds", "of the time one by one"],
        rows,
    )
    return text + "\nThe paper: 450 ms without derivatives (other hardware).\n"


if __name__ == "__main__":
    print(main())
