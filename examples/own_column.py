"""A solver of one's own with the law of a study: a confined column that drains at its top.

Run it with ``python examples/own_column.py``. It samples a coarse cell, trains a surrogate, and compares the settlement
with that of porocore. All that the solver takes from porocore is ``law.response``: stress, fluid volume, conductivity
and their derivatives, of all elements at once.
"""

from itertools import pairwise

import numpy as np

import porocore


def consolidate(law, height, times, traction, elements=40):
    """Return the settlement at ``times`` under ``traction(t)`` on the top; finite volumes, backward Euler, Newton."""
    n, size = elements, height / elements
    difference = (np.eye(n, k=1) - np.eye(n)) / size  # ∂p/∂y at the upper face of each element
    difference[-1, -1] = -2 / size  # p = 0 on the top, half an element above the last centre
    mean = (np.eye(n, k=1) + np.eye(n)) / 2
    mean[-1, -1] = 1
    outflow = (np.eye(n) - np.eye(n, k=-1)) / size
    strain, p, settlement = np.zeros(n), np.zeros(n), [0.0]
    before = found = law.response(np.zeros((n, 3, 3)))
    for then, now in pairwise(times):
        flow = (now - then) * outflow
        for _ in range(30):
            H = np.zeros((n, 3, 3))
            H[:, 1, 1] = strain
            found = law.response(H, p, before=before)
            K, slope, d = mean @ found.conductivity[:, 1, 1], difference @ p, found.tangent
            flux_H = -slope[:, None] * mean * d.conductivity_grad_u[:, 1, 1, 1, 1]
            flux_p = -slope[:, None] * mean * d.conductivity_p[:, 1, 1] - K[:, None] * difference
            balance = found.stress[:, 1, 1] - traction(now)
            storage = found.fluid_volume - before.fluid_volume + flow @ (-K * slope)
            change = np.linalg.solve(
                np.block(
                    [
                        [np.diag(d.stress_grad_u[:, 1, 1, 1, 1]), np.diag(d.stress_p[:, 1, 1])],
                        [
                            np.diag(d.fluid_volume_grad_u[:, 1, 1]) + flow @ flux_H,
                            np.diag(d.fluid_volume_p) + flow @ flux_p,
                        ],
                    ]
                ),
                -np.concatenate([balance, storage]),
            )
            strain, p = strain + change[:n], p + change[n:]
            if np.abs(change).max() < 1e-10:
                break
        before = found
        settlement.append(-size * strain.sum())
    return np.array(settlement)


def compare(study, load, kind="surrogate"):
    """Print both settlements, and return them: of the own solver, and of porocore at the same times."""
    laws = study.solve()[load]
    solved = laws.linear if kind == "linear" else laws.nonlinear
    problem = study.config.macro.problem(load)
    own = consolidate(study.law(kind), 7.5, solved.time, lambda time: load * problem.ramp(time))
    for time, here, there in zip(solved.time[::10], own[::10], solved.settlement[::10], strict=True):
        print(f"t = {time:8.3f}   settlement {here:.5f}   porocore {there + 0:.5f}")
    return own, solved.settlement


if __name__ == "__main__":
    coarse = {
        "cell": {"mesh": {"size": 0.25, "fluid_size": 0.25}},
        "sampling": {
            "inputs": {
                "H22": {"range": [-0.15, 0.03], "step": 0.03},
                "p": {"range": [-0.02, 0.08], "step": 0.02},
            },
            "test": {"count": 10},
        },
        "surrogate": {"backend": "polynomial", "options": {}},
        "closure": "potential",
        "macro": {"loads": [-0.05], "body": {"elements": [1, 16, 1]}, "time": {"end": 30, "profiles": [10]}},
    }
    compare(porocore.Study("dehghani2022", out="runs/own-column", **coarse), -0.05)
