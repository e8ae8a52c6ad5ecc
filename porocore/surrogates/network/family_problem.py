"""Network of a family's potential: its regression by values and derivatives, its training.

As in :mod:`porocore.surrogates.network.sobolev` the loss is written once, in operations that torch and jax.numpy share.
The weights have a normal prior around the first ones, at which the network adds nothing to the polynomial. Without it
the network follows the equations of few members between them at will: errors differed by a factor of thirty between
seeds, and between the last bits of two numbers of threads.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.interfaces.surrogate import OnProgress, TrainingSet
from porocore.states import Array
from porocore.surrogates.family.fit import (
    FamilyData,
    JointData,
    Weights,
    assembled,
    equation_scales,
    fit_joint,
    symmetry_of,
    terms_of,
)
from porocore.surrogates.family.joint import design
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.options import PotentialOptions
from porocore.surrogates.network.separable import SeparableNetwork, low_orders
from porocore.surrogates.network.sobolev import (
    Autodiff,
    Loss,
    activate,
    first_weights,
    layered_network,
    minimised,
    unpack_layers,
)
from porocore.surrogates.polynomial.fit import ANCHOR_DEGREE
from porocore.surrogates.polynomial.monomials import Polynomial, Terms
from porocore.surrogates.potential_training import coordinates_for

#: Square of the noise as a share of the mean square that the polynomial leaves; the weights' prior has unit width. The
#: errors on held-out states were the same, within their spread over seeds, from 0.003 to 0.01.
NOISE = 0.005
#: Layers of a network: arrays of weights and biases of the library.
Layers = list[tuple[Any, Any]]


@dataclass(frozen=True)
class Layout:
    """Shapes of both networks: (width, width before) of each layer.

    Attributes
    ----------
    network
        From the terms to o outputs, the widths of ``hidden`` between.
    factors
        From θ̂ to as many, with one hidden layer.
    activation
        σ of all hidden layers.
    """

    network: list[tuple[int, int]]
    factors: list[tuple[int, int]]
    activation: str

    @classmethod
    def from_widths(cls, terms: int, coordinates: int, hidden: tuple[int, ...], activation: str) -> Layout:
        """Return the layout of k terms and l coordinates; there are as many outputs as units in the last layer."""
        o = hidden[-1]
        network = [(b, a) for a, b in itertools.pairwise((terms, *hidden, o))]
        return cls(network, [(o, coordinates), (o, o)], activation)

    def first_weights(self, seed: int) -> Array:
        """Return random weights and biases of both as one vector; those of the last layer of the factors are zero."""
        theta = np.concatenate(
            [
                first_weights(shapes, self.activation, seed + i)
                for i, shapes in enumerate((self.network, self.factors))
            ]
        )
        rows, columns = self.factors[-1]
        theta[-rows * (columns + 1) :] = 0.0
        return theta

    def parts(self, theta: Any) -> tuple[Any, Any]:
        """Return the weights of both."""
        end = sum(rows * (columns + 1) for rows, columns in self.network)
        return theta[:end], theta[end:]


@dataclass(frozen=True, eq=False)
class FamilyProblem:
    """Regression of R(y, θ̂) at n states.

    Attributes
    ----------
    terms
        t, those that some state moves.
    middle, half : (k,)
        Middle and half width of their ranges.
    scale
        Unit of R.
    x : (n, k), rest : (1, k)
        Scaled terms (t − middle)/half of the states, and at rest.
    coordinates : (n, l)
        θ̂.
    jacobian : (n, d, k), curvature : (k, d, d, n)
        Derivatives of x by the d variables y by which some term changes.
    targets, weights
        Values and derivatives of R, divided by the scale, by the name of their kind as in :class:`JointData`, and
        1/variance of each; 0 where one is not known or does not count.
    """

    terms: Terms
    middle: Array
    half: Array
    scale: float
    x: Array
    rest: Array
    coordinates: Array
    jacobian: Array
    curvature: Array
    targets: dict[str, Array]
    weights: dict[str, Array]

    @classmethod
    def from_data(
        cls, data: JointData, divisors: dict[str, Array], terms: Terms, active: tuple[int, ...]
    ) -> FamilyProblem:
        """Return the problem of one function.

        Parameters
        ----------
        data
            R and its derivatives.
        divisors
            Spread of each kind of equation, (1, …), as of
            :func:`porocore.surrogates.family.fit.equation_scales`.
        terms
            Of which those that no state moves are left out.
        active
            Variables that states move.
        """
        y = np.zeros_like(data.y)
        y[list(active)] = data.y[list(active)]
        kept = np.flatnonzero(np.ptp(terms.polynomial.evaluate(y), axis=1))
        terms = terms.subset(tuple(int(k) for k in kept))
        t, jacobian, curvature = terms.polynomial.derivatives(y)
        assert curvature is not None
        low, high = t.min(axis=1), t.max(axis=1)
        middle, half = (low + high) / 2, (high - low) / 2
        # Combinations of variables have gradients by those too that no state moves.
        moving = np.flatnonzero(jacobian.any(axis=(0, 2)))
        scale = float(np.sqrt((data.value[0] ** 2).mean())) or 1.0
        places: dict[str, Any] = {
            "value": (), "by_y": (moving,), "by_x": (slice(None),),
            "by_yy": np.ix_(moving, moving), "by_yx": (moving,),
        }  # fmt: skip
        targets, weights = {}, {}
        for kind, divisor in divisors.items():
            targets[kind] = np.nan_to_num(getattr(data, kind)[0][places[kind]]) / scale
            weights[kind] = (scale / divisor[0][places[kind]]) ** 2
        return cls(
            terms,
            middle,
            half,
            scale,
            ((t - middle[:, None]) / half[:, None]).T,
            -(middle / half)[None],
            data.x.T.copy(),
            np.ascontiguousarray((jacobian[:, moving] / half[:, None, None]).T),
            curvature[:, moving][:, :, moving] / half[:, None, None, None],
            targets,
            weights,
        )

    def constants(self, start: Array) -> dict[str, Array]:
        """Return the arrays of the loss, given the first weights, around which the prior is."""
        first, second = low_orders(self.terms)
        names = ("x", "rest", "coordinates", "jacobian", "curvature")
        found = {name: getattr(self, name) for name in names} | {"first": first, "second": second}
        left = sum(
            float(((target**2).mean(-1) * self.weights[kind]).sum()) for kind, target in self.targets.items()
        )
        found |= {"start": start, "stiffness": np.array(NOISE * left / len(self.x))}
        found |= {f"target_{kind}": target for kind, target in self.targets.items()}
        return found | {f"weight_{kind}": np.asarray(weight) for kind, weight in self.weights.items()}

    def loss(self, xp: Any, layout: Layout) -> Loss:
        """Return the loss: the weighted mean squares of the errors of all kinds, and the prior of the weights."""
        kinds = tuple(self.targets)

        def evaluate(theta: Any, constants: Any) -> Any:
            total = constants["stiffness"] * ((theta - constants["start"]) ** 2).sum()
            for kind, found in _derivatives(xp, layout, theta, constants, kinds).items():
                squares = (found - constants[f"target_{kind}"]) ** 2
                total = total + (squares.mean(-1) * constants[f"weight_{kind}"]).sum()
            return total

        return evaluate

    def networks(self, theta: Array, layout: Layout) -> tuple[Network, Network]:
        """Return the network as a function of t, in units of R, and that of the factors."""
        own, factors = layout.parts(theta)
        network = layered_network(own, layout.network, layout.activation)
        first, *others = network.weights
        weights, biases = [first / self.half, *others], list(network.biases)
        biases[0] = biases[0] - weights[0] @ self.middle
        scaled = Network(
            network.activation,
            (*weights[:-1], weights[-1] * self.scale),
            (*biases[:-1], biases[-1] * self.scale),
        )
        return scaled, layered_network(factors, layout.factors, layout.activation)


def _derivatives(xp: Any, layout: Layout, theta: Any, c: Any, kinds: tuple[str, ...]) -> dict[str, Any]:
    """Return R and its derivatives of some kinds, the states last."""
    own, other = layout.parts(theta)
    layers = unpack_layers(own, layout.network)
    f, J, hidden = _forward(layers, layout.activation, c["x"], xp)
    factors, by_x, _ = _forward(unpack_layers(other, layout.factors), layout.activation, c["coordinates"], xp)
    v0, g0, h0 = _at_rest(layers, layout.activation, c, xp)
    away = c["x"] - c["rest"]
    h0_away = (away @ h0.reshape(-1, h0.shape[2]).T).reshape(J.shape)
    f = f - v0 - away @ g0.T - (h0_away @ away[:, :, None])[:, :, 0] / 2
    J = J - g0 - h0_away
    slope = (factors[:, None] @ J)[:, 0]
    found = {"value": (factors * f).sum(1)}
    if "by_y" in kinds:
        found["by_y"] = (c["jacobian"] @ slope[:, :, None])[:, :, 0].T
    if "by_x" in kinds:
        found["by_x"] = (f[:, None] @ by_x)[:, 0].T
    if "by_yx" in kinds:
        found["by_yx"] = xp.einsum("ndk,nkl->dln", c["jacobian"], J.swapaxes(1, 2) @ by_x)
    if "by_yy" in kinds:
        H = _hessian(layers, hidden, factors) - (factors @ h0.reshape(h0.shape[0], -1)).reshape(
            slope.shape + slope.shape[1:]
        )
        curved = c["jacobian"] @ H @ c["jacobian"].swapaxes(1, 2)
        found["by_yy"] = xp.einsum("nde->den", curved) + xp.einsum("nk,kden->den", slope, c["curvature"])
    return found


def _at_rest(layers: Layers, activation: str, c: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Return values (o,), gradients (o, k) and Hessians (o, k, k) at rest, as far as they count up to order 2 in y."""
    f, J, hidden = _forward(layers, activation, c["rest"], xp)
    h0 = _hessian(layers, hidden, None)
    return f[0], J[0] * c["first"], h0 * c["second"]


