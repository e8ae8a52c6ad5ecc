"""Surrogate ``jax``: the networks of the paper and of the potential, trained and evaluated by JAX."""

from __future__ import annotations

from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.sobolev import Autodiff
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore_surrogate_jax.evaluator import JaxNetwork
from porocore_surrogate_jax.library import JaxAutodiff


class JaxSurrogate(NetworkSurrogate):
    """The models of :class:`~porocore.surrogates.network.surrogate.NetworkSurrogate`, trained by JAX."""

    backend = "jax"

    def evaluator(self, network: Network) -> Evaluator:
        """Return the network compiled by JAX.

        A file from a machine with a GPU is evaluated on the processor where there is none.
        """
        device = "cpu" if self.settings.get("device", "cpu") == "cpu" else "auto"
        return JaxNetwork(network, device) if network.weights else network

    def autodiff(self) -> Autodiff:
        """Return JAX's automatic differentiation, compiled."""
        return JaxAutodiff(self.options.device)
