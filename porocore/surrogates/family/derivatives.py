"""Solved states of a family as derivatives of w(y; θ), that of a cell of unit modulus without swelling.

With Young's modulus E of the whole solid and its swelling stretch λ,

    W(ln U, p; θ) = E λ³ w(ln U − ln λ I, p/E; θ̂),   ⟨∇u¹⟩(ln U, p; θ) = λ ⟨∇u¹⟩(ln U − ln λ I, p/E; θ̂),

so that neither needs samples. The derivatives by the other parameters are at fixed (ln U, p), as those at fixed (H, p).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.errors import DataError
from porocore.states import Array, CellResponse, MacroState
from porocore.surrogates.family.coordinates import ParameterMap, Scaling
from porocore.surrogates.potential import unrotated, variables
from porocore.surrogates.stretch import LogStretch

#: Responses from which the potential is learned.
NEEDED = ("potential", "stress", "fluid_volume", "tangent")


@dataclass(frozen=True, eq=False)
class PotentialSlopes:
    """Values and derivatives of w and of ⟨∇u¹⟩_s, unrotated, at n solved states.

    Attributes
    ----------
    y : (7, n)
        Variables of w.
    value : (n,), gradient : (7, n), hessian : (7, 7, n)
        w, ∂w/∂y and ∂²w/∂y².
    mean : (9, n), mean_gradient : (9, 7, n)
        Rᵀ⟨∇u¹⟩_s and its derivatives.
    by_theta : (l, n), gradient_by_theta : (7, l, n), mean_by_theta : (9, l, n)
        Derivatives of w, ∂w/∂y and ⟨∇u¹⟩ by the learned parameters; NaN where they are not known.
    """

    y: Array
    value: Array
    gradient: Array
    hessian: Array
    mean: Array
    mean_gradient: Array
    by_theta: Array
    gradient_by_theta: Array
    mean_by_theta: Array

    @classmethod
    def from_states(
        cls, states: MacroState, responses: CellResponse, parameters: ParameterMap
    ) -> PotentialSlopes:
        """Return the derivatives at states with parameters.

        Raises
        ------
        DataError
            A response or a derivative is missing.
        """
        if missing := [name for name in NEEDED if getattr(responses, name) is None]:
            raise DataError(
                f"a potential is learned from {', '.join(missing)}, which these states lack; sample again"
            )
        theta, t = states.parameters, responses.tangent
        assert theta is not None
        assert t is not None
        assert responses.potential is not None
        assert responses.stress is not None
        assert responses.fluid_volume is not None
        if t.stress_grad_u is None or t.stress_p is None or t.fluid_volume_p is None:
            raise DataError("the derivatives of stress and fluid volume are missing; solve with tangent=True")
        stretch = LogStretch.from_gradient(states.grad_u)
        scaling = Scaling.from_parameters(parameters, theta)
        by = scaling.variables
        T = stretch.pull(np.moveaxis(responses.stress, 0, -1))
        gradient = np.concatenate([T, -responses.fluid_volume[None]])
        hessian = _hessian(stretch, T, t.stress_grad_u, t.stress_p, t.fluid_volume_p)
        mean, mean_gradient = unrotated(stretch, responses)
        by_theta, mixed, mean_slopes = _slopes(stretch, responses, parameters)
        c, turn = scaling.factor, scaling.stretch
        return cls(
            scaling.inner(variables(stretch, states.p)),
            responses.potential / c,
            gradient / by / c,
            hessian / by / by[:, None] / c,
            mean / turn,
            mean_gradient / by / turn,
            by_theta / c,
            mixed / by[:, None] / c,
            mean_slopes / turn,
        )


def _hessian(stretch: LogStretch, T: Array, stress_grad_u: Array, stress_p: Array, volume_p: Array) -> Array:
    """Return ∂²W/∂y² (7, 7, n) of y = (ln U, p) from the derivatives by (H, p) and T = ∂W/∂ln U (6, n)."""
    n = T.shape[1]
    curved = stress_grad_u - stretch.tangent(T, np.zeros((6, 6, n)))
    curved = curved.reshape(n, 9, 9)
    ways = np.stack([np.moveaxis(stretch.pull_direction(a), -1, 0).reshape(n, 9) for a in range(6)], axis=2)
    found = np.empty((7, 7, n))
    found[:6, :6] = np.moveaxis(ways.swapaxes(1, 2) @ curved @ ways, 0, -1)
    found[:6, 6] = found[6, :6] = stretch.pull(np.moveaxis(stress_p, 0, -1))
    found[6, 6] = -volume_p
    return (found + found.swapaxes(0, 1)) / 2


def _slopes(
    stretch: LogStretch, responses: CellResponse, parameters: ParameterMap
) -> tuple[Array, Array, Array]:
    """Return the slopes of W (l, n), ∂W/∂y (7, l, n) and Rᵀ⟨∇u¹⟩ (9, l, n) by the learned parameters, or NaN."""
    n, chosen, s = len(responses), parameters.learned, responses.slopes
    by_theta = np.full((len(chosen), n), np.nan)
    mixed, mean = np.full((7, len(chosen), n), np.nan), np.full((9, len(chosen), n), np.nan)
    if s is None:
        return by_theta, mixed, mean
    R = stretch.rotations
    for c, k in enumerate(chosen):
        if s.potential is not None:
            by_theta[c] = s.potential[:, k]
        if s.stress is not None and s.fluid_volume is not None:
            mixed[:6, c] = stretch.pull(np.moveaxis(s.stress[..., k], 0, -1))
            mixed[6, c] = -s.fluid_volume[:, k]
        if s.mean_grad is not None:
            turned = s.mean_grad[..., k] if R is None else R.swapaxes(1, 2) @ s.mean_grad[..., k]
            mean[:, c] = turned.reshape(n, 9).T
    return by_theta, mixed, mean
