"""Cheap models of experiments in closed form, and data made with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.commands.calibration.problem import (
    CurveData,
    CurveModel,
    CurvePrediction,
    Misfit,
    Unknown,
    slopes_at,
    values_at,
)
from porocore.commands.calibration.suggestions import FurtherData
from porocore.errors import SolveError
from porocore.macro.analytic import Terzaghi


@dataclass(eq=False)
class Formula(CurveModel):
    """Any formula of the values, with slopes by complex steps or as given."""

    unknowns: tuple[Unknown, ...]
    formula: object
    #: Values below or above which the experiment cannot be computed, or is flagged; by unknown.
    computable: tuple[tuple[float, float], ...] = ()
    trusted: tuple[tuple[float, float], ...] = ()
    calls: int = 0

    def curves(self, values):
        self.calls += 1
        if self._beyond(values, self.computable):
            raise SolveError("made up")
        h = 1e-30
        columns = [self.formula(values + 1j * h * e).imag / h for e in np.eye(len(values))]
        flagged = self._beyond(values, self.trusted)
        return CurvePrediction(self.formula(values.astype(complex)).real, np.stack(columns, axis=1), flagged)

    @staticmethod
    def _beyond(values, ranges):
        return any(not low <= x <= high for x, (low, high) in zip(values, ranges, strict=False))


class Consolidation(CurveModel):
    """Settlement of Terzaghi's layer over its modulus and conductivity."""

    def __init__(self, unknowns, times):
        self.unknowns, self.times = unknowns, times

    def layer(self, modulus, conductivity):
        return Terzaghi(1.0, 0.1, modulus, 0.8, 0.05, conductivity)

    def curves(self, values):
        def at(x):
            return self.layer(*x).settlement(self.times)

        h = 1e-6 * values
        columns = [(at(values + s) - at(values - s)) / (2 * s.sum()) for s in np.diag(h)]
        return CurvePrediction(at(values), np.stack(columns, axis=1))


def data_of(values, deviations, times=None, names=("curve",), curve=None):
    """Data of one curve, or of several."""
    count = len(values)
    return CurveData(
        np.array(values, float),
        np.broadcast_to(np.asarray(deviations, float), (count,)).copy(),
        np.zeros(count, int) if curve is None else curve,
        np.arange(count, dtype=float) if times is None else times,
        names,
    )


def misfit_of(model, truth, deviation, noise=None, times=None):
    """Misfit against the model's own curve at the truth, with noise in standard deviations."""
    values = model.curves(np.array(truth, float)).values
    shift = 0.0 if noise is None else noise * deviation
    return Misfit(model, data_of(values + shift, deviation, times))


def experiment(name, model, coordinates, deviations):
    """Data of a further experiment with the same unknowns: its slopes by the coordinates, in standard deviations."""
    slopes = model.curves(values_at(model.unknowns, coordinates)).slopes
    return FurtherData(name, slopes * slopes_at(model.unknowns, coordinates) / deviations[:, None])
