"""Interval of the ratio viscosity/conductivity (ratio_interval), a function of two unknowns.

The same curves are computed with the ratio in place of the viscosity; its interval is then that of an unknown, by its
profile. The conductivity K is that of the undeformed cell, a function of the radius.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.minimum import Objective, minimise
from porocore.commands.calibration.problem import CurveModel, CurvePrediction, Fitted, Misfit, Unknown
from porocore.commands.calibration.profiles import confidence_interval
from porocore.commands.calibration.suggestions import IdentifiabilityRule

Array = npt.NDArray[np.float64]
#: Degree of ln K in ln r.
DEGREE = 6


@dataclass(frozen=True, eq=False)
class PowerSeries:
    """ln K as a polynomial of ln r."""

    polynomial: np.polynomial.Chebyshev

    @classmethod
    def of(cls, conductivity: Callable[[Array], Array], lower: float, upper: float) -> PowerSeries:
        """The polynomial through values at Chebyshev points of ln r."""
        found = np.polynomial.Chebyshev.interpolate(
            lambda x: np.log(conductivity(np.exp(x))), DEGREE, [np.log(lower), np.log(upper)]
        )
        return cls(found)

    def value(self, radius: float) -> float:
        """K."""
        return float(np.exp(self.polynomial(np.log(radius))))

    def relative_slope(self, radius: float) -> float:
        """K'/K."""
        return float(self.polynomial.deriv()(np.log(radius)) / radius)


class RatioModel(CurveModel):
    """Curves of a model with the ratio viscosity/conductivity in place of the viscosity."""

    def __init__(self, model: CurveModel, conductivity: PowerSeries) -> None:
        self.model, self.conductivity = model, conductivity
        names = [one.name for one in model.unknowns]
        self.radius, self.place = names.index("radius"), names.index("viscosity")
        radius, viscosity = model.unknowns[self.radius], model.unknowns[self.place]
        ratio = Unknown(
            "viscosity/conductivity",
            viscosity.start / conductivity.value(radius.start),
            viscosity.lower / conductivity.value(radius.upper),
            viscosity.upper / conductivity.value(radius.lower),
            "log",
        )
        self.unknowns = tuple(
            ratio if i == self.place else replace(one) for i, one in enumerate(model.unknowns)
        )

    def ratio(self, values: Array) -> float:
        """The ratio at values of the model's unknowns."""
        return float(values[self.place]) / self.conductivity.value(float(values[self.radius]))

    def slopes(self, slopes: Array, values: Array) -> Array:
        """Slopes by radius … ratio of slopes by radius … viscosity at values of the model's unknowns."""
        radius, viscosity = float(values[self.radius]), float(values[self.place])
        made = slopes.copy()
        by = slopes[:, self.place]
        made[:, self.radius] += by * viscosity * self.conductivity.relative_slope(radius)
        made[:, self.place] = by * self.conductivity.value(radius)
        return made

    def curves(self, values: Array) -> CurvePrediction:
        """Curves at values with the ratio."""
        plain = values.copy()
        plain[self.place] *= self.conductivity.value(float(values[self.radius]))
        found = self.model.curves(plain)
        return replace(found, slopes=self.slopes(found.slopes, plain))


def ratio_interval(
    misfit: Misfit, best: Fitted, conductivity: PowerSeries
) -> tuple[float, tuple[float | None, float | None], bool]:
    """Best value, 95 % interval and identifiability of viscosity/conductivity at the best point of a fit."""
    model = RatioModel(misfit.model, conductivity)
    changed = Misfit(model, misfit.data)
    values = misfit.values(best.coordinates)
    at = best.coordinates.copy()
    at[model.place] = np.log(model.ratio(values))
    prediction = replace(best.prediction, slopes=model.slopes(best.prediction.slopes, values))
    scale = np.array([one.value_slope(x) for one, x in zip(model.unknowns, at, strict=True)])
    jacobian = prediction.slopes * scale / misfit.data.deviations[:, None]
    rule = IdentifiabilityRule()
    objective = Objective(changed, rule.limits(model.unknowns, at))
    objective.add(Fitted(at, prediction, best.residuals, jacobian))
    least = minimise(objective, at, np.arange(len(at)))
    found = confidence_interval(objective, least, model.place, strict=False).values
    value = float(np.exp(least.fitted.coordinates[model.place]))
    return value, found, rule.holds(model.unknowns[model.place], value, *found)
