"""A surrogate of Gaussian kernels, which approximates: it declares its error, and is not exact at rest."""

from __future__ import annotations

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress
from porocore.states import CellResponse, CellTangent
from porocore.surrogates.file.file import read_archive, write_archive
from porocore.testing import SurrogateSuite

FORMAT, VERSION = "kernels", 1


class KernelSurrogate(Surrogate):
    """<∇u¹>_s = Σ w_k exp(−|x − x_k|²/2) of the sampled inputs by their ranges, by least squares."""

    expected_error = 0.03
    exact_at_rest = False
    provides = ("mean_grad",)

    def __init__(self, **unknown):
        if unknown:
            raise ConfigurationError(f"surrogate.options.{min(unknown)}: kernels take no options; remove it")

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        self.inputs, self.identity, self.provenance = data.inputs, data.identity, dict(data.provenance)
        x = self.inputs.gather(data.states)
        self._width = np.array(self.inputs.upper) - np.array(self.inputs.lower)
        self._centres = x[:: max(1, len(x) // 40)] / self._width
        values = data.responses.mean_grad.reshape(len(x), 9)
        self._weights = np.linalg.lstsq(self._kernels(x)[0], values, rcond=1e-7)[0]
        self._sampled = SampledRange.around(self.inputs, x)
        if on_progress is not None:
            on_progress(TrainingProgress(1, 1, 0.0, 0.0))
        return self

    def _kernels(self, x):
        """(n, centres), and the derivatives by the inputs (n, centres, inputs)."""
        apart = x[:, None] / self._width - self._centres
        value = np.exp(-(apart**2).sum(axis=2) / 2)
        return value, -value[:, :, None] * apart / self._width

    def predict(self, states, *, tangent=True):
        n = len(states)
        value, slopes = self._kernels(self.inputs.gather(states))
        by_all = np.zeros((n, 9, 10))
        by_all[:, :, list(self.inputs.columns)] = np.einsum("nki,kc->nci", slopes, self._weights)
        slope = CellTangent(
            mean_grad_grad_u=by_all[:, :, :9].reshape(n, 3, 3, 3, 3).copy(),
            mean_grad_p=by_all[:, :, 9].reshape(n, 3, 3).copy(),
        )
        return CellResponse(
            mean_grad=np.einsum("nk,kc->nc", value, self._weights).reshape(n, 3, 3),
            status=np.zeros(n, dtype=np.int64),
            tangent=slope if tangent else None,
            doubt=self._sampled.doubt(states),
        )

    def save(self, path):
        inputs = [list(part) for part in (self.inputs.names, self.inputs.lower, self.inputs.upper)]
        header = {"identity": self.identity, "provenance": self.provenance, "inputs": inputs}
        arrays = {name: getattr(self, f"_{name}") for name in ("width", "centres", "weights")}
        arrays |= {"normals": self._sampled.normals, "offsets": self._sampled.offsets}
        write_archive(path, FORMAT, VERSION, header, arrays)

    @classmethod
    def load(cls, path):
        header, arrays = read_archive(path, FORMAT, VERSION, "train it again: porocore train")
        surrogate = cls()
        surrogate.inputs = InputSpace(*map(tuple, header["inputs"]))
        surrogate.identity, surrogate.provenance = header["identity"], header["provenance"]
        surrogate._sampled = SampledRange(surrogate.inputs, arrays.pop("normals"), arrays.pop("offsets"))
        for name, array in arrays.items():
            setattr(surrogate, f"_{name}", array)
        return surrogate


class TestKernels(SurrogateSuite):
    kit_version = "5"
    random = False
    resumable = False

    @classmethod
    def make_surrogate(cls):
        return KernelSurrogate()
