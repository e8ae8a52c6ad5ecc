"""Made-up models of surrogates, one of each kind, and a record for their file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.tensors import CUBIC
from porocore.surrogates.file.file import SurrogateMetadata
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.fit import polynomial_model
from porocore.surrogates.polynomial.monomials import invariant, plain
from porocore.testing.synthetic.cell import synthetic_training_set
from porocore.testing.synthetic.potential_cell import potential_training_set

RECORD = SurrogateMetadata("torch", {"hidden": [6]}, "cell-7", {"porocore": "0.1"}, {"stress": 0.1 + 0.2})


def network(inputs, outputs, activation="tanh"):
    random = np.random.default_rng(0)
    return Network(
        activation,
        (random.normal(size=(6, inputs)), random.normal(size=(outputs, 6))),
        (random.normal(size=6), random.normal(size=outputs)),
    )


def potential_part(terms):
    k = len(terms.weights)
    return SeparableNetwork(network(k, 1), terms)


def models():
    seven = polynomial_model(potential_training_set(30, seed=1))[0]
    two = polynomial_model(synthetic_training_set(30, seed=1))[0]
    inputs = InputSpace(("H22", "p"), (-0.2, -0.02), (0.04, 0.24))
    sampled = SampledRange.around(inputs, np.random.default_rng(1).random((9, 2)))
    linear = np.random.default_rng(2).normal(size=(9, 10))
    anchored = AnchoredModel(
        linear, (0, 4, 8), np.array([0.1, 1 / 3, 0.7]), network(2, 3, "sigmoid"), sampled
    )
    return {
        "polynomial": seven,
        "polynomial of two": two,
        "network": replace(seven, coarse=None, fine=None, network=potential_part(invariant(CUBIC))),
        "network of some terms": replace(seven, network=potential_part(invariant(CUBIC).subset((0, 3, 9)))),
        "network of two": replace(two, network=potential_part(plain((1, 6)))),
        "mlp": anchored,
        "mlp without network": replace(
            anchored, components=(), output_scale=np.zeros(0), network=Network("tanh", (), ())
        ),
    }


MODELS = models()
