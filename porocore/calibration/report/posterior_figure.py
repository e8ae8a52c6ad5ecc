"""Figure of the posterior distribution: each unknown alone, and each pair, from the draws."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.calibration.posterior.posterior import Posterior
from porocore.calibration.report.contents import unknown_label
from porocore.report.figures.style import BLACK, BLUE, DASHED, GREEN, GREY, lighter, new_figure, styled
from porocore.states import Array

#: Unknowns that are drawn at most, the first ones.
MOST = 8
BINS = 40
#: Share of the draws that the axes leave out on either side.
OUTER = 0.001


@styled
def posterior_figure(posterior: Posterior, best: Array, truth: Array | None = None) -> Figure:
    """Draw the density of each unknown with median and 95 % credible interval, and that of each pair.

    Parameters
    ----------
    posterior
        Its draws.
    best : (k,)
        Values where the sum of squares is least.
    truth : (k,)
        Values with which data were made up.
    """
    unknowns, values = posterior.unknowns[:MOST], posterior.values
    count = len(unknowns)
    figure = new_figure(1.2 + 2.0 * count, 1.0 + 1.8 * count)
    panels = figure.subplots(count, count, squeeze=False, sharex="col")
    ends = np.quantile(values, [OUTER, 1 - OUTER], axis=0).T
    edges = [np.linspace(low, high, BINS + 1) for low, high in ends]
    for row, column in np.ndindex(count, count):
        axes = panels[row, column]
        if column > row:
            axes.set_visible(False)
            continue
        if column == row:
            _alone(axes, posterior, row, edges[row])
        else:
            axes.hist2d(
                values[:, column],
                values[:, row],
                bins=[edges[column], edges[row]],
                cmap="Blues",
                rasterized=True,
            )
            axes.plot(best[column], best[row], "P", ms=7, color=BLACK, mec="white")
        if truth is not None:
            axes.axvline(truth[column], color=GREEN, lw=1.2)
            if column < row:
                axes.axhline(truth[row], color=GREEN, lw=1.2)
        axes.grid(visible=False)
        _label(axes, posterior, row, column, count)
    figure.align_ylabels()
    return figure


def _alone(axes: Axes, posterior: Posterior, index: int, edges: Array) -> None:
    """Draw the density of one unknown, its median and the ends of its interval that there are."""
    axes.hist(posterior.values[:, index], bins=edges.tolist(), density=True, color=lighter(BLUE, 0.6))
    axes.axvline(posterior.medians[index], color=BLUE, lw=1.4)
    for end in posterior.intervals[index]:
        if end is not None:
            axes.axvline(end, color=GREY, ls=DASHED, lw=1.2)
    axes.set_yticks([])


def _label(axes: Axes, posterior: Posterior, row: int, column: int, count: int) -> None:
    if row == count - 1:
        axes.set_xlabel(unknown_label(posterior.unknowns[column]))
        axes.tick_params(axis="x", rotation=30)
    if column == 0 and row > 0:
        axes.set_ylabel(unknown_label(posterior.unknowns[row]))
    elif row != column:
        axes.tick_params(labelleft=False)
