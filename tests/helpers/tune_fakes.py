"""A plugin with a surrogate whose error is known: it knows the made-up cell, but for 1 % divided by its weights.

It logs each training, and can be slow.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np

from porocore import ConfigurationError, Offer, Surrogate, hookimpl
from porocore.testing.synthetic.cell import respond

ACTIVATIONS = {"tanh": 1.0, "sigmoid": 3.0}
#: Environment variables: where trainings are logged, and how long they take.
LOG, SLEEP = "POROCORE_TUNE_LOG", "POROCORE_TUNE_SLEEP"


def known_error(hidden, activation):
    """Share by which <∇u¹> is wrong."""
    if activation == "sigmoid" and sum(hidden) > 40:
        return float("nan")
    return 0.01 * ACTIVATIONS[activation] / sum(hidden)


class Sized(Surrogate):
    def __init__(self, hidden=(4,), activation="tanh"):
        if activation not in ACTIVATIONS:
            raise ConfigurationError(
                f"surrogate.options.activation: expected tanh or sigmoid, got {activation}"
            )
        self.hidden, self.activation = hidden, activation

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        time.sleep(float(os.environ.get(SLEEP, 0)))
        if LOG in os.environ:
            with open(os.environ[LOG], "a") as file:
                file.write(
                    f"{os.getpid()} {os.environ.get('OMP_NUM_THREADS')} {self.hidden} {self.activation}\n"
                )
        self.identity, self.inputs, self.provenance = data.identity, data.inputs, {}
        return self

    def predict(self, states, *, tangent=True):
        truth = respond(states)
        wrong = truth.mean_grad * (1 + known_error(self.hidden, self.activation))
        nothing = dict.fromkeys(("potential", "stress", "fluid_volume", "tangent"))
        return replace(truth, mean_grad=wrong, doubt=np.zeros(len(states), np.int64), **nothing)

    def save(self, path):
        path.write_text("")

    @classmethod
    def load(cls, path):
        return cls()


@hookimpl
def porocore_surrogates():
    return [Offer(name="sized", load=lambda: Sized, summary="of a known error")]
