"""Made-up cubic cell with a potential, in closed form, and its training set.

With E = (FᵀF − I)/2 and J = det F,

    W = φ_s Ψ(F) − φ_f p J − ½ S p² + ½ a Σ_i E_ii² + b p Σ_{i<j} E_ij² + c E_11 E_22 E_33
    <∇u¹> = F (k₁ E + k₂ tr E I + k₃ diag E + k₄ E² + p (k₅ I + k₆ E))

which is objective, has the symmetry of the cube and no other, and is no polynomial in ln U. Nothing of it uses
eigenvectors or logarithms of tensors.
"""

from __future__ import annotations

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC, cofactor, cofactor_tangent, determinant
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status

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
    """All responses of n states with their derivatives."""
    H, p = states.grad_u, states.p
    n, eye = len(p), np.eye(3)
    F = eye + H
    E = (F.swapaxes(1, 2) @ F - eye) / 2
    material, J, cof = NeoHookean(), determinant(F), cofactor(F)
    solid, fluid = SOLID_FRACTION, 1 - SOLID_FRACTION
    value, by_E, by_EE, by_Ep = _energy(E, p)
    stress = solid * material.stress(F) - fluid * p[:, None, None] * cof + F @ by_E
    stiffness = solid * material.tangent(F) - fluid * p[:, None, None, None, None] * cofactor_tangent(F)
    stiffness += np.einsum("ik,njl->nijkl", eye, by_E)
    stiffness += np.einsum("nia,najbl,nkb->nijkl", F, by_EE, F)
    stress_p = -fluid * cof + F @ by_Ep
    off = E[:, [0, 0, 1], [1, 2, 2]]
    G, G_F, G_p = _mean_grad(F, E, p)
    return CellResponse(
        mean_grad=G,
        status=np.full(n, int(Status.converged), dtype=np.int64),
        potential=solid * material.energy_density(F) - fluid * p * J - STORAGE / 2 * p**2 + value,
        stress=stress,
        fluid_volume=fluid * J + STORAGE * p - BEND[1] * (off**2).sum(axis=1),
        tangent=CellTangent(
            mean_grad_grad_u=G_F,
            mean_grad_p=G_p,
            stress_grad_u=stiffness,
            stress_p=stress_p,
            fluid_volume_grad_u=-stress_p,
            fluid_volume_p=np.full(n, STORAGE),
        ),
    )


def potential_training_set(n: int = 40, seed: int = 0, inputs: InputSpace = INPUTS) -> TrainingSet:
    """``n`` states, uniform at random in the box of ``inputs`` by ``seed``."""
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(seed).random((n, len(inputs))))
    return TrainingSet(states, respond(states), inputs, respond(MacroState.zeros(1)), IDENTITY, {}, CUBIC)


def _energy(E: Array, p: Array) -> tuple[Array, Array, Array, Array]:
    """The cubic part of W, its derivatives by E (n, 3, 3) and (n, 3, 3, 3, 3), and that by E and p."""
    a, b, c = BEND
    n, i = len(p), np.arange(3)
    d = E[:, i, i]
    product = np.stack([d[:, 1] * d[:, 2], d[:, 0] * d[:, 2], d[:, 0] * d[:, 1]], axis=1)
    shear = E.copy()
    shear[:, i, i] = 0.0
    value = a / 2 * (d**2).sum(axis=1) + b / 2 * p * (shear**2).sum(axis=(1, 2)) + c * d.prod(axis=1)
    by_E = b * p[:, None, None] * shear
    by_E[:, i, i] = a * d + c * product
    by_EE = np.zeros((n, 3, 3, 3, 3))
    for k in range(3):
        for m in range(3):
            if k == m:
                by_EE[:, k, k, k, k] = a
            else:
                # Symmetric in each pair, so that both places of a shear count.
                by_EE[:, k, m, k, m] += b * p / 2
                by_EE[:, k, m, m, k] += b * p / 2
                by_EE[:, k, k, m, m] = c * d[:, 3 - k - m]
    return value, by_E, by_EE, b * shear


def _mean_grad(F: Array, E: Array, p: Array) -> tuple[Array, Array, Array]:
    """<∇u¹> (n, 3, 3) and its derivatives by F (n, 3, 3, 3, 3) and by p (n, 3, 3)."""
    k1, k2, k3, k4, k5, k6 = MEAN
    eye, i = np.eye(3), np.arange(3)
    trace, p1 = np.trace(E, axis1=1, axis2=2)[:, None, None], p[:, None, None]
    diagonal = np.zeros_like(E)
    diagonal[:, i, i] = E[:, i, i]
    M = k1 * E + k2 * trace * eye + k3 * diagonal + k4 * E @ E + p1 * (k5 * eye + k6 * E)
    M_p = k5 * eye + k6 * E
    # ∂E_ab/∂F_kl = (δ_al F_kb + F_ka δ_bl)/2.
    E_F = (np.einsum("al,nkb->nabkl", eye, F) + np.einsum("nka,bl->nabkl", F, eye)) / 2
    only = np.einsum("ab,ac->abc", eye, eye)
    M_F = (
        (k1 + k6 * p[:, None, None, None, None]) * E_F
        + k2 * np.einsum("ab,ncckl->nabkl", eye, E_F)
        + k3 * np.einsum("abc,ncckl->nabkl", only, E_F)
        + k4 * (np.einsum("nackl,ncb->nabkl", E_F, E) + np.einsum("nac,ncbkl->nabkl", E, E_F))
    )
    G_F = np.einsum("ik,nlj->nijkl", eye, M) + np.einsum("nia,najkl->nijkl", F, M_F)
    return F @ M, G_F, F @ M_p
