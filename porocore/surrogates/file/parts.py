"""Parts of models in a file: polynomials, terms, networks, hulls and boxes of the training states.

Functions of this folder that unpack raise a KeyError, TypeError or ValueError where something is missing or does not
fit together; :func:`porocore.surrogates.file.file.read` makes one message of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.states import Array
from porocore.surrogates.network.network import Network
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms, plain
from porocore.surrogates.training_box import TrainingBox

#: Largest exponent of a polynomial, and the number of its monomials' divisors: far beyond any that was fitted.
MOST_EXPONENT, MOST_DIVISORS = 32, 1_000_000


def pack_polynomial(polynomial: Polynomial, name: str, arrays: dict[str, Array]) -> None:
    """Add a polynomial to the arrays of a file, under a name."""
    arrays[f"{name}/exponents"] = polynomial.exponents.astype(float)
    arrays[f"{name}/coefficients"] = polynomial.coefficients


def unpack_polynomial(arrays: dict[str, Array], name: str, variables: int, outputs: int) -> Polynomial:
    """Return the polynomial of that name, in so many variables and outputs."""
    exponents = arrays[f"{name}/exponents"]
    coefficients = arrays[f"{name}/coefficients"]
    if (
        exponents.ndim != 2
        or exponents.shape[1] != variables
        or coefficients.shape != (outputs, len(exponents))
    ):
        raise ValueError(f"{name} has shapes {exponents.shape} and {coefficients.shape}")
    if (exponents < 0).any() or (exponents > MOST_EXPONENT).any() or (exponents % 1).any():
        raise ValueError(f"{name} has exponents that are none of 0 … {MOST_EXPONENT}")
    # A monomial is evaluated with all its divisors.
    if (exponents + 1).prod(axis=1).sum() > MOST_DIVISORS:
        raise ValueError(f"{name} has more monomials than can be evaluated")
    return Polynomial(exponents.astype(np.int64), coefficients)


def pack_terms(terms: Terms, name: str, arrays: dict[str, Array]) -> None:
    """Add terms to the arrays of a file, under a name."""
    pack_polynomial(terms.polynomial, name, arrays)
    arrays[f"{name}/weights"] = np.array(terms.weights, dtype=float)


def unpack_terms(kind: str, name: str, arrays: dict[str, Array]) -> Terms:
    """Return the terms of that name and kind."""
    weights = tuple(int(w) for w in arrays[f"{name}/weights"].reshape(-1))
    polynomial = unpack_polynomial(arrays, name, VARIABLES, len(weights))
    if kind == "plain":
        if not (polynomial.exponents.sum(axis=1) == 1).all():
            raise ValueError(f"{name}: a term that is no variable")
        return plain(tuple(int(row.argmax()) for row in polynomial.exponents))
    if kind != "invariant":
        raise ValueError(f"terms of the kind {kind!r}")
    return Terms(kind, polynomial, weights)


def pack_range(sampled: SampledRange, arrays: dict[str, Array], folder: str = "") -> None:
    """Add the hull of the training states to the arrays of a file."""
    arrays |= {f"{folder}range/normals": sampled.normals, f"{folder}range/offsets": sampled.offsets}


def unpack_range(arrays: dict[str, Array], inputs: InputSpace, folder: str = "") -> SampledRange:
    """Return the hull of the training states."""
    name = f"{folder}range"
    normals, offsets = arrays[f"{name}/normals"], arrays[f"{name}/offsets"]
    if offsets.ndim != 1 or not len(offsets) or normals.shape != (len(offsets), len(inputs)):
        raise ValueError(f"{name} has normals of shape {normals.shape} and offsets of shape {offsets.shape}")
    if (np.abs(normals).max(axis=1) == 0).any():
        raise ValueError(f"{name}/normals has one of length zero")
    return SampledRange(inputs, normals, offsets)


def pack_box(box: TrainingBox, arrays: dict[str, Array], folder: str = "") -> None:
    """Add the box of the training states to the arrays of a file."""
    arrays |= {f"{folder}reach/low": box.low, f"{folder}reach/high": box.high}


def unpack_box(header: dict[str, Any], arrays: dict[str, Array], folder: str = "") -> TrainingBox:
    """Return the box of the training states, in the active variables of the header or a part of it."""
    active = tuple(int(a) for a in header["active"])
    if any(a not in range(VARIABLES) for a in active):
        raise ValueError(f"active variables {active}")
    return TrainingBox(
        active, *(arrays[f"{folder}reach/{end}"].reshape(len(active)) for end in ("low", "high"))
    )


def pack_network(
    network: Network, header: dict[str, Any], arrays: dict[str, Array], name: str = "network"
) -> None:
    """Add a network to the arrays of a file, under a name, and to the header or a part of it."""
    header["activation"], header["layers"] = network.activation, len(network.weights)
    for i, (W, b) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays |= {f"{name}/{i}/weights": W, f"{name}/{i}/biases": b}


def unpack_network(
    header: dict[str, Any], arrays: dict[str, Array], inputs: int, outputs: int, name: str = "network"
) -> Network:
    """Return the network of that name, with so many inputs and outputs."""
    layers = range(int(header["layers"]))
    network = Network(
        header["activation"],
        tuple(arrays[f"{name}/{i}/weights"] for i in layers),
        tuple(arrays[f"{name}/{i}/biases"] for i in layers),
    )
    if network.weights and (network.weights[0].shape[1], len(network.weights[-1])) != (inputs, outputs):
        raise ValueError(f"expected a network of {inputs} inputs and {outputs} outputs")
    if not network.weights and outputs:
        raise ValueError("a network without layers")
    return network
