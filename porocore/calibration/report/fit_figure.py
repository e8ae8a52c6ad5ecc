"""Figure of a fit: a measured curve with the best prediction, and the residuals below."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.calibration.report.contents import CalibrationContents, labelled
from porocore.core.units.quantities import pretty
from porocore.report.figures.style import BLACK, BLUE, GREY, legend_above, lighter, new_figure, styled
from porocore.states import Array

#: Ratio of last and first time from which the axis of time is logarithmic.
WIDE = 50.0
#: The band of the residuals.
BAND = 2.0


@styled
def fit_figure(contents: CalibrationContents, curve: int) -> Figure:
    """Draw one curve: data with bars of one standard deviation, the best prediction, and the residuals below."""
    data, axes_of = contents.data, contents.curve_axes(curve)
    rows = contents.rows_of(curve)
    times, values, deviations = data.times[rows], data.values[rows], data.deviations[rows]
    predicted = contents.inference.best.prediction.values[rows]
    figure = new_figure(5.4, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    upper.errorbar(
        times, values, deviations, fmt="o", ms=3.4, mfc="white", mec=BLACK, mew=0.8, ecolor=GREY, elinewidth=0.8,
        label=f"{'data' if contents.truth is None else 'made-up data'}, ± 1 standard deviation",
    )  # fmt: skip
    upper.plot(times, predicted, color=BLUE, label="fit", zorder=3)
    upper.set_ylabel(labelled(axes_of.label or data.names[curve], axes_of.unit))
    if 0 <= min(values.min(), predicted.min()) < 0.5 * values.max():
        upper.set_ylim(bottom=0)
    _residuals(lower, times, (values - predicted) / deviations)
    lower.set_xlabel(f"time $t$ [{pretty(axes_of.time_unit) or '–'}]")
    if times[0] > 0 and times[-1] > WIDE * times[0]:
        lower.set_xscale("log")
    figure.align_ylabels()
    legend_above(figure, upper, columns=2)
    return figure


def _residuals(axes: Axes, times: Array, residuals: Array) -> None:
    axes.axhspan(-BAND, BAND, color=lighter(BLUE, 0.85), lw=0)
    axes.axhline(0.0, color=BLUE, lw=1.0)
    axes.plot(times, residuals, "o", ms=3.4, mfc="white", mec=BLACK, mew=0.8)
    most = 1.15 * max(float(np.abs(residuals).max()), 1.3 * BAND)
    axes.set_ylim(-most, most)
    axes.set_ylabel("residual\n[standard dev.]")
