"""Made-up cubic cell with a potential, in closed form, and its training set.

With E = (FᵀF − I)/2 and J = det F,

    W = φ_s Ψ(F) − φ_f p J − ½ S p² + ½ a Σ_i E_ii² + b p Σ_{i<j} E_ij² + c E_11 E_22 E_33
    <∇u¹> = F (k₁ E + k₂ tr E I + k₃ diag E + k₄ E² + p (k₅ I + k₆ E))

which is objective, has the symmetry of the cube and no other, and is no polynomial in ln U. Nothing of it uses
eigenvectors or logarithms of tensors.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC, cofactor, determinant
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import CellResponse, MacroState
from porocore.testing.synthetic.response import respond_by

#: All nine components of H and p.
INPUTS = InputSpace.from_ranges(
    {f"H{i}{j}": (-0.1, 0.1) for i in (1, 2, 3) for j in (1, 2, 3)} | {"p": (0.0, 0.1)}
)
IDENTITY = "potential-cell-1"
SOLID_FRACTION, STORAGE = 0.5877, 0.25
#: a, b, c of W.
BEND = (-0.12, 0.3, -0.4)
#: k₁ … k₆ of <∇u¹>.
MEAN = (-0.22, -0.07, -0.02, 0.1, -0.11, 0.3)


def respond(states: MacroState) -> CellResponse:
    """Return all responses of n states with their derivatives."""
    return respond_by(values, states)


def values(z: Any) -> dict[str, Any]:
    """Return W, P_E, φ and <∇u¹> at z (n, 10), which is H row by row and p."""
    p, eye, i = z[:, 9], np.eye(3), np.arange(3)
    F = eye + z[:, :9].reshape(-1, 3, 3)
    E, J, cof, material = (F.swapaxes(1, 2) @ F - eye) / 2, determinant(F), cofactor(F), NeoHookean()
    solid, fluid, (a, b, c) = SOLID_FRACTION, 1 - SOLID_FRACTION, BEND
    d, shear = E[:, i, i], E * (1 - eye)
    bend = a / 2 * (d**2).sum(axis=1) + b / 2 * p * (shear**2).sum(axis=(1, 2)) + c * d.prod(axis=1)
    by_E = b * p[:, None, None] * shear
    by_E[:, i, i] = a * d + c * np.stack([d[:, 1] * d[:, 2], d[:, 0] * d[:, 2], d[:, 0] * d[:, 1]], axis=1)
    k1, k2, k3, k4, k5, k6 = MEAN
    trace, p1 = np.trace(E, axis1=1, axis2=2)[:, None, None], p[:, None, None]
    M = k1 * E + k2 * trace * eye + k3 * E * eye + k4 * E @ E + p1 * (k5 * eye + k6 * E)
    return {
        "mean_grad": F @ M,
        "potential": solid * material.energy_density(F) - fluid * p * J - STORAGE / 2 * p**2 + bend,
        "stress": solid * material.stress(F) - fluid * p1 * cof + F @ by_E,
        "fluid_volume": fluid * J + STORAGE * p - b * (E[:, [0, 0, 1], [1, 2, 2]] ** 2).sum(axis=1),
    }


def potential_training_set(n: int = 40, seed: int = 0, inputs: InputSpace = INPUTS) -> TrainingSet:
    """``n`` states, uniform at random in the box of ``inputs`` by ``seed``."""
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(seed).random((n, len(inputs))))
    return TrainingSet(states, respond(states), inputs, respond(MacroState.zeros(1)), IDENTITY, {}, CUBIC)
