"""A Gaussian process for <∇u¹>_s, which also says how sure it is."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from porocore import (
    CellResponse,
    CellTangent,
    ConfigurationError,
    DataError,
    InputSpace,
    MacroState,
    SampledRange,
    Surrogate,
    TrainingProgress,
    TrainingSet,
)
from porocore.surrogates.file.file import read_archive, write_archive
from porocore_surrogate_gaussian_process.kernel import covariance, slopes, variance

FORMAT, VERSION = "porocore-surrogate-gaussian-process", 1
ADVICE = "train it again: porocore train"


class GaussianProcessSurrogate(Surrogate):
    """<∇u¹>_s = M:H + Q p + a Gaussian process of the sampled inputs that begins flat at rest.

    As in Rasmussen & Williams, Gaussian Processes for Machine Learning (2006), chapters 2 and 5: one length of
    correlation for each input, found by maximising the marginal likelihood, and one amplitude for each component. The
    states themselves are met but for ``noise``.

    Parameters
    ----------
    noise
        Standard deviation of what the process does not follow, as a share of its own.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use.
    """

    #: Responses that it predicts.
    provides = ("mean_grad",)

    def __init__(self, *, noise: float = 1e-4, **unknown):
        if unknown:
            raise ConfigurationError(
                f"surrogate.options.{min(unknown)}: gaussian-process has no such option; its option is noise"
            )
        if isinstance(noise, bool) or not isinstance(noise, int | float) or not 1e-6 <= noise <= 1:
            raise ConfigurationError(
                f"surrogate.options.noise: must be a number from 1e-6 to 1, got {noise!r}"
            )
        self.noise = float(noise)

    def fit(self, data: TrainingSet, *, seed, checkpoint=None, on_progress=None):
        """See porocore.Surrogate; nothing is random, and nothing takes long enough to be resumed.

        Raises
        ------
        DataError
            Fewer than three stable states.
        """
        stable = data.responses.stable
        states = data.states[stable]
        if len(states) < 3:
            raise DataError(f"gaussian-process: expected at least three stable states, got {len(states)}")
        self.inputs, self.identity = data.inputs, data.identity
        self.provenance = dict(data.provenance)
        tangent = data.reference.tangent
        self._M, self._Q = tangent.mean_grad_grad_u[0], tangent.mean_grad_p[0]
        x = data.inputs.gather(states)
        bend = (data.responses.mean_grad[stable] - self._linear(states)).reshape(-1, 9)
        width = np.array(data.inputs.upper) - np.array(data.inputs.lower)

        def cost(logarithms):
            return self._cost(x / (width * np.exp(logarithms)), bend)

        found = minimize(cost, np.zeros(len(width)), method="L-BFGS-B", bounds=[(-1.5, 3.0)] * len(width))
        self._lengths = width * np.exp(found.x)
        self._points = x / self._lengths
        factor = self._factor(self._points)
        # In the layout that a file gives back, so that sums are added in the same order.
        self._weights = np.ascontiguousarray(cho_solve((factor, True), bend))
        self._amplitudes = np.sqrt(np.maximum((bend * self._weights).mean(axis=0), 0.0))
        self._sampled = SampledRange.around(data.inputs, data.inputs.gather(data.states))
        self._lower = factor
        if on_progress is not None:
            on_progress(TrainingProgress(1, 1, float(found.fun), float(found.fun)))
        return self

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """See porocore.Surrogate."""
        n = len(states)
        x = self.inputs.gather(states) / self._lengths
        # Row by row, so that a row does not depend on those beside it.
        bend = np.einsum("nm,mc->nc", covariance(x, self._points), self._weights).reshape(n, 3, 3)
        derivatives = None
        if tangent:
            by_all = np.zeros((n, 9, 10))
            by_input = np.einsum("nmd,mc->ncd", slopes(x, self._points), self._weights) / self._lengths
            by_all[:, :, list(self.inputs.columns)] = by_input
            by_all = by_all.reshape(n, 3, 3, 10)
            by_H = self._M + by_all[..., :9].reshape(n, 3, 3, 3, 3)
            derivatives = CellTangent(mean_grad_grad_u=by_H, mean_grad_p=self._Q + by_all[..., 9])
        return CellResponse(
            mean_grad=self._linear(states) + bend,
            status=np.zeros(n, dtype=np.int64),
            tangent=derivatives,
            doubt=self._sampled.doubt(states),
        )

    def uncertainty(self, states: MacroState):
        """Standard deviation (n, 3, 3) of the prediction; it grows away from the states that it learned from."""
        x = self.inputs.gather(states) / self._lengths
        known = solve_triangular(self._lower, covariance(self._points, x), lower=True)
        left = np.maximum(variance(x) - (known**2).sum(axis=0), 0.0)
        return (np.sqrt(left)[:, None] * self._amplitudes).reshape(-1, 3, 3)

    def save(self, path) -> None:
        header = {
            "identity": self.identity,
            "provenance": self.provenance,
            "noise": self.noise,
            "inputs": [list(part) for part in (self.inputs.names, self.inputs.lower, self.inputs.upper)],
        }
        names = ("M", "Q", "lengths", "points", "weights", "amplitudes", "lower")
        arrays = {name: getattr(self, f"_{name}") for name in names}
        arrays |= {"normals": self._sampled.normals, "offsets": self._sampled.offsets}
        write_archive(path, FORMAT, VERSION, header, arrays)

    @classmethod
    def load(cls, path):
        header, arrays = read_archive(path, FORMAT, VERSION, ADVICE)
        surrogate = cls(noise=header["noise"])
        surrogate.inputs = InputSpace(*map(tuple, header["inputs"]))
        surrogate.identity, surrogate.provenance = header["identity"], header["provenance"]
        surrogate._sampled = SampledRange(surrogate.inputs, arrays.pop("normals"), arrays.pop("offsets"))
        for name, array in arrays.items():
            setattr(surrogate, f"_{name}", array)
        return surrogate

    def _factor(self, points):
        """Lower triangle of the covariance's Cholesky factorisation; the noise is a share of the mean variance."""
        K = covariance(points, points)
        K[np.diag_indices(len(K))] += self.noise**2 * np.trace(K) / len(K)
        return np.ascontiguousarray(np.tril(cho_factor(K, lower=True)[0]))

    def _cost(self, points, bend) -> float:
        """Negative logarithm of the marginal likelihood, with the best amplitude of each component that moves."""
        n = len(points)
        try:
            factor = self._factor(points)
        except np.linalg.LinAlgError:
            return 1e10
        amplitudes = (bend * cho_solve((factor, True), bend)).mean(axis=0)
        moving = amplitudes > 1e-12 * amplitudes.max()
        moving &= amplitudes > 0
        return float(moving.sum() * np.log(np.diag(factor)).sum() + n / 2 * np.log(amplitudes[moving]).sum())

    def _linear(self, states: MacroState):
        return np.einsum("ijkl,nkl->nij", self._M, states.grad_u) + states.p[:, None, None] * self._Q
