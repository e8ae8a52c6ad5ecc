"""Surrogate ``torch``: the networks of the paper and of the potential, trained and evaluated by torch."""

from __future__ import annotations

from porocore.surrogates.mean_gradient import ScaledData
from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.sobolev import Autodiff
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore.surrogates.network.training import MlpTraining


class TorchSurrogate(NetworkSurrogate):
    """The models of :class:`~porocore.surrogates.network.surrogate.NetworkSurrogate`, trained by torch.

    Only training needs torch for ``mlp``; a saved one is used without waiting for its import.
    """

    backend = "torch"

    def evaluator(self, network: Network) -> Evaluator:
        """Return the network in torch for a potential; ``mlp`` stays in numpy, which is as fast and needs no import.

        A file from a machine with a GPU is evaluated on the processor where there is none.
        """
        if self.model == "mlp":
            return network
        from porocore_surrogate_torch.evaluator import TorchNetwork, available_device

        return TorchNetwork(network, available_device(self.settings.get("device", "cpu")))

    @classmethod
    def load_libraries(cls) -> None:
        """Import torch ahead of time."""
        import torch  # noqa: F401

    def autodiff(self) -> Autodiff:
        """Return torch's automatic differentiation, on one thread."""
        from porocore_surrogate_torch.training import TorchAutodiff

        return TorchAutodiff(self.options.device)

    def mlp_training(self, data: ScaledData, seed: int) -> MlpTraining:
        """Return the training by torch's Adam."""
        from porocore_surrogate_torch.training import TorchTraining

        return TorchTraining(data, self.options, seed)