def _forward(layers: Layers, activation: str, x: Any, xp: Any) -> tuple[Any, Any, list[tuple[Any, Any, Any]]]:
    """Return values (m, o), gradients (m, o, d), and for each hidden layer ∂z/∂x (m, w, d), σ′ and σ″."""
    W, b = layers[0]
    z, J = x @ W.T + b, W[None]
    hidden = []
    for W, b in layers[1:]:
        a, slope, curvature = activate(xp, activation, z)
        hidden.append((J, slope, curvature))
        J = W @ (slope[:, :, None] * J)
        z = a @ W.T + b
    return z, J, hidden


def _hessian(layers: Layers, hidden: list[tuple[Any, Any, Any]], factors: Any) -> Any:
    """Return the Hessians (m, d, d) of the sums of the outputs with factors (m, o); None: of each output."""
    delta = layers[-1][0] if factors is None else factors @ layers[-1][0]
    found: Any = 0.0
    for (W, _), (J, slope, curvature) in zip(reversed(layers[:-1]), reversed(hidden), strict=True):
        # At rest the layers have one row, and δ one for each output; J of the first layer has one.
        found = found + ((delta * curvature)[:, :, None] * J).swapaxes(1, 2) @ J
        delta = (delta * slope) @ W
    return found


#: Weights where values alone are learned.
VALUES = Weights(by_y=0.0, by_x=0.0, by_yy=0.0, by_yx=0.0)


