"""Domain integrals and extrema at an equilibrium, its sensitivities to the loads, second derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.states import Array


@dataclass(frozen=True, eq=False)
class DomainIntegrals:
    """Integrals over the domain without contact, and extrema over its quadrature points."""

    grad: Array  #: (3, 3)  ∫ ∇u¹ dV
    stress: Array  #: (3, 3)  ∫ (P + p cof F) dV
    volume: float  #: ∫ J dV
    energy: float  #: ∫ Ψ dV
    largest_grad: Array  #: (3, 3)  of |∂u¹_i/∂Y_j|
    largest_energy: float  #: of Ψ


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Sensitivities of the equilibrium to k of the ten loads θ = (H_11, H_12, …, H_33, p).

    Attributes
    ----------
    displacement : (k, nodes, 3)
        u_θ at the nodes of the mesh; NaN where the linear solver did not reach its tolerance.
    grad : (k, 3, 3)
        ∫ ∇u_θ dV.
    second : (k, k)
        ∂²Π/∂θ∂θ' at equilibrium: Π_θθ' + R_θᵀ u_θ' with R = ∂Π/∂u. Contact contributes to the second term only.
    negative : int
        Number of negative eigenvalues of the tangent as far as the way here told; 1 for one or more by a solver without
        pivots, -1 where it did not tell.
    """

    displacement: Array
    grad: Array
    second: Array
    negative: int = -1


def second_derivatives(columns: Sequence[int], stresses: Array) -> Array:
    """Return ∂²Π/∂θ∂θ' at fixed u¹, (k, k), from the slopes (k, 9) of ∫ (P + p cof F) dV; Π is linear in p."""
    found = np.hstack([stresses, np.zeros((len(stresses), 1))])[:, list(columns)]
    by_pressure = np.array(columns) == 9
    found[:, by_pressure] = found[by_pressure].T
    return found
