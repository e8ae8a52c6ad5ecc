"""Training the network of a potential on values and slopes together, in whatever library differentiates.

The loss is written once, in operations that torch and jax.numpy share; a backend compiles it with its own
automatic differentiation, and scipy's L-BFGS minimises it. The network enters as it is used: what it says at rest
up to second order is subtracted, so that training does not spend itself on what is known exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.optimize import minimize

from porocore.interfaces.surrogate import TrainingProgress
from porocore.states import Array
from porocore.surrogates.network import Network
from porocore.surrogates.potential import NetworkPart
from porocore.surrogates.potential_data import PotentialData
from porocore.surrogates.symmetry import cube_group

#: L-BFGS keeps this many steps.
MEMORY = 50
REPORT_INTERVAL = 25

#: Loss of the flat parameters, in the arrays of a library.
Loss = Callable[[Any, Any], Any]


class Autodiff(Protocol):
    """How a backend differentiates."""

    def compile(self, loss: Loss, constants: dict[str, Array]) -> Callable[[Array], tuple[float, Array]]:
        """``loss(θ, constants)`` → a function of θ (numpy, float64) that returns the loss and its gradient.

        ``constants`` reach the loss as arrays of the library.
        """

    #: The library's namespace, with ``tanh``, ``exp``, ``log1p``, ``abs``, ``stack`` and ``einsum``.
    xp: Any


@dataclass(frozen=True, eq=False)
class SobolevProblem:
    """What the network is to learn: the remainder that ``W₂`` (and a polynomial) leave over, at the active variables.

    Attributes
    ----------
    part
        Scaling and symmetry, with a network that is not used.
    images : (g n, d)
        Scaled inputs, with every image under the symmetry.
    rest : (1, d)
        Scaled inputs at rest.
    back : (g, d, d)
        Slopes with respect to the scaled inputs of each image → with respect to the active y.
    value : (n,), slopes : (d, n)
        Targets, divided by the scale.
    value_weight, slope_weight : float, (d,)
        1/variance.
    """

    part: NetworkPart
    images: Array
    rest: Array
    back: Array
    y: Array
    value: Array
    slopes: Array
    value_weight: float
    slope_weight: Array

    @classmethod
    def of(
        cls, data: PotentialData, value: Array, gradient: Array, *, symmetric: bool, slopes: bool = True
    ) -> SobolevProblem:
        """From what is left over of W (n,) and of ∂W/∂y (7, n); without ``slopes`` only values are learned."""
        active = list(data.active)
        y = data.y[active]
        low, high = y.min(axis=1), y.max(axis=1)
        group = cube_group(data.active) if symmetric else None
        if group is not None:  # the images fill the symmetric hull
            reach = np.abs(np.einsum("gab,bn->gan", group, y)).max(axis=(0, 2))
            low, high = (
                np.where(np.array(active) < 6, -reach, low),
                np.where(np.array(active) < 6, reach, high),
            )
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-12)
        scale = float(np.sqrt((gradient[active] ** 2 * half[:, None] ** 2).mean())) or 1.0
        g = np.eye(len(active))[None] if group is None else group
        images = ((np.einsum("gab,bn->gna", g, y) - middle) / half).reshape(-1, len(active))
        spread = data.scales
        errors = np.where(spread[1:][active] > 0, spread[1:][active], 1.0)
        part = NetworkPart(_nothing(len(active)), tuple(active), middle, half, scale, group)
        return cls(
            part,
            images,
            -(middle / half)[None],
            np.swapaxes(g, 1, 2) / half / len(g),
            y,
            value / scale,
            gradient[active] / scale,
            float((scale / spread[0]) ** 2),
            (scale / errors) ** 2 if slopes else np.zeros(len(active)),
        )

    def loss(self, xp: Any, shapes: list[tuple[int, int]], activation: str) -> Loss:
        """Weighted mean square of the errors of value and slopes."""
        g, n, d = len(self.back), len(self.value), len(self.y)

        def evaluate(theta: Any, constants: Any) -> Any:
            layers = unpack_layers(theta, shapes)
            value, slope = _forward(xp, layers, activation, constants["images"])
            value = value.reshape(g, n).sum(0) / g
            slope = xp.einsum("gab,gnb->an", constants["back"], slope.reshape(g, n, d))
            v0, g0, h0 = _second_order(xp, layers, activation, constants["rest"])
            g0 = xp.einsum("gab,b->a", constants["back"], g0)
            h0 = g * xp.einsum("gab,bc,gdc->ad", constants["back"], h0, constants["back"])
            bent = h0 @ constants["y"]
            value = value - v0 - g0 @ constants["y"] - (constants["y"] * bent).sum(0) / 2
            slope = slope - g0[:, None] - bent
            off = (value - constants["value"]) ** 2 * self.value_weight
            tilted = (slope - constants["slopes"]) ** 2 * constants["slope_weight"][:, None]
            return off.mean() + tilted.sum(0).mean()

        return evaluate

    def constants(self) -> dict[str, Array]:
        """The arrays that the loss needs."""
        return {
            "images": self.images,
            "rest": self.rest,
            "back": self.back,
            "y": self.y,
            "value": self.value,
            "slopes": self.slopes,
            "slope_weight": self.slope_weight,
        }


def train(
    problem: SobolevProblem,
    autodiff: Autodiff,
    *,
    hidden: tuple[int, ...],
    activation: str,
    seed: int,
    iterations: int,
    on_progress: Callable[[TrainingProgress], None] | None = None,
) -> Network:
    """The network after L-BFGS; the first weights depend on ``seed`` only, and are the same in every library."""
    d = problem.images.shape[1]
    widths = [d, *hidden, 1]
    shapes = [(b, a) for a, b in itertools.pairwise(widths)]
    theta = _first_weights(shapes, activation, seed)
    function = autodiff.compile(problem.loss(autodiff.xp, shapes, activation), problem.constants())
    done = 0

    def report(state: Any) -> None:
        nonlocal done
        done += 1
        if on_progress is not None and done % REPORT_INTERVAL == 0:
            loss = float(function(state)[0])
            on_progress(TrainingProgress(done, iterations, loss, loss))

    found = minimize(
        function,
        theta,
        jac=True,
        method="L-BFGS-B",
        callback=report,
        options={
            "maxcor": MEMORY,
            "maxiter": iterations,
            "maxfun": 2 * iterations,
            "ftol": 1e-14,
            "gtol": 1e-9,
        },
    )
    if on_progress is not None:
        on_progress(TrainingProgress(done, iterations, float(found.fun), float(found.fun)))
    layers = unpack_layers(found.x, shapes)
    return Network(activation, tuple(W.copy() for W, _ in layers), tuple(b.copy() for _, b in layers))


def _nothing(d: int) -> Network:
    return Network("tanh", (np.zeros((1, d)),), (np.zeros(1),))


def _first_weights(shapes: list[tuple[int, int]], activation: str, seed: int) -> Array:
    """Normal with the variance that keeps the size of the signal (Glorot & Bengio 2010); biases uniform in ± ½."""
    random = np.random.default_rng(seed)
    gain = 4.0 if activation == "sigmoid" else 1.0
    parts = []
    for rows, columns in shapes:
        parts.append(random.normal(size=rows * columns) * gain * np.sqrt(2 / (rows + columns)))
        parts.append(random.uniform(-0.5, 0.5, size=rows))
    return np.concatenate(parts)


def unpack_layers(theta: Any, shapes: list[tuple[int, int]]) -> list[tuple[Any, Any]]:
    """Weights and biases of each layer, from one vector of parameters."""
    layers, at = [], 0
    for rows, columns in shapes:
        W = theta[at : at + rows * columns].reshape(rows, columns)
        at += rows * columns
        layers.append((W, theta[at : at + rows]))
        at += rows
    return layers


def activate(xp: Any, name: str, z: Any) -> tuple[Any, Any, Any]:
    """σ, σ′ and σ″."""
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
    """Values (m,) and slopes (m, d) of a network with one output."""
    a, J = x, None
    for i, (W, b) in enumerate(layers):
        z = a @ W.T + b
        J = W[None] if J is None else xp.einsum("oi,mid->mod", W, J)
        if i == len(layers) - 1:
            return z[:, 0], J[:, 0, :]
        a, slope, _ = activate(xp, activation, z)
        J = slope[:, :, None] * J
    raise AssertionError("a network has at least one layer")


def _second_order(xp: Any, layers: list[tuple[Any, Any]], activation: str, x: Any) -> tuple[Any, Any, Any]:
    """Value, slope (d,) and Hessian (d, d) at one point (1, d), pushed forward."""
    a, J, H = x[0], None, None
    for i, (W, b) in enumerate(layers):
        z = W @ a + b
        J = W if J is None else W @ J
        H = None if H is None else xp.einsum("oi,icd->ocd", W, H)
        if i == len(layers) - 1:
            return z[0], J[0], J[0][:, None] * 0 * J[0][None, :] if H is None else H[0]
        a, slope, curvature = activate(xp, activation, z)
        bent = curvature[:, None, None] * J[:, :, None] * J[:, None, :]
        H = bent if H is None else slope[:, None, None] * H + bent
        J = slope[:, None] * J
    raise AssertionError("a network has at least one layer")