def train_family(
    training: TrainingSet,
    options: PotentialOptions,
    seed: int,
    autodiff: Autodiff,
    make_evaluator: Callable[[Network], Evaluator],
    on_progress: OnProgress | None = None,
) -> tuple[PotentialModel, FamilyData, dict[str, float]]:
    """Return the model, the data, and the remaining errors of ∂W/∂y on the training states as shares of their ranges.

    Raises
    ------
    DataError
        Undeformed members, a response or a derivative are missing, or too few states are stable.
    ConfigurationError
        Cubic symmetry is asked for and the cell has none.
    """
    data = FamilyData.from_training_set(training)
    terms, group, joint = terms_of(data), data.rest.symmetry, data.potential
    coordinates, l = coordinates_for(terms, group, data.active, options), len(joint.x)
    # A network of the sampled variables cannot describe stresses across them.
    anchor = terms if options.anchor == "polynomial" else terms.across()
    polynomial = Polynomial.zero(len(terms.weights) + l, 1)
    if options.anchor == "polynomial" or terms.once:
        tied = symmetry_of(anchor, l, group)
        polynomial = fit_joint(
            joint, anchor, 3, tied=tied, weights=Weights(), highest=ANCHOR_DEGREE
        ).polynomial
    divisors = equation_scales(
        joint, Weights() if options.derivatives else VALUES, symmetry_of(terms, l, group)
    )
    problem = FamilyProblem.from_data(_beyond(joint, terms, polynomial), divisors, coordinates, data.active)
    layout = Layout.from_widths(len(problem.terms.weights), l, options.hidden, options.activation)
    start = layout.first_weights(seed)
    function = autodiff.compile(problem.loss(autodiff.xp, layout), problem.constants(start))
    theta = minimised(function, start, options.iterations, on_progress)
    network, factors = problem.networks(theta, layout)
    part = SeparableNetwork(make_evaluator(network), problem.terms, factors)
    model = assembled(training, data, terms, polynomial, network=part)
    return model, data, {"slopes of W on the training states": _error(model, data)}


def _beyond(data: JointData, terms: Terms, polynomial: Polynomial) -> JointData:
    """Return what a polynomial leaves of one function and its derivatives."""
    if not len(polynomial.exponents):
        return data
    columns = design(terms, polynomial.exponents, data.y, data.x, second=True)
    c = polynomial.coefficients[0]

    def left(kind: str) -> Array:
        found: Array = getattr(data, kind) - np.tensordot(c, getattr(columns, kind), 1)[None]
        return found

    return JointData(data.y, data.x, *(left(kind) for kind in ("value", "by_y", "by_x", "by_yy", "by_yx")))


def _error(model: PotentialModel, data: FamilyData) -> float:
    """Return the largest root mean square error of ∂R/∂y, as a share of the range of ∂w/∂y."""
    active = list(data.active)
    found = model.beyond_rest(data.potential.y, data.potential.x)[1]
    wrong = (found - data.potential.by_y[0]) * data.scale
    spread = np.ptp(data.stress[active], axis=1)
    share = np.sqrt((wrong[active] ** 2).mean(axis=1)) / np.where(spread > 0, spread, 1.0)
    return float(share.max())
