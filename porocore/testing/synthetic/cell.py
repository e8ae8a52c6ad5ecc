"""Made-up cell in closed form: responses, exact derivatives, training set.

Nothing of it comes from a finite element solve. <∇u¹>_s has the size and the bend of that of the paper's cell;
stress and fluid volume derive from one potential.
"""

from __future__ import annotations

import numpy as np

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.inputs.input_space import InputSpace
from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.testing.synthetic.response import cubic_reference

#: Confined compression: the range of the two inputs that a synthetic training set samples.
INPUTS = InputSpace(("H22", "p"), (-0.20, -0.02), (0.04, 0.24))
IDENTITY = "synthetic-cell-1"
SOLID_FRACTION = 0.5877
#: How <∇u¹> bends: G = (M:H + Q p)/(1 + A tr H + B p) + C H·H + D p H.
A, B, C, D = 0.8, -0.5, -0.06, 0.4
#: Curvature of the potential in p.
STORAGE = 0.25


def respond(states: MacroState) -> CellResponse:
    """All responses of n states with their derivatives.

    G = <∇u¹>_s as above with the cubic M and Q of :func:`cubic_reference`; W = φ_s Ψ(F) − φ_f p J − ``STORAGE`` p²/2
    with F = I + H, so P_E = φ_s ∂Ψ/∂F − φ_f p cof F and φ = φ_f J + ``STORAGE`` p.
    """
    H, p = states.grad_u, states.p
    n = len(p)
    G, G_H, G_p = _mean_grad(H, p)
    material, F = NeoHookean(), np.eye(3) + H
    solid, fluid = SOLID_FRACTION, 1 - SOLID_FRACTION
    J, cof = determinant(F), cofactor(F)
    fluid_p = fluid * p
    tangent = CellTangent(
        mean_grad_grad_u=G_H,
        mean_grad_p=G_p,
        stress_grad_u=solid * material.tangent(F) - fluid_p[:, None, None, None, None] * cofactor_tangent(F),
        stress_p=-fluid * cof,
        fluid_volume_grad_u=fluid * cof,
        fluid_volume_p=np.full(n, STORAGE),
    )
    return CellResponse(
        mean_grad=G,
        status=np.full(n, int(Status.converged), dtype=np.int64),
        potential=solid * material.energy_density(F) - fluid_p * J - STORAGE / 2 * p**2,
        stress=solid * material.stress(F) - fluid_p[:, None, None] * cof,
        fluid_volume=fluid * J + STORAGE * p,
        tangent=tangent,
    )


def synthetic_training_set(n: int = 240, seed: int = 0) -> TrainingSet:
    """``n`` ≥ 4 states: the corners of :data:`INPUTS`, the rest uniform at random by ``seed``."""
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    unit = np.concatenate([corners, np.random.default_rng(seed).random((n - len(corners), 2))])
    states = INPUTS.scatter(low + (high - low) * unit)
    provenance = {"origin": "synthetic cell", "states": f"{n}, seed {seed}"}
    return TrainingSet(states, respond(states), INPUTS, respond(MacroState.zeros(1)), IDENTITY, provenance)


def _mean_grad(H: Array, p: Array) -> tuple[Array, Array, Array]:
    """G (n, 3, 3), ∂G/∂H (n, 3, 3, 3, 3), ∂G/∂p (n, 3, 3)."""
    linear = cubic_reference().tangent
    assert linear is not None
    assert linear.mean_grad_grad_u is not None
    assert linear.mean_grad_p is not None
    M, Q, eye = linear.mean_grad_grad_u[0], linear.mean_grad_p[0], np.eye(3)
    r = 1 / (1 + A * np.trace(H, axis1=1, axis2=2) + B * p)
    L = np.einsum("ijkl,nkl->nij", M, H) + Q * p[:, None, None]
    r1, r4, p1, p4 = (
        r[:, None, None],
        r[:, None, None, None, None],
        p[:, None, None],
        p[:, None, None, None, None],
    )
    G = L * r1 + C * H @ H + D * p1 * H
    G_H = (
        M * r4
        - A * r4**2 * np.einsum("nij,kl->nijkl", L, eye)
        + C * (np.einsum("ik,nlj->nijkl", eye, H) + np.einsum("nik,jl->nijkl", H, eye))
        + D * p4 * np.einsum("ik,jl->ijkl", eye, eye)
    )
    G_p = Q * r1 - B * r1**2 * L + D * H
    return G, G_H, G_p
