"""Quality of a fit: reduced chi-square, how far each curve is off, data that nothing explains, bounds that hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.calibration.problem import CurveData, Fitted, Misfit
from porocore.states import Array

#: Data are not explained where the reduced chi-square is above this, and so large a one comes by chance less often.
LARGE, CHANCE = 2.0, 1e-6
#: So near to a bound, as a share of the distance of both, an unknown lies at it.
CLOSE = 1e-6


@dataclass(frozen=True)
class FitQuality:
    """Quality of the best point: chi-square and the distances of each curve.

    Attributes
    ----------
    chi_square
        Sum of the squares of (predicted − measured)/deviation.
    freedom
        Number of values less that of unknowns, 1 at least.
    deviations_off
        Root mean square of (predicted − measured)/deviation of each curve, by its name.
    chance
        Probability of a chi-square at least as large, if the model is right and the standard deviations are.
    """

    chi_square: float
    freedom: int
    deviations_off: dict[str, float]
    chance: float

    @classmethod
    def of_fit(cls, misfit: Misfit, best: Fitted) -> FitQuality:
        """Return the quality of a point."""
        from scipy.stats import chi2

        data: CurveData = misfit.data
        residuals: Array = best.residuals[: len(data.values)]
        freedom = max(1, len(residuals) - len(misfit.unknowns))
        off = {
            name: float(np.sqrt(np.mean(residuals[data.curve == k] ** 2)))
            for k, name in enumerate(data.names)
        }
        total = float(residuals @ residuals)
        return cls(total, freedom, off, float(chi2.sf(total, freedom)))

    @property
    def reduced(self) -> float:
        """Chi-square by the degrees of freedom, about 1 where the model explains the data."""
        return self.chi_square / self.freedom

    @property
    def explains(self) -> bool:
        """False where the data are farther from every prediction than their standard deviations allow."""
        return self.reduced <= LARGE or self.chance >= CHANCE

    @property
    def complaint(self) -> str:
        """One sentence where the data are not explained; empty where they are."""
        if self.explains:
            return ""
        name, off = max(self.deviations_off.items(), key=lambda each: each[1])
        return (
            f"no values of the unknowns explain the data: the reduced chi-square is {self.reduced:.3g}, expected about "
            f"1; the curve '{name}' is off by {off:.3g} standard deviations (root mean square). Check its clock (at "
            "t = 0 the load of the study begins; an unknown 'of: time_shift' moves the data), units, signs and zero of "
            "its columns ('offset:' is subtracted), the standard deviations, the bounds, and what the study leaves out"
        )


def at_bounds(misfit: Misfit, coordinates: Array) -> list[str]:
    """Return a sentence for each unknown that lies at a bound of the search, at coordinates (k,)."""
    lower, upper = misfit.bounds
    return [
        f"the fitted {one.name} lies at the bound of the search, {one.value(float(bound)):.4g} {one.unit}".rstrip()
        + "; widen the bounds"
        for one, x, low, high in zip(misfit.unknowns, coordinates, lower, upper, strict=True)
        for bound in (low, high)
        if abs(x - bound) < CLOSE * (high - low)
    ]
