"""Surrogate ``polynomial``: least squares for the potential, in numpy alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.echo import cut, echo
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import OnProgress, TrainingProgress, TrainingSet
from porocore.surrogates.error_estimate.models import with_potential_error
from porocore.surrogates.family.error import with_family_error
from porocore.surrogates.family.fit import family_model
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.regression import Weights
from porocore.surrogates.polynomial.fit import polynomial_model
from porocore.surrogates.portable import ModelSurrogate
from porocore.surrogates.potential.model import PotentialModel


class PolynomialSurrogate(ModelSurrogate):
    """Polynomial W(ln U, p), fitted to W and its first derivatives in milliseconds.

    It has the symmetry of the cell: in a problem of up to three variables by coefficients that are the same, in more
    because the variables are combined to terms that the cell's operations leave alone.

    Parameters
    ----------
    model
        ``potential``, the only one.
    degree : int, 2 to 12
        Largest weight of a monomial, which leaves two equations for each coefficient; null: the one with the smallest
        cross-validated error, and at most 4 in up to three variables: what is finer is not continued beyond the sampled
        states, whose hull is no box.
    """

    backend = "polynomial"
    models = ("potential",)
    learns_parameters = True

    def __init__(self, *, model: str | None = None, degree: int | None = None, **unknown: Any) -> None:
        if unknown:
            raise ConfigurationError(
                f"surrogate.options.{cut(min(unknown))}: the polynomial surrogate has no such option; "
                "its option is degree"
            )
        if degree is not None and (
            isinstance(degree, bool) or not isinstance(degree, int) or not 2 <= degree <= 12
        ):
            raise ConfigurationError(
                f"surrogate.options.degree: expected a whole number from 2 to 12, got {echo(degree)}"
            )
        super().__init__(model=model, degree=degree)
        self.degree = degree

    def train(
        self, data: TrainingSet, seed: int, checkpoint: Path | None, on_progress: OnProgress | None
    ) -> tuple[PotentialModel | FamilyModel, dict[str, float]]:
        """Fit to the stable states of ``data``; nothing is random, and nothing takes long enough to be resumed."""
        if data.inputs.parameters:
            return self._train_family(data, on_progress)
        model, found = polynomial_model(data, self.degree)
        errors = {"cross-validated slopes of W": found.errors[found.degree]} if found.errors else {}
        if on_progress is not None:
            loss = found.errors.get(found.degree, float("nan")) ** 2
            on_progress(TrainingProgress(1, 1, loss))
        self.settings = {"degree": found.degree}
        return with_potential_error(model, data), errors

    def _train_family(
        self, data: TrainingSet, on_progress: OnProgress | None
    ) -> tuple[FamilyModel, dict[str, float]]:
        model, found, known = family_model(data, Weights(), self.degree)
        if on_progress is not None:
            on_progress(TrainingProgress(1, 1, found.error**2))
        self.settings = {"degree": found.degree}
        errors = {"cross-validated slopes of W": found.error} if np.isfinite(found.error) else {}
        return with_family_error(model, known, data.tolerance), errors
