"""Use of JAX: double precision, one thread, choice of the device, derivatives of a training loss.

Importing this module switches JAX to 64 bits, for the whole process; nothing else in porocore does.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from porocore.errors import ConfigurationError
from porocore.states import Array
from porocore.surrogates.network.sobolev import Loss

jax.config.update("jax_enable_x64", True)

R = TypeVar("R")

#: A sum whose order depends on the number of threads would not repeat to the last bit.
ONE_THREAD = {"xla_cpu_multi_thread_eigen": False}
#: Logger of JAX's search for accelerators.
_PROBING = logging.getLogger("jax._src.xla_bridge")


def compiled(function: Callable[..., R], device: jax.Device) -> Callable[..., R]:
    """Return ``function`` compiled for ``device``, to which its arguments must belong."""
    options = ONE_THREAD if device.platform == "cpu" else None
    result: Callable[..., R] = jax.jit(function, compiler_options=options)
    return result


@cache
def choose_device(device: str) -> jax.Device:
    """Return the device of that name; ``auto`` is a GPU where there is one.

    Raises
    ------
    ConfigurationError
        A GPU is asked for and JAX sees none.
    """
    with _quiet():
        if device != "cpu":
            try:
                found: jax.Device = jax.local_devices(backend="gpu")[0]
            except RuntimeError:
                if device == "cuda":
                    raise ConfigurationError(
                        "surrogate.options.device: jax sees no GPU here; choose auto or cpu, or install its CUDA "
                        "build: pip install 'jax[cuda12]'"
                    ) from None
            else:
                return found
        cpu: jax.Device = jax.local_devices(backend="cpu")[0]
        return cpu


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


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress JAX's messages about missing accelerators."""
    level = _PROBING.level
    _PROBING.setLevel(logging.ERROR)
    try:
        yield
    finally:
        _PROBING.setLevel(level)
