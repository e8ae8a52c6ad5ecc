"""Quantities of the paper's figures from the responses along a load, by name and unit."""

from __future__ import annotations

from itertools import product

import numpy as np

from porocore.core.tensors.cofactors import determinant
from porocore.macro.laws.pull_back import ConductivityLaw, PulledBack
from porocore.states import Array, CellResponse, MacroState

#: Of the largest K_ii: what is less is no conductivity but round-off, as across a single channel.
NO_FLOW = 1e-9
#: By the first part of a name; all others are plain numbers.
_WITH_UNIT = {"Q": "compliance", "biot": "stress"} | dict.fromkeys(
    ("avg_energy", "max_energy"), "energy-density"
)


def quantity_of(name: str) -> str:
    """Return the quantity of one of :func:`quantities` for its unit; '' is a plain number."""
    return _WITH_UNIT.get(name, _WITH_UNIT.get(name.partition("_")[0], ""))


def _by_component(name: str, tensors: Array) -> dict[str, Array]:
    """``name_ij…`` → (n,) of n tensors."""
    rows = tensors.reshape(len(tensors), -1)
    indices = product("123", repeat=tensors.ndim - 1)
    return {f"{name}_{''.join(ijkl)}": rows[:, k] for k, ijkl in enumerate(indices)}


def quantities(
    states: MacroState,
    response: CellResponse,
    porosity: float,
    conductivity: Array,
    law: ConductivityLaw = "piola-unrotated",
) -> dict[str, Array]:
    r"""Name → (n,), NaN where a state has no values, or the cell solver does not provide them.

    Definitions of Dehghani & Zilian (eqs. intavg_cell and intavg_domain): the "integral average" <·>_s is per
    volume of the whole cell, and the "average", written with a bar, is that of the solid, <·>_s/φ_s. Their figures of
    averages show the latter; Ĵ, the "RVE volumetric strain", is taken of it as well, like F̄.

    ==================  ==================================================================================
    ``mean_grad_ij``    <∂u¹_i/∂Y_j>_s [–]
    ``avg_grad_ij``     <∂u¹_i/∂Y_j>_s/φ_s, the average of the paper's figures [–]
    ``max_grad_ij``     largest \|∂u¹_i/∂Y_j\| in the solid [–]
    ``avg_energy``      <Ψ>_s/φ_s [E]
    ``max_energy``      largest Ψ [E]
    ``J_bar``           det F̄, F̄ = I + H + <∇u¹>_s/φ_s [–]
    ``J_hat``           Ĵ = det(I + <∇u¹>_s/φ_s) [–]
    ``Kt_ii``           (K_t)_ii/K_ii of K_t = K_ref/det F̄, K that of the undeformed cell and K_ref by the
                        conductivity law, for the paper Ḡ K F̄⁻ᵀ; NaN where K_ii = 0 [–]
    ``M_ijkl``          ∂<∂u¹_i/∂Y_j>_s/∂H_kl [–]
    ``M_hat_ijkl``      Ĵ M_ijkl [–]
    ``Q_ij``            ∂<∂u¹_i/∂Y_j>_s/∂p [1/E]
    ``Q_hat_ij``        Ĵ Q_ij [1/E]
    ``biot``            Biot modulus −1/tr Q [E]
    ``biot_hat``        −1/(Ĵ tr Q) [E]
    ==================  ==================================================================================

    Parameters
    ----------
    states, response
        n of them, with tangent; without extrema the maxima and the energy are NaN.
    porosity
        φ_f of the undeformed cell.
    conductivity : (3, 3)
        Of the undeformed cell.
    law
        Of the flux, by default the paper's.
    """
    assert response.tangent is not None
    assert response.tangent.mean_grad_grad_u is not None
    assert response.tangent.mean_grad_p is not None
    solid = 1 - porosity
    average = response.mean_grad / solid
    normalised, J_bar = _normalised_conductivity(states, response, solid, conductivity, law)
    J_hat = determinant(np.eye(3) + average)
    M, Q = response.tangent.mean_grad_grad_u, response.tangent.mean_grad_p
    biot = -1 / np.trace(Q, axis1=1, axis2=2)
    found = _by_component("mean_grad", response.mean_grad) | _by_component("avg_grad", average)
    found |= _extrema(response, solid)
    found |= {"J_bar": J_bar, "J_hat": J_hat}
    found |= {f"Kt_{i + 1}{i + 1}": normalised[:, i] for i in range(3)}
    found |= _by_component("M", M)
    found |= _by_component("M_hat", J_hat[:, None, None, None, None] * M)
    found |= _by_component("Q", Q) | _by_component("Q_hat", J_hat[:, None, None] * Q)
    found |= {"biot": biot, "biot_hat": biot / J_hat}
    return found


def _normalised_conductivity(
    states: MacroState, response: CellResponse, solid: float, conductivity: Array, law: ConductivityLaw
) -> tuple[Array, Array]:
    """Return (K_t)_ii/K_ii (n, 3) and det F̄ (n,)."""
    no_flow = np.zeros((len(states), 3))
    pulled = PulledBack.from_states(
        states, response.mean_grad, no_flow, solid, conductivity, law, response.conductivity
    )
    K_ii = np.diag(conductivity)
    K_ii = np.where(K_ii > NO_FLOW * K_ii.max(), K_ii, np.nan)
    return np.diagonal(pulled.conductivity, axis1=1, axis2=2) / pulled.J[:, None] / K_ii, pulled.J


def _extrema(response: CellResponse, solid: float) -> dict[str, Array]:
    """Return the largest values and the mean energy, NaN where the cell solver does not provide them."""
    extrema, unknown = response.extrema, np.full(len(response), np.nan)
    grad = np.full_like(response.mean_grad, np.nan) if extrema is None else extrema.grad
    return _by_component("max_grad", grad) | {
        "avg_energy": unknown if extrema is None else extrema.energy_mean / solid,
        "max_energy": unknown if extrema is None else extrema.energy,
    }
