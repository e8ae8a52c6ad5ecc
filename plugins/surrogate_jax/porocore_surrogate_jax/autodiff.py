"""Derivatives of a loss by JAX."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np

from porocore.states import Array
from porocore.surrogates.network.sobolev import Loss
from porocore_surrogate_jax.library import choose_device, compiled


class JaxAutodiff:
    """Compiled reverse mode in double precision; see :class:`porocore.surrogates.network.sobolev.Autodiff`."""

    xp: ModuleType = jnp

    def __init__(self, device: str) -> None:
        self.device = choose_device(device)

    def compile(self, loss: Loss, constants: dict[str, Array]) -> Callable[[Array], tuple[float, Array]]:
        """Return θ → loss and gradient, compiled."""
        known = {name: jax.device_put(array, self.device) for name, array in constants.items()}
        both = compiled(jax.value_and_grad(loss), self.device)

        def evaluate(theta: Array) -> tuple[float, Array]:
            value, gradient = both(jax.device_put(theta, self.device), known)
            return float(value), np.array(gradient)

        return evaluate
