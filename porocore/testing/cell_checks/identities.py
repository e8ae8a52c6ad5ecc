"""Identities of every cell as misfits: Biot, reciprocity, cubic symmetry; difference quotients.

Misfits are relative to the largest entry of what is compared, unless said otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array, CellResponse, CellTangent, MacroState
from porocore.testing.expect import STEPS, central_difference


def misfit(found: Array, expected: Array) -> float:
    """Largest difference over the largest entry of ``expected``."""
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


def uniform_pressure(tangent: CellTangent, poisson_ratio: float) -> float:
    """Q_ii = (1 − 2ν)(M_iiii + M_iijj + M_iikk) at rest, for pores of any shape in a homogeneous isotropic solid.

    A pressure on solid and pore alike, uniform, compresses both alike.
    """
    M, Q = _require(tangent.mean_grad_grad_u), _require(tangent.mean_grad_p)
    return misfit(np.diag(Q), (1 - 2 * poisson_ratio) * np.einsum("iikk->i", M))


def biot_forms(linear: LinearCoefficients) -> float:
    """φ_f I − I:M = φ_f I − C:Q: what pressure takes of the stress is what strain sets free of the fluid."""
    return misfit(linear.biot_of_stress, linear.biot)


def biot_modulus(linear: LinearCoefficients, porosity: float, poisson_ratio: float) -> float:
    """M_B of :func:`biot_forms` [E], K_s/(α − φ_f) with K_s = 1/(3(1 − 2ν)), against which −1/tr Q can be held."""
    alpha = float(np.trace(linear.biot)) / 3
    return 1 / (3 * (1 - 2 * poisson_ratio) * (alpha - porosity))


def cubic_symmetry(M: Array) -> float:
    """Return the worst change of M (3, 3, 3, 3) of a cubic cell under mirrors and permutations of the axes."""
    worst = 0.0
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            Q = np.diag(signs)[list(order)]
            worst = max(worst, misfit(np.einsum("ai,bj,ck,dl,ijkl->abcd", Q, Q, Q, Q, M), M))
    return worst


def major_symmetry(tangent: CellTangent) -> float:
    """∂P_E/∂H = (∂P_E/∂H)ᵀ: there is a potential."""
    A = _require(tangent.stress_grad_u).reshape(9, 9)
    return misfit(A.T, A)


def reciprocity(tangent: CellTangent) -> float:
    """∂P_E/∂p = −∂φ/∂H: there is a potential of H and p."""
    return misfit(-_require(tangent.fluid_volume_grad_u), _require(tangent.stress_p))


def objectivity(straight: CellResponse, turned: CellResponse, R: Array) -> dict[str, float]:
    """One row each, at F and at R F: W and φ do not feel the rotation, P_E and <∇u¹> turn with it."""
    return {
        name: misfit(_require(getattr(turned, name)), turn @ value if turn.size else value)
        for name, turn, value in (
            ("potential", np.empty(0), _require(straight.potential)),
            ("fluid_volume", np.empty(0), _require(straight.fluid_volume)),
            ("stress", R, _require(straight.stress)),
            ("mean_grad", R, straight.mean_grad[0]),
        )
    }


def linear_changes(at: CellResponse, dH: Array, dp: float) -> dict[str, Array]:
    """Change of each response of one row in a direction, by its derivatives; that of W is P_E:dH − φ dp."""
    t = at.tangent
    assert t is not None

    def slope(by_H: Array | None, by_p: Array | None) -> Array:
        total: Array = np.tensordot(_require(by_H), dH, axes=2) + _require(by_p) * dp
        return total

    assert at.fluid_volume is not None
    return {
        "mean_grad": slope(t.mean_grad_grad_u, t.mean_grad_p),
        "stress": slope(t.stress_grad_u, t.stress_p),
        "fluid_volume": slope(t.fluid_volume_grad_u, t.fluid_volume_p),
        "potential": slope(at.stress, -at.fluid_volume),
    }


def stencil_states(H: Array, p: float, dH: Array, dp: float, h: float) -> list[MacroState]:
    """Return the states of the stencil of :func:`difference_quotients`."""
    return [MacroState.single(H + k * h * dH, p + k * h * dp) for k in STEPS]


def difference_quotients(steps: Sequence[CellResponse], h: float) -> dict[str, Array]:
    """Return the derivative of each response in a direction, by differences at :func:`stencil_states`."""
    found = {}
    for name in ("mean_grad", "stress", "fluid_volume", "potential"):
        values = [_require(getattr(step, name)) for step in steps]
        found[name] = np.asarray(central_difference(values, h))
    return found


def _require(array: Array | None) -> Array:
    """The one row of a response that must be provided."""
    assert array is not None
    row: Array = array[0]
    return row
