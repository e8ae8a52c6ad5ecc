"""Model of <∇u¹>_s: the cell's linear limit and a network anchored at rest (AnchoredModel).

An error of the value or the gradient of a network at rest acts like a wrong stiffness or an initial stress, and
would drown the response to small loads. Here both are exact whatever the training did.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.inputs import InputSpace, SampledRange, flatten
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, CellTangent, Doubt, IntArray, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.network.network import Evaluator


@dataclass(frozen=True)
class InputScaling:
    """x = (input − middle)/half of the range, so that the range of every sampled input is [−1, 1]."""

    inputs: InputSpace

    @cached_property
    def middle(self) -> Array:
        """Middle of the ranges (d,)."""
        middle: Array = (np.array(self.inputs.lower) + np.array(self.inputs.upper)) / 2
        return middle

    @cached_property
    def half(self) -> Array:
        """Half of the ranges (d,)."""
        half: Array = (np.array(self.inputs.upper) - np.array(self.inputs.lower)) / 2
        return half

    @property
    def rest(self) -> Array:
        """Scaled inputs of the reference state H = 0, p = 0, (1, d)."""
        return -(self.middle / self.half)[None]

    def scale(self, x: Array) -> Array:
        """Return scaled inputs (n, d) from inputs (n, d)."""
        scaled: Array = (x - self.middle) / self.half
        return scaled


@dataclass(frozen=True, eq=False)
class AnchoredModel:
    """<∇u¹>_s = M:H + Q p + S [N(x) − N(x₀) − N'(x₀)(x − x₀)], x the scaled sampled inputs, x₀ those at rest.

    Attributes
    ----------
    linear : (9, 10)
        M (row by row) and, in the last column, Q. All nine components of H enter here, sampled or not.
    components
        Components of <∇u¹>_s that the network corrects; the others follow the linear part.
    output_scale
        S, one for each of ``components``.
    network
        N.
    sampled
        The inputs and the hull of the training states.
    estimate
        Estimate of its errors, which flags states; None: those beyond the hull are flagged.
    """

    linear: Array
    components: tuple[int, ...]
    output_scale: Array
    network: Evaluator
    sampled: SampledRange
    estimate: ErrorEstimate | None = None

    @cached_property
    def scaling(self) -> InputScaling:
        """Scaling of the sampled inputs."""
        return InputScaling(self.sampled.inputs)

    @cached_property
    def anchor(self) -> tuple[Array, Array]:
        """Values N(x₀) (outputs,) and derivatives N'(x₀) (d, outputs) at rest."""
        value, gradients = self.network.value_and_gradient(self.scaling.rest)
        return value[0], gradients[:, 0]

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """Return <∇u¹>_s of n states and, if ``tangent``, its exact derivatives."""
        n, flat = len(states), flatten(states)
        mean_grad = flat @ self.linear.T
        derivatives = None
        if tangent:
            by_H = np.repeat(self.linear[None, :, :9], n, axis=0)
            by_p = np.repeat(self.linear[None, :, 9], n, axis=0)
        if self.components:
            columns, outputs = self.sampled.inputs.columns, list(self.components)
            x = self.scaling.scale(flat[:, columns])
            value, gradient = self.anchor
            if tangent:
                N, J = self.network.value_and_gradient(x)
                J = (J - gradient[:, None]) * (self.output_scale / self.scaling.half[:, None])[:, None]
                for k, column in enumerate(columns):
                    into = by_p if column == 9 else by_H[:, :, column]
                    into[:, outputs] += J[k]
            else:
                N = self.network.evaluate(x)
            N -= value + (x - self.scaling.rest) @ gradient
            mean_grad[:, outputs] += self.output_scale * N
        if tangent:
            derivatives = CellTangent(by_H.reshape(n, 3, 3, 3, 3), by_p.reshape(n, 3, 3))
        return CellResponse(
            mean_grad=mean_grad.reshape(n, 3, 3),
            status=np.full(n, int(Status.converged), dtype=np.int64),
            tangent=derivatives,
            doubt=self._doubt(states, flat, mean_grad),
        )

    def beyond_linear(self, x: Array) -> Array:
        """Return the network's part at scaled inputs x (n, d), (components, n)."""
        value, gradient = self.anchor
        return (self.output_scale * (self.network.evaluate(x) - value - (x - self.scaling.rest) @ gradient)).T

    def error(self, states: MacroState) -> Array:
        """Return the estimated error of n states, a share of the range of <∇u¹>_s; NaN without one."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        x = self.scaling.scale(flatten(states)[:, self.sampled.inputs.columns])
        return self.estimate.error((x - self.scaling.rest).T, self.beyond_linear(x))

    def _doubt(self, states: MacroState, flat: Array, mean_grad: Array) -> IntArray:
        """Return the doubts (n,) of states: far from all known ones, or by the estimated error."""
        if self.estimate is None:
            return self.sampled.doubt(states)
        found = (mean_grad - flat @ self.linear.T)[:, list(self.components)].T
        x = self.scaling.scale(flat[:, self.sampled.inputs.columns])
        flagged = self.estimate.flagged((x - self.scaling.rest).T, found)
        return self.sampled.far(states) | Doubt.where(error=flagged)


#: A component of <∇u¹>_s whose remainder stays below this, or below this share of the largest one, is not learned.
SMALLEST_REMAINDER = 1e-9
SMALLEST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class ScaledData:
    """n training states, d sampled inputs, o components that the linear limit does not describe.

    Attributes
    ----------
    linear : (9, 10)
        M and Q.
    components
        The o components of <∇u¹>_s (row by row) that the network learns.
    output_scale : (o,)
        Root mean square of their remainders <∇u¹>_s − M:H − Q p.
    x : (n, d)
        Scaled inputs.
    rest : (1, d)
        Scaled inputs of the reference state.
    target : (n, o)
        Remainders divided by ``output_scale``.
    """

    linear: Array
    components: tuple[int, ...]
    output_scale: Array
    x: Array
    rest: Array
    target: Array

    @classmethod
    def from_training_set(cls, data: TrainingSet) -> ScaledData:
        """Return the scaled data of a training set.

        Raises
        ------
        DataError
            Too few states, states without values or with a component that is no input, no reference tangent.
        """
        _check(data)
        reference = data.reference.tangent
        if reference is None or reference.mean_grad_grad_u is None or reference.mean_grad_p is None:
            raise DataError(
                "the reference response of a training set needs the derivatives of <∇u¹>; solve it with tangent=True"
            )
        M, Q = reference.mean_grad_grad_u.reshape(9, 9), reference.mean_grad_p.reshape(9, 1)
        linear = np.concatenate([M, Q], axis=1)
        remainder = data.responses.mean_grad.reshape(-1, 9) - flatten(data.states) @ linear.T
        largest = np.abs(remainder).max(axis=0)
        learned = largest > max(SMALLEST_REMAINDER, SMALLEST_SHARE * largest.max())
        components = np.flatnonzero(learned)
        scale = np.sqrt((remainder[:, components] ** 2).mean(axis=0))
        scaling = InputScaling(data.inputs)
        return cls(
            linear,
            tuple(int(c) for c in components),
            scale,
            scaling.scale(data.inputs.gather(data.states)),
            scaling.rest,
            remainder[:, components] / scale,
        )

    def fingerprint(self, *settings: str) -> str:
        """Return a hash of the numbers and of ``settings``, by which a checkpoint is recognised."""
        arrays = (self.linear, self.output_scale, self.x, self.rest, self.target)
        parts = [f"{array.shape}".encode() + array.tobytes() for array in arrays]
        return stable_hash(repr((settings, self.components)), *parts)


def _check(data: TrainingSet) -> None:
    n = len(data.states)
    if n < 2:
        raise DataError(f"expected at least two training states, got {n}; sample more")
    without = ~(data.responses.valid & np.isfinite(data.responses.mean_grad).all(axis=(1, 2)))
    if without.any():
        raise DataError(
            f"{without.sum()} of {n} training states hold no values; pass only those whose response is valid"
        )
    moved = data.inputs.moves_other(data.states)
    if moved.any():
        raise DataError(
            f"{moved.sum()} of {n} training states move a component besides the inputs"
            f" {', '.join(data.inputs.names)}; sample it as an input, or leave it at zero"
        )
