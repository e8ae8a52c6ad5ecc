"""Base of surrogates with a model of porocore (ModelSurrogate): fit, predict, save, load; reader in numpy."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from porocore.core.echo import echo
from porocore.core.inputs import InputSpace
from porocore.core.parallel.memory import exactly_one_blas_thread
from porocore.errors import ConfigurationError
from porocore.interfaces.law import UndeformedCells
from porocore.interfaces.surrogate import OnProgress, Surrogate, TrainingSet
from porocore.states import CELL_FIELDS, Array, CellResponse, CellSlopes, Doubt, MacroState
from porocore.surrogates.conductivity import ConductivityModel, fit_conductivity
from porocore.surrogates.error_estimate.estimate import ERROR_END, reasons
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.file import file
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.model import PotentialModel, slopes_by_parameters
from porocore.surrogates.network.network import Evaluator, Network

#: Bytes; glibc adapts up to 32 MiB.
_KEPT_MEMORY = 24 << 20
#: Why a state is flagged that lies within all ranges and has a small estimated error.
CLOSED = "next to states whose pore walls touch and that have no conductivity; end the ranges before the walls touch"
#: Learned quantities of each model beside the conductivity.
MECHANICS = {"mlp": "⟨∇u¹⟩", "potential": "stress and fluid volume"}
#: Responses that each model predicts.
PROVIDES = {
    model: tuple(name for name, f in CELL_FIELDS.items() if model in f.models)
    for model in ("mlp", "potential")
}


class ModelSurrogate(Surrogate):
    """Prediction, saving and loading; a subclass adds ``train``, and may replace the evaluation of networks.

    A file that one backend wrote is read by every other: it holds numbers only.

    Attributes
    ----------
    backend
        Name of the surrogate for the user.
    model
        ``mlp`` or ``potential``.
    accuracy
        Errors on the states that training held back, as shares of the range; of ln K absolute.
    conductivity
        Model of K_ref of the deformed pore; None where the training states hold none.
    """

    backend: ClassVar[str]
    models: ClassVar[tuple[str, ...]] = ("mlp", "potential")
    conductivity: ConductivityModel | None = None
    _fitted_model: file.Model | None = None

    def __init__(self, *, model: str | None = None, **options: Any) -> None:
        model = self.models[0] if model is None else model
        if model not in self.models:
            raise ConfigurationError(
                f"surrogate.model: expected {' or '.join(self.models)} of the {self.backend} surrogate, "
                f"got {echo(model)}"
            )
        self.model, self.settings = model, options
        self.accuracy: dict[str, float] = {}

    @property
    def provides(self) -> tuple[str, ...]:
        """Responses that :meth:`predict` fills in."""
        return PROVIDES[self.model]

    def evaluator(self, network: Network) -> Evaluator:
        """Return the backend's evaluation of a network; numpy by default."""
        return network

    @abstractmethod
    def train(
        self, data: TrainingSet, seed: int, checkpoint: Path | None, on_progress: OnProgress | None
    ) -> tuple[file.Model, dict[str, float]]:
        """Return the model of W or of <∇u¹>_s with its named errors; parameters as in :meth:`fit`."""

    def fit(
        self,
        data: TrainingSet,
        *,
        seed: int,
        checkpoint: Path | None = None,
        on_progress: OnProgress | None = None,
    ) -> Self:
        """Train on ``data``, and on K_ref of the deformed pore if the states hold it; return self.

        The same data, options and seed give the same numbers to the last bit, with any number of threads.

        Raises
        ------
        ConfigurationError
            The options do not suit the cell, or the device is a GPU and there is none.
        DataError
            The data cannot be used, or the checkpoint is damaged or belongs to another training.
        RunFolderError
            The checkpoint cannot be written.
        """
        self.load_libraries()  # before the limit on threads, which loads the MKL that PARDISO has found
        with exactly_one_blas_thread():
            model, self.accuracy = self.train(data, int(seed), checkpoint, on_progress)
            self._become(model, data.identity, data.provenance)
            found = fit_conductivity(data, model.rest if isinstance(model, PotentialModel) else None)
        if found is not None:
            self.conductivity, error = found
            self.accuracy |= {"cross-validated ln K": error}
        return self

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states; see :class:`~porocore.Surrogate`.

        Every status is ``converged``; rows that are not to be trusted hold what the model says all the same, and are
        flagged: those whose error is estimated to exceed the tolerance, and those far from all training states. The
        conductivity of the deformed pore is there if it was trained on, and its error counts too.
        """
        response = self.fitted.predict(states, tangent=tangent)
        if self.conductivity is None:
            return response
        K, by_H, by_p = self.conductivity.predict(states, tangent=tangent)
        gradients = response.tangent
        if gradients is not None:
            gradients = replace(gradients, conductivity_grad_u=by_H, conductivity_p=by_p)
        doubt = self.conductivity.doubt(states)
        if response.doubt is not None:
            doubt = doubt | response.doubt
        return replace(response, conductivity=K, tangent=gradients, doubt=doubt)

    def undeformed(self, parameters: Array) -> UndeformedCells | None:
        """Return porosity and conductivity of the undeformed members; None for a cell without parameters.

        None also where the training set had no conductivity.
        """
        rest = self._members()
        conductivity = None if rest is None else rest.conductivities(parameters)
        if rest is None or conductivity is None:
            return None
        return UndeformedCells(rest.at(parameters).porosity, conductivity)

    def slopes(self, states: MacroState) -> CellSlopes:
        """Return the exact derivatives of what :meth:`predict` returns by the parameters of the cell.

        That of the conductivity is of K_ref of the deformed pore if this was trained on, else of K of the undeformed
        one; None where neither is known.
        """
        model, rest = self.fitted, self._members()
        if rest is None or not isinstance(model, PotentialModel):
            return super().slopes(states)
        found = slopes_by_parameters(model, states)
        if self.conductivity is not None:
            return replace(found, conductivity=self.conductivity.slopes(states))
        assert states.parameters is not None
        return replace(found, conductivity=rest.conductivity_slopes(states.parameters))

    def _members(self) -> RestModel | None:
        """Return the undeformed members of a family; None for a cell without parameters."""
        model = self.fitted
        rest = model.rest if isinstance(model, PotentialModel) else None
        return rest if isinstance(rest, RestModel) else None

    def reasons(self, states: MacroState) -> list[str]:
        """Return the component that drives each flagged state out, with its value."""
        model = self.fitted
        if isinstance(model, PotentialModel):
            states = self.inputs.without_rotation(states)
        found = reasons(self.inputs, states, None if model.estimate is None else self._error)
        if model.estimate is not None:
            found = self._named(found, states, model.estimate.tolerance)
        if self.conductivity is None:
            return found
        closed = (self.conductivity.doubt(states) & Doubt.closed) != 0
        return [f"{said}, {CLOSED}" if near else said for said, near in zip(found, closed, strict=True)]

    def _named(self, found: list[str], states: MacroState, tolerance: float) -> list[str]:
        """Return the reasons with the quantities whose estimated errors exceed the tolerance, and what stays good."""
        model, mechanics = self.fitted, MECHANICS[self.model]
        errors, strange = model.error(states), model.predict(states, tangent=False).flagged
        flows = errors * np.nan if self.conductivity is None else self.conductivity.error(states)
        named = []
        for n, said in enumerate(found):
            if said.endswith(ERROR_END) and np.fmax(errors[n], flows[n]) > tolerance:
                both = errors[n] > tolerance and flows[n] > tolerance
                said += f" of the conductivity or of {mechanics}; both exceed the tolerance" if both else ""
                said += f" of {mechanics}" if not flows[n] > tolerance else ""
                said += " of the conductivity" if not errors[n] > tolerance else ""
                if not strange[n]:
                    said += (
                        f"; that of {mechanics} is {100 * errors[n]:.2g} %, within the tolerance, so forces and "
                        "displacements in equilibrium can be relied on, but not the times that flow takes"
                    )
            named.append(said)
        return named

    def _error(self, states: MacroState) -> Array:
        """Return the estimated error (n,), a share of the range of whatever is worst."""
        error = self.fitted.error(states)
        return error if self.conductivity is None else np.fmax(error, self.conductivity.error(states))

    def save(self, path: Path) -> None:
        """Write one HDF5 file, atomically."""
        model = self.fitted
        metadata = file.SurrogateMetadata(
            self.backend, self.settings, self.identity, self.provenance, self.accuracy, self.conductivity
        )
        file.write(path, model, metadata)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what any backend's :meth:`save` wrote."""
        surrogate = cls.__new__(cls)
        model, metadata = file.read(path)
        surrogate.model = "mlp" if isinstance(model, AnchoredModel) else "potential"
        surrogate.settings, surrogate.accuracy = metadata.options, metadata.accuracy
        surrogate._become(file.evaluated(model, surrogate.evaluator), metadata.identity, metadata.provenance)
        surrogate.conductivity = metadata.conductivity
        return surrogate

    def _become(self, model: file.Model, identity: str, provenance: dict[str, str]) -> None:
        keep_freed_memory()
        self._fitted_model = model
        self.inputs: InputSpace = model.sampled.inputs
        self.parameters = self.inputs.parameters
        self.identity, self.provenance = identity, dict(provenance)

    @property
    def fitted(self) -> file.Model:
        """The trained model.

        Raises
        ------
        RuntimeError
            There is none yet.
        """
        if self._fitted_model is None:
            raise RuntimeError("this surrogate has not been trained; call fit or load first")
        return self._fitted_model


class NumpySurrogate(ModelSurrogate):
    """Reader of the file of any backend, in numpy alone."""

    backend = "numpy"
    learns_parameters = True

    def train(self, *_: Any) -> tuple[file.Model, dict[str, float]]:
        """Raise a ConfigurationError, since this class only reads."""
        raise ConfigurationError("choose a surrogate that can be trained, such as polynomial")


def keep_freed_memory() -> None:
    """Make glibc keep the memory that predictions free, instead of returning it to the system.

    It raises its thresholds to the largest block that was ever freed, so freeing one that was never touched is
    enough. The page faults that this saves can cost more than a prediction of thousands of states.
    """
    block = np.empty(_KEPT_MEMORY, dtype=np.uint8)
    del block
