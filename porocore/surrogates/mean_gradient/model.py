"""Model of <∇u¹>_s: the cell's linear limit and a network anchored at rest (AnchoredModel).

An error of the value or the gradient of a network at rest acts like a wrong stiffness or an initial stress, and
would drown the response to small loads. Here both are exact whatever the training did.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.input_space import InputSpace, flatten
from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
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
            outside_training_range=self._outside(states, flat, mean_grad),
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

    def _outside(self, states: MacroState, flat: Array, mean_grad: Array) -> npt.NDArray[np.bool_]:
        """Return which states are flagged, (n,): far from all known ones, or by the estimated error."""
        if self.estimate is None:
            return self.sampled.outside(states)
        found = (mean_grad - flat @ self.linear.T)[:, list(self.components)].T
        x = self.scaling.scale(flat[:, self.sampled.inputs.columns])
        return self.sampled.far(states) | self.estimate.flagged((x - self.scaling.rest).T, found)
