"""Known error of the predicted curves (SystematicError): how far it moves the best values, to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.calibration.inference.precision import ROUND_OFF, LinearPrecision
from porocore.states import Array

#: An error that moves no combination of the unknowns by more than this many standard deviations is small: a 95 %
#: interval that leaves it out holds the true value in 94.5 % of all repeats.
SMALL = 0.2


@dataclass(frozen=True, eq=False)
class SystematicError:
    """Error of the predicted curves, such as that of their steps in time, at the best point.

    Attributes
    ----------
    errors : (m,)
        Predicted less exact values, over the standard deviations of the data.
    shift : (k,)
        Move of the best coordinates that exact curves would bring.
    deviations : (k,)
        The same in standard deviations of each coordinate; 0 where these are infinite.
    size
        Largest move of any combination of the unknowns, in its standard deviations.
    counted
        True where the intervals hold the best values of exact curves, too.
    """

    errors: Array
    shift: Array
    deviations: Array
    size: float
    counted: bool = False

    @classmethod
    def at_best(cls, errors: Array, jacobian: Array, limits: Array) -> SystematicError:
        """Return what errors (m,) do, by the weighted Jacobian (m + priors, k) at the best point.

        Parameters
        ----------
        errors
            Predicted less exact values, over the standard deviations of the data.
        jacobian
            Derivatives of the residuals by the coordinates, those of priors last.
        limits : (k,)
            Lengths by which coordinates are measured.
        """
        whole = np.concatenate([errors, np.zeros(len(jacobian) - len(errors))])
        left, values, right = np.linalg.svd(jacobian * limits, full_matrices=False)
        seen = values > ROUND_OFF * values[0]
        along = left[:, seen].T @ whole
        shift = limits * (right[seen].T @ (along / values[seen]))
        spread = LinearPrecision.from_jacobian(jacobian * limits).deviations * limits
        return cls(errors, shift, shift / spread, float(np.linalg.norm(along)))

    @property
    def is_small(self) -> bool:
        """True where intervals may leave it out."""
        return self.size <= SMALL
