"""Base of surrogates whose networks a library trains: models ``mlp`` and ``potential``."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any

from porocore.core.inputs import SampledRange
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import OnProgress, TrainingSet
from porocore.surrogates.error_estimate.fit import (
    with_family_error,
    with_mean_gradient_error,
    with_potential_error,
)
from porocore.surrogates.file.file import Model
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.network.family_problem import train_family
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions, PotentialOptions
from porocore.surrogates.network.sobolev import Autodiff
from porocore.surrogates.network.training import AutodiffTraining, MlpTraining
from porocore.surrogates.portable import ModelSurrogate
from porocore.surrogates.potential_training import train_potential


class NetworkSurrogate(ModelSurrogate):
    """Two models, each exact at rest to the order that small loads feel.

    ``mlp`` is the paper's: a sigmoid network (three layers of 40) for <∇u¹>_s, trained with Adam on the mean
    squared error. It follows Dehghani & Zilian but for the anchor: the linear limit M:H + Q p of the cell is added
    exactly and the network describes only what goes beyond it
    (:class:`porocore.surrogates.mean_gradient.AnchoredModel`). A component of H that was not
    sampled enters through M only, and a state that moves such a component is flagged (``Doubt.not_sampled``).

    ``potential`` is a network for W(ln U, p), trained with L-BFGS on W and its first derivatives; stress, fluid volume
    and all tangents are its derivatives (:class:`porocore.surrogates.potential.PotentialModel`). It learns cells
    with parameters too: W(ln U, p; θ), exact at rest for every θ
    (:class:`porocore.surrogates.model.PotentialModel`).

    Parameters
    ----------
    model
        ``mlp`` (the default) or ``potential``.
    **options
        See :class:`porocore.surrogates.network.options.MlpOptions` and
        :class:`~porocore.surrogates.network.options.PotentialOptions`.

    Raises
    ------
    ConfigurationError
        An option is unknown or has a value that cannot be used.
    """

    def __init__(self, *, model: str | None = None, **options: Any) -> None:
        super().__init__(model=model, **options)
        self.learns_parameters = self.model == "potential"
        kind = MlpOptions if self.model == "mlp" else PotentialOptions
        self.options: Any = kind.parse(options, self.backend)
        self.settings = self.options.model_dump(mode="json")

    @abstractmethod
    def autodiff(self) -> Autodiff:
        """Return the library's automatic differentiation, on the device of the options.

        Raises
        ------
        ConfigurationError
            The device is a GPU and there is none.
        """

    def mlp_training(self, data: ScaledData, seed: int) -> MlpTraining:
        """Return the training of ``mlp``: by Adam in numpy unless the library has its own."""
        return AutodiffTraining(data, self.options, seed, self.backend, self.autodiff())

    def train(
        self, data: TrainingSet, seed: int, checkpoint: Path | None, on_progress: OnProgress | None
    ) -> tuple[Model, dict[str, float]]:
        """Return the trained model and its errors.

        The same data, options and seed give the same weights, bit by bit, on the same machine. The random numbers
        are the training's own, and no global setting of the library is left changed.

        Parameters
        ----------
        data
            At least two states, all with values, that move the inputs only.
        seed
            Of the split into training and validation part (``mlp``) and of the first weights.
        checkpoint
            Of ``mlp``: written every two seconds and at the end. If it exists, the training continues from it. It is
            left for the caller to remove. A ``potential`` takes seconds and begins anew.
        on_progress
            Called from time to time. The losses of ``mlp`` are mean squares of the scaled outputs: 1 is the linear
            limit.
        """
        if not self.learns_parameters and data.inputs.parameters:
            raise ConfigurationError(
                f"surrogate.model: {self.model} of the {self.backend} surrogate learns no cells with parameters "
                f"({', '.join(data.inputs.parameters)}); choose potential, or give one number for each range"
            )
        if self.model == "potential":
            autodiff = self.autodiff()
            if data.inputs.parameters:
                family, known, errors = train_family(
                    data, self.options, seed, autodiff, self.evaluator, on_progress
                )
                return with_family_error(family, known, data.tolerance), errors
            model, errors = train_potential(data, self.options, seed, autodiff, self.evaluator, on_progress)
            return with_potential_error(model, data), errors
        scaled = ScaledData.from_training_set(data)
        if scaled.components:
            network = self.mlp_training(scaled, seed).run(checkpoint, on_progress)
        else:
            network = Network(self.options.activation, (), ())
        sampled = SampledRange.around(data.inputs, data.inputs.gather(data.states))
        anchored = AnchoredModel(
            scaled.linear, scaled.components, scaled.output_scale, self.evaluator(network), sampled
        )
        return with_mean_gradient_error(anchored, data), {}
