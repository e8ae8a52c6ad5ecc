"""Training of a potential's network by L-BFGS on values and gradients; interface of derivatives.

The loss is written once, in operations that torch and jax.numpy share; a backend compiles it with its own
automatic differentiation, and scipy's L-BFGS minimises it. The network enters as it is used: its expansion at rest
up to second order is subtracted, since these orders are known exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.optimize import minimize

from porocore.interfaces.surrogate import OnProgress, TrainingProgress
from porocore.states import Array
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.separable import low_orders
from porocore.surrogates.polynomial.monomials import Terms
from porocore.surrogates.potential import PotentialData

#: L-BFGS keeps 50 steps.
STOPPING = {"maxcor": 50, "ftol": 1e-14, "gtol": 1e-9}
REPORT_INTERVAL = 25

#: Loss of the flat parameters, in the arrays of a library.
Loss = Callable[[Any, Any], Any]


class Autodiff(Protocol):
    """Automatic differentiation of a library."""

    def compile(self, loss: Loss, constants: dict[str, Array]) -> Callable[[Array], tuple[float, Array]]:
        """Return θ (numpy, float64) → ``loss(θ, constants)`` and its gradient.

        ``constants`` reach the loss as arrays of the library.
        """

    @property
    def xp(self) -> Any:
        """Namespace of the library, with ``tanh``, ``exp``, ``log1p``, ``abs`` and ``einsum``."""


@dataclass(frozen=True, eq=False)
class SobolevProblem:
    """Regression problem of the network: the remainder of ``W₂`` (and a polynomial), in k terms.

    Attributes
    ----------
    terms
        t, those that some state moves.
    middle, half : (k,)
        Middle and half width of their ranges.
    scale
        Unit of the remainder.
    x : (n, k)
        Scaled terms (t − middle)/half.
    rest : (1, k)
        Scaled terms at rest.
    jacobian : (k, d, n)
        ∂x/∂y for the d variables y by which some term changes.
    value : (n,), gradients : (d, n)
        Targets, divided by the scale.
    value_weight, gradient_weight : float, (d,)
        1/variance.
    """

    terms: Terms
    middle: Array
    half: Array
    scale: float
    x: Array
    rest: Array
    jacobian: Array
    value: Array
    gradients: Array
    value_weight: float
    gradient_weight: Array

    @classmethod
    def from_remainder(
        cls, data: PotentialData, value: Array, gradient: Array, terms: Terms, *, gradients: bool = True
    ) -> SobolevProblem:
        """Return the problem of a remainder of W (n,) and of ∂W/∂y (7, n); without ``gradients`` values only.

        Terms that no state moves are left out.
        """
        active = list(data.active)
        y = np.zeros_like(data.y)
        y[active] = data.y[active]
        kept = np.flatnonzero(np.ptp(terms.polynomial.evaluate(y), axis=1))
        terms = terms.subset(tuple(int(k) for k in kept))
        t, jacobian, _ = terms.polynomial.derivatives(y, second=False)
        low, high = t.min(axis=1), t.max(axis=1)
        middle, half = (low + high) / 2, (high - low) / 2
        half_range = np.ptp(y[active], axis=1) / 2
        scale = float(np.sqrt((gradient[active] ** 2 * half_range[:, None] ** 2).mean())) or 1.0
        # Combinations of variables have gradients by those too that no state moves.
        moving = np.flatnonzero(jacobian.any(axis=(0, 2)))
        errors = data.scales[1:][moving]
        return cls(
            terms,
            middle,
            half,
            scale,
            ((t - middle[:, None]) / half[:, None]).T,
            -(middle / half)[None],
            jacobian[:, moving] / half[:, None, None],
            value / scale,
            gradient[moving] / scale,
            float((scale / data.scales[0]) ** 2),
            (scale / errors) ** 2 if gradients else np.zeros(len(moving)),
        )

    def loss(self, xp: Any, shapes: list[tuple[int, int]], activation: str) -> Loss:
        """Return the loss: the weighted mean square of the errors of value and gradient."""

        def evaluate(theta: Any, constants: Any) -> Any:
            layers = unpack_layers(theta, shapes)
            value, slope = _forward(xp, layers, activation, constants["x"])
            v0, g0, h0 = _second_order(xp, layers, activation, constants["rest"])
            g0, h0 = g0 * constants["first"], h0 * constants["second"]
            away = constants["x"] - constants["rest"]
            h0_away = away @ h0
            value = value - v0 - away @ g0 - (away * h0_away).sum(1) / 2
            slope = xp.einsum("nk,kdn->dn", slope - g0 - h0_away, constants["jacobian"])
            value_error = (value - constants["value"]) ** 2 * self.value_weight
            gradient_error = (slope - constants["gradients"]) ** 2 * constants["gradient_weight"][:, None]
            return value_error.mean() + gradient_error.sum(0).mean()

        return evaluate

    def unscaled(self, network: Network) -> Network:
        """Return the network as a function of t, in units of W."""
        first, *others = network.weights
        weights, biases = [first / self.half, *others], list(network.biases)
        biases[0] = biases[0] - weights[0] @ self.middle
        return Network(
            network.activation,
            (*weights[:-1], weights[-1] * self.scale),
            (*biases[:-1], biases[-1] * self.scale),
        )

    def constants(self) -> dict[str, Array]:
        """Return the arrays of the loss."""
        first, second = low_orders(self.terms)
        names = ("x", "rest", "jacobian", "value", "gradients", "gradient_weight")
        return {name: getattr(self, name) for name in names} | {"first": first, "second": second}


def train(
    problem: SobolevProblem,
    autodiff: Autodiff,
    *,
    hidden: tuple[int, ...],
    activation: str,
    seed: int,
    iterations: int,
    on_progress: OnProgress | None = None,
) -> Network:
    """Return the network after L-BFGS; the first weights depend on ``seed`` only, in every library."""
    shapes = [(b, a) for a, b in itertools.pairwise((problem.x.shape[1], *hidden, 1))]
    function = autodiff.compile(problem.loss(autodiff.xp, shapes, activation), problem.constants())
    theta = minimised(function, first_weights(shapes, activation, seed), iterations, on_progress)
    return layered_network(theta, shapes, activation)


def minimised(
    function: Callable[[Array], tuple[float, Array]],
    theta: Array,
    iterations: int,
    on_progress: OnProgress | None = None,
) -> Array:
    """Return the parameters after L-BFGS on a loss and its gradient, from ``theta`` on."""
    done = 0

    def report(state: Any) -> None:
        nonlocal done
        done += 1
        if on_progress is not None and done % REPORT_INTERVAL == 0:
            loss = float(function(state)[0])
            on_progress(TrainingProgress(done, iterations, loss, unit="iterations"))

    # The remainder of a polynomial may be so small that L-BFGS, whose limits are absolute, would not start.
    unit = function(theta)[0] or 1.0

    def scaled(parameters: Array) -> tuple[float, Array]:
        loss, gradient = function(parameters)
        return loss / unit, gradient / unit

    found = minimize(
        scaled,
        theta,
        jac=True,
        method="L-BFGS-B",
        callback=report,
        options=STOPPING | {"maxiter": iterations, "maxfun": 2 * iterations},
    )
    if on_progress is not None:
        loss = unit * float(found.fun)
        ended = _ending(int(found.status), done, iterations)
        on_progress(TrainingProgress(done, iterations, loss, unit="iterations", ended=ended))
    theta = found.x
    return theta


def _ending(status: int, done: int, iterations: int) -> str:
    """Return how L-BFGS ended, given its status in scipy."""
    if status == 0:
        return "converged"
    if status == 1:
        return f"stopped by the limit of {'iterations' if done >= iterations else 'evaluations'}"
    return "stopped where no step lowers the loss"


def first_weights(shapes: list[tuple[int, int]], activation: str, seed: int) -> Array:
    """Return normal weights that keep the size of the signal (Glorot & Bengio 2010); biases uniform in ± ½."""
    random = np.random.default_rng(seed)
    gain = 4.0 if activation == "sigmoid" else 1.0
    parts = []
    for rows, columns in shapes:
        parts.append(random.normal(size=rows * columns) * gain * np.sqrt(2 / (rows + columns)))
        parts.append(random.uniform(-0.5, 0.5, size=rows))
    return np.concatenate(parts)


def unpack_layers(theta: Any, shapes: list[tuple[int, int]]) -> list[tuple[Any, Any]]:
    """Return weights and biases of each layer from one vector of parameters."""
    layers, at = [], 0
    for rows, columns in shapes:
        W = theta[at : at + rows * columns].reshape(rows, columns)
        at += rows * columns
        layers.append((W, theta[at : at + rows]))
        at += rows
    return layers


def layered_network(theta: Array, shapes: list[tuple[int, int]], activation: str) -> Network:
    """Return the network whose parameters are θ (parameters,)."""
    weights, biases = zip(*((W.copy(), b.copy()) for W, b in unpack_layers(theta, shapes)), strict=True)
    return Network(activation, weights, biases)


def activate(xp: Any, name: str, z: Any) -> tuple[Any, Any, Any]:
    """Return σ, σ′ and σ″."""
    if name == "tanh":
        a = xp.tanh(z)
        slope = 1 - a * a
        return a, slope, -2 * a * slope
    s = (1 + xp.tanh(z / 2)) / 2
    slope = s * (1 - s)
    if name == "sigmoid":
        return s, slope, slope * (1 - 2 * s)
    return xp.log1p(xp.exp(-xp.abs(z))) + (z + xp.abs(z)) / 2, s, slope


def _forward(xp: Any, layers: list[tuple[Any, Any]], activation: str, x: Any) -> tuple[Any, Any]:
    """Return values (m,) and gradients (m, d) of a network with one output."""
    a: Any = x
    J: Any = None
    for i, (W, b) in enumerate(layers):
        z = a @ W.T + b
        J = W[None] if J is None else xp.einsum("oi,mid->mod", W, J)
        if i < len(layers) - 1:
            a, slope, _ = activate(xp, activation, z)
            J = slope[:, :, None] * J
    return z[:, 0], J[:, 0, :]


def _second_order(xp: Any, layers: list[tuple[Any, Any]], activation: str, x: Any) -> tuple[Any, Any, Any]:
    """Return value, gradient (d,) and Hessian (d, d) at one point (1, d)."""
    a: Any = x[0]
    J: Any = None
    H: Any = None
    for i, (W, b) in enumerate(layers):
        z = W @ a + b
        J = W if J is None else W @ J
        H = None if H is None else xp.einsum("oi,icd->ocd", W, H)
        if i < len(layers) - 1:
            a, slope, curvature = activate(xp, activation, z)
            second = curvature[:, None, None] * J[:, :, None] * J[:, None, :]
            H = second if H is None else slope[:, None, None] * H + second
            J = slope[:, None] * J
    return z[0], J[0], J[0][:, None] * 0 * J[0][None, :] if H is None else H[0]
