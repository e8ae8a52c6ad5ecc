"""The paper's network as a surrogate: (H, p) → <∇u¹>_s."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np

from porocore import (
    CellResponse,
    ConfigurationError,
    DataError,
    InputSpace,
    MacroState,
    SampledRange,
    Surrogate,
    TrainingProgress,
    TrainingSet,
)
from porocore_surrogate_torch.archive import read_archive, write_archive
from porocore_surrogate_torch.model import AnchoredModel
from porocore_surrogate_torch.network import Network
from porocore_surrogate_torch.options import MlpOptions
from porocore_surrogate_torch.training_data import ScaledData

FORMAT, VERSION, KIND = "porocore-surrogate", 1, "anchored-mlp"
ADVICE = "train the surrogate again"


class MlpSurrogate(Surrogate):
    """A sigmoid network (three layers of 40 by default) trained with Adam on the mean squared error.

    It follows Dehghani & Zilian's section on neural networks, but for the anchor: the linear limit M:H + Q p of
    the cell is added exactly and the network describes only what goes beyond it, from second order on
    (:class:`~porocore_surrogate_torch.model.AnchoredModel`). So value and derivatives at H = 0, p = 0 are
    those of :attr:`TrainingSet.reference`, to rounding.

    A component of H that was not sampled enters through M only, and so does its derivative, everywhere: that
    is exact at rest and an approximation elsewhere, and a state that moves such a component is flagged as
    ``outside``.

    Parameters
    ----------
    **options
        ``hidden`` (list of widths, [40, 40, 40]), ``activation`` ("sigmoid" or "tanh"), ``epochs`` (15000),
        ``learning_rate`` (0.01, falling to a hundredth), ``validation_fraction`` (0.15 of the states, chosen
        by the seed), ``patience`` (4000 epochs without a smaller validation loss end the training).

    Raises
    ------
    ConfigurationError
        An option is unknown or has a value that cannot be used.
    """

    #: The responses that :meth:`predict` fills in.
    provides = ("mean_grad",)

    def __init__(self, **options: Any) -> None:
        self.options = MlpOptions.parse(options)
        self._model: AnchoredModel | None = None

    @classmethod
    def load_libraries(cls) -> None:
        """Import torch."""
        import torch  # noqa: F401

    def fit(
        self,
        data: TrainingSet,
        *,
        seed: int,
        checkpoint: Path | None = None,
        on_progress: Callable[[TrainingProgress], None] | None = None,
    ) -> Self:
        """Train on ``data`` and return self.

        The same data, options and seed give the same weights, bit by bit, on the same machine. The random numbers
        are the training's own, torch's number of threads is put back, and no other global setting is touched.

        Parameters
        ----------
        data
            At least two states, all with values, that move the inputs only.
        seed
            Of the split into training and validation part and of the first weights.
        checkpoint
            Written every two seconds and at the end. If it exists, the training continues from it. It is left
            for the caller to remove.
        on_progress
            Called every hundred epochs. The losses are mean squares of the scaled outputs: 1 is the linear limit.

        Raises
        ------
        DataError
            The data cannot be used, or the checkpoint is damaged or belongs to another training.
        RunFolderError
            The checkpoint cannot be written.
        """
        scaled = ScaledData.of(data)
        if scaled.components:
            # Only training needs torch; a saved surrogate is used without waiting for its import.
            from porocore_surrogate_torch.training import train

            network = train(scaled, self.options, int(seed), checkpoint, on_progress)
        else:
            network = Network(self.options.activation, (), ())
        sampled = SampledRange.around(data.inputs, data.inputs.gather(data.states))
        model = AnchoredModel(scaled.linear, scaled.components, scaled.output_scale, network, sampled)
        self._become(model, data.identity, dict(data.provenance))
        return self

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """<∇u¹>_s of n states, with ``tangent`` its exact derivatives, and the flag ``outside``.

        Every status is ``converged``; rows outside the hull of the training states hold what the formula
        extrapolates and are flagged.
        """
        return self._fitted().predict(states, tangent=tangent)

    def save(self, path: Path) -> None:
        """Write one HDF5 file, atomically.

        Raises
        ------
        RunFolderError
            The disk is full or read-only.
        """
        model = self._fitted()
        header = {
            "kind": KIND,
            "options": self.options.model_dump(mode="json"),
            "provides": self.provides,
            "activation": model.network.activation,
            "layers": len(model.network.weights),
            "components": model.components,
            "inputs": self.inputs.names,
            "identity": self.identity,
            "provenance": self.provenance,
        }
        arrays = {
            "inputs/lower": np.array(self.inputs.lower),
            "inputs/upper": np.array(self.inputs.upper),
            "reference/M": model.linear[:, :9].reshape(3, 3, 3, 3),
            "reference/Q": model.linear[:, 9].reshape(3, 3),
            "range/normals": model.sampled.normals,
            "range/offsets": model.sampled.offsets,
            "network/output_scale": model.output_scale,
        }
        for i, (W, b) in enumerate(zip(model.network.weights, model.network.biases, strict=True)):
            arrays |= {f"network/{i}/weights": W, f"network/{i}/biases": b}
        write_archive(path, FORMAT, VERSION, header, arrays)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what :meth:`save` wrote; its predictions are the same, bit by bit.

        Raises
        ------
        DataError
            The file is truncated, edited, foreign, of another version or of another surrogate.
        """
        header, arrays = read_archive(path, FORMAT, VERSION, ADVICE)
        if header.get("kind") != KIND:
            raise DataError(
                f"{path}: expected a surrogate of kind {KIND}, got {header.get('kind')}; "
                f"choose the backend that wrote it, or {ADVICE}"
            )
        try:
            surrogate = cls(**header["options"])
            names = tuple(header["inputs"])
            inputs = InputSpace(
                names, *(tuple(arrays[f"inputs/{end}"].tolist()) for end in ("lower", "upper"))
            )
            layers = range(header["layers"])
            network = Network(
                header["activation"],
                tuple(arrays[f"network/{i}/weights"] for i in layers),
                tuple(arrays[f"network/{i}/biases"] for i in layers),
            )
            M, Q = arrays["reference/M"].reshape(9, 9), arrays["reference/Q"].reshape(9, 1)
            model = AnchoredModel(
                np.concatenate([M, Q], axis=1),
                tuple(header["components"]),
                arrays["network/output_scale"],
                network,
                SampledRange(inputs, arrays["range/normals"], arrays["range/offsets"]),
            )
        except (KeyError, TypeError, ValueError, ConfigurationError) as error:
            raise DataError(f"{path}: not a complete surrogate ({error!r}); {ADVICE}") from error
        surrogate._become(model, header["identity"], header["provenance"])
        return surrogate

    def _become(self, model: AnchoredModel, identity: str, provenance: dict[str, str]) -> None:
        self._model = model
        self.inputs, self.identity, self.provenance = model.sampled.inputs, identity, provenance

    def _fitted(self) -> AnchoredModel:
        if self._model is None:
            raise RuntimeError("this surrogate has not been trained; call fit or load first")
        return self._model
