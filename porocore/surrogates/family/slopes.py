"""Derivatives of the responses of a family's model by the parameters, exact for the model."""

from __future__ import annotations

import numpy as np

from porocore.states import Array, CellSlopes, MacroState
from porocore.surrogates.family.derivatives import Scaling
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.rest import RestValues
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.polynomial.terms import VARIABLES


def family_slopes(model: FamilyModel, states: MacroState) -> CellSlopes:
    """Return the derivatives of all responses but the conductivity by the m parameters, at fixed (H, p)."""
    theta, stretch, y, at, scaling = model.at_states(states, slopes=True)
    parameters, n = model.rest.parameters, len(states)
    m = len(parameters.kinds)
    value, gradient, hessian = model.potential(y, at)
    by, c = scaling.variables, scaling.factor
    W, T = np.zeros((m, n)), np.zeros((7, m, n))
    mean, rows = model.mean_part(y, at, by_coordinates=True)
    mean_slopes = np.zeros((9, VARIABLES + len(at.x), n))
    for place, row in rows.items():
        mean_slopes[place] = row
    more, porosity = np.zeros((9, m, n)), np.zeros((m, n))
    learned = parameters.learned
    W[learned], T[:, learned], more[:, learned] = _learned(model, y, at, mean_slopes)
    W[learned] *= c
    T[:, learned] *= (by * c)[:, None]
    more[:, learned] *= scaling.stretch
    assert at.slopes is not None
    porosity[learned] = at.slopes.porosity
    for k, kind in enumerate(parameters.kinds):
        if kind in ("modulus", "swelling"):
            W[k], T[:, k], more[:, k] = _exact(
                kind, theta[:, k], y, scaling, (value, gradient, hessian), mean, mean_slopes
            )
    R = stretch.rotations
    turned = np.moveaxis(more, -1, 0).reshape(n, 3, 3, m)
    return CellSlopes(
        potential=W.T.copy(),
        stress=np.stack(stretch.stresses(*(T[:6, k] for k in range(m))), axis=-1),
        fluid_volume=-T[6].T,
        porosity=porosity.T.copy(),
        mean_grad=turned if R is None else np.einsum("nij,njkm->nikm", R, turned),
    )


def _learned(model: FamilyModel, y: Array, at: RestValues, mean_slopes: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of w (l, n), ∂w/∂y (7, l, n) and Rᵀ⟨∇u¹⟩ (9, l, n) by the learned parameters."""
    s, l = at.slopes, len(at.x)
    assert s is not None
    linear = _summed(np.moveaxis(s.matrix, 1, 2), y)
    W = s.value + ((s.gradient + linear / 2) * y[:, None]).sum(axis=0)
    T = s.gradient + linear
    beyond = len(model.training_box.beyond(y)) > 0
    parts = (model.coarse, model.fine) if beyond else (model.whole,)
    for part in (*parts, model.network):
        if part is None:
            continue
        first: Array | float = 1.0
        z = y
        if beyond and part is not model.coarse:
            z, first, _ = model.training_box.saturated(y)
        x = np.broadcast_to(at.x, (l, y.shape[1])) if part is model.network else at.x
        value, by_y, by_x, by_yx = part.by_coordinates(z, x)
        W = W + s.scale * value + at.scale * _chained(by_x, s.x)
        across = _chained(by_yx, s.x) * at.scale + by_y[:, None] * s.scale
        T = T + across * (first if isinstance(first, float) else first[:, None])
    mean = s.mean_value + _summed(np.moveaxis(s.mean, 1, 2), y) + _chained(mean_slopes[:, VARIABLES:], s.x)
    return W, T, mean


def _summed(rows: Array, y: Array) -> Array:
    """Return the sums (..., l, n) over the variables of rows (..., l, a, n) times y (a, n); one row may be for all."""
    if rows.shape[-1] == 1:
        return np.asarray(rows[..., 0] @ y)
    return np.asarray(np.einsum("olan,an->oln", rows, y))


def _chained(by_x: Array, slopes: Array) -> Array:
    """Return derivatives (..., l, n) by θ from those (..., c, n) by θ̂ and ∂θ̂/∂θ (c, l, n), which may be one for all."""
    if slopes.shape[-1] == 1:
        return np.asarray(slopes[..., 0].T @ by_x)
    return np.asarray(np.einsum("...cn,cln->...ln", by_x, slopes))


def _exact(
    kind: str, theta: Array, y: Array, scaling: Scaling, w: Derivatives, mean: Array, mean_slopes: Array
) -> tuple[Array, Array, Array]:
    """Return the derivatives of W, ∂W/∂y and ⟨∇u¹⟩ by the modulus or the swelling stretch, from the scaling of w."""
    value, gradient, hessian = w
    by, c = scaling.variables, scaling.factor
    change = np.zeros_like(y)
    if kind == "modulus":
        change[6] = -y[6] / theta
    else:
        change[:3] = -1 / theta
    power = 1 if kind == "modulus" else 3
    W = c * (power / theta * value + (gradient * change).sum(axis=0))
    T = c * by * (power / theta * gradient + np.einsum("abn,bn->an", hessian, change))
    if kind == "modulus":
        T[6] -= c * by[6] / theta * gradient[6]
    more = scaling.stretch * np.einsum("oan,an->on", mean_slopes[:, :VARIABLES], change)
    return W, T, more if kind == "modulus" else more + mean * scaling.stretch / theta
