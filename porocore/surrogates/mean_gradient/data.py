"""Training data of ``mlp``: scaled inputs, and what the linear limit leaves of <∇u¹>_s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.inputs.input_space import flatten
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array
from porocore.surrogates.mean_gradient.model import InputScaling

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
