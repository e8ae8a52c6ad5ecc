"""Training data of the potential W(ln U, p) of a cell: values and derivatives in the variables ln U and p."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse
from porocore.surrogates.rest import SingleRest
from porocore.surrogates.stretch import LogStretch

#: A variable below this in all states was not sampled.
STILL = 1e-9


def variables(stretch: LogStretch, p: Array) -> Array:
    """Return y (7, n): six components of ln U, and p."""
    return np.concatenate([stretch.L, p[None]])


@dataclass(frozen=True, eq=False)
class PotentialData:
    """Data of n states in the variables y.

    Attributes
    ----------
    rest
        The undeformed cell.
    y : (7, n)
        Variables.
    active
        Those that were sampled.
    value : (n,), gradient : (7, n)
        W and ∂W/∂y. Only the rows of ``active`` are used by those who learn in these alone.
    mean_grad : (9, n), mean_grad_by_y : (9, 7, n)
        Rᵀ<∇u¹>_s, which depends on U and p only, and its derivatives.
    """

    rest: SingleRest
    y: Array
    active: tuple[int, ...]
    value: Array
    gradient: Array
    mean_grad: Array
    mean_grad_by_y: Array

    @classmethod
    def from_training_set(cls, data: TrainingSet) -> PotentialData:
        """Return the data of the stable states; those beyond an instability would mislead a potential.

        Raises
        ------
        DataError
            A response or a derivative is missing, or fewer than two states are left.
        """
        kept = np.flatnonzero(data.responses.stable)
        states, responses = data.states[kept], data.responses[kept]
        missing = [
            name
            for name in ("potential", "stress", "fluid_volume", "tangent")
            if getattr(responses, name) is None
        ]
        if missing:
            raise DataError(
                f"a potential is learned from {', '.join(missing)}, which these states lack; sample again"
            )
        if len(kept) < 2:
            raise DataError(f"expected at least two stable training states, got {len(kept)}; sample more")
        rest = SingleRest.from_response(data.reference, data.symmetry)
        assert responses.potential is not None
        assert responses.stress is not None
        assert responses.fluid_volume is not None
        stretch = LogStretch.from_gradient(states.grad_u)
        y = variables(stretch, states.p)
        gradient = np.concatenate(
            [stretch.pull(np.moveaxis(responses.stress, 0, -1)), -responses.fluid_volume[None]]
        )
        active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
        mean_grad, gradients = unrotated(stretch, responses)
        return cls(rest, y, active, responses.potential.copy(), gradient, mean_grad, gradients)

    def __len__(self) -> int:
        return self.y.shape[1]

    @cached_property
    def remainder(self) -> tuple[Array, Array]:
        """Remainder of W (n,) and of ∂W/∂y (7, n) beyond the expansion at rest."""
        value, gradient = self.rest.potential(self.y)
        return self.value - value, self.gradient - gradient

    @property
    def mean_grad_remainder(self) -> tuple[Array, Array]:
        """Remainder of Rᵀ<∇u¹>_s (9, n) and of its derivatives (9, 7, n) beyond the linear limit at rest."""
        at = self.rest.values
        return self.mean_grad - at.mean_part(self.y), self.mean_grad_by_y - at.mean

    @cached_property
    def scales(self) -> Array:
        """Root mean square of W and of each ∂W/∂y about their means, (8,), by which errors are weighted.

        The means of variables that were not sampled count as much as the largest of the others.
        """
        spread = np.concatenate([[self.value.std()], self.gradient.std(axis=1)])
        floor = 1e-3 * spread[1:7].max(initial=0.0)
        spread[1:7] = np.maximum(spread[1:7], floor)
        return np.where(spread > 0, spread, 1.0)


def unrotated(stretch: LogStretch, responses: CellResponse) -> tuple[Array, Array]:
    """Return Rᵀ m (9, n) and its derivatives by y (9, 7, n); along pure stretches R does not change."""
    t = responses.tangent
    assert t is not None
    if t.mean_grad_grad_u is None or t.mean_grad_p is None:
        raise DataError("the derivatives of <∇u¹> are missing; solve the states with tangent=True")
    n = len(responses)
    R = None if stretch.rotation is None else np.moveaxis(stretch.rotation, -1, 0)

    def back(tensor: Array) -> Array:
        turned = tensor if R is None else R.swapaxes(1, 2) @ tensor
        return np.moveaxis(turned.reshape(n, 9), 0, -1)

    M = t.mean_grad_grad_u.reshape(n, 9, 9)
    gradients = np.empty((9, 7, n))
    for component in range(6):
        direction = np.moveaxis(stretch.pull_direction(component), -1, 0).reshape(n, 9, 1)
        gradients[:, component] = back((M @ direction).reshape(n, 3, 3))
    gradients[:, 6] = back(t.mean_grad_p)
    return back(responses.mean_grad), gradients
