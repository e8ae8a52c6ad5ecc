"""The networks of the paper and of the potential, trained and evaluated by JAX."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from porocore import TrainingProgress
from porocore.surrogates.mean_gradient.data import ScaledData
from porocore.surrogates.mean_gradient.model import AnchoredModel
from porocore.surrogates.network.adam import train_mlp
from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.sobolev import Autodiff
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore_surrogate_jax.autodiff import JaxAutodiff
from porocore_surrogate_jax.evaluator import JaxNetwork


class JaxSurrogate(NetworkSurrogate):
    """The models of :class:`~porocore.surrogates.network.surrogate.NetworkSurrogate`, trained by JAX."""

    backend = "jax"
    #: Where networks are evaluated.
    device: str = "cpu"

    def __init__(self, *, model: str | None = None, **options: Any) -> None:
        super().__init__(model=model, **options)
        self.device = self.options.device

    def evaluator(self, network: Network) -> Evaluator:
        """Compiled by JAX, on the device that ``device`` names."""
        return JaxNetwork(network, self.device) if network.weights else network

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what any backend's :meth:`save` wrote.

        What was trained for a GPU is evaluated on one where there is one, else on the processor.

        Raises
        ------
        DataError
            The file is truncated, edited, foreign or of another version.
        """
        surrogate = super().load(path)
        if surrogate.settings.get("device", "cpu") != "cpu":
            surrogate.device = "auto"
            model = surrogate._fitted()
            network = (
                model.network if isinstance(model, AnchoredModel) else getattr(model.network, "network", None)
            )
            if isinstance(network, JaxNetwork):
                network.move(surrogate.device)
        return surrogate

    def autodiff(self) -> Autodiff:
        """See :class:`~porocore.surrogates.network.surrogate.NetworkSurrogate`; compiled."""
        return JaxAutodiff(self.options.device)

    def train_mlp(
        self,
        data: ScaledData,
        seed: int,
        checkpoint: Path | None,
        on_progress: Callable[[TrainingProgress], None] | None,
    ) -> Network:
        """By the core's Adam."""
        return train_mlp(data, self.options, seed, self.autodiff(), self.backend, checkpoint, on_progress)
