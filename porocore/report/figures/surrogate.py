"""Figures of a surrogate: predicted against solved, losses of a training, errors of network sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from porocore.core.units.results import spoken
from porocore.report.context import TrainingCurve
from porocore.report.figures.style import (
    BLUE,
    DASHED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    axis_label,
    legend_above,
    new_figure,
    png_bytes,
    styled,
)
from porocore.report.words.held_out import OutputCheck, rms_percent, worst_percent


@styled
def parity_figure(checks: Sequence[OutputCheck]) -> Figure:
    """Draw predicted against solved held-out states, one column of panels for each output, errors beneath.

    Held-out states beyond the sampled range are grey and hollow and do not count in the error in the panel, unless
    there are no others.
    """
    figure = new_figure(4.4 * len(checks), 5.0)
    panels = figure.subplots(2, len(checks), squeeze=False, sharex="col", height_ratios=[3, 1.25])
    for check, parity, error in zip(checks, *panels, strict=True):
        units = spoken()
        factor = units.factor(check.quantity)
        solved, predicted = check.solved * factor, check.predicted * factor
        both = np.concatenate([solved, predicted])
        ends = np.array([both.min(), both.max()]) if len(both) else np.array([0.0, 1.0])
        ends = ends + 0.04 * (ends[1] - ends[0]) * np.array([-1, 1])
        parity.plot(ends, ends, color=GREY, lw=1.0)
        deviation = 100 * (check.predicted - check.solved) / check.span
        for axes, y in ((parity, predicted), (error, deviation)):
            beyond = check.outside_training_range
            if beyond.any():
                axes.plot(solved[beyond], y[beyond], "o", ms=4, mfc="white", mec=GREY, mew=0.9)
            axes.plot(solved[~beyond], y[~beyond], "o", ms=4, mfc=BLUE, mec="white", mew=0.4)
        error.axhline(0, color=GREY, lw=1.0)
        parity.set(xlim=ends, ylim=ends, ylabel=axis_label(f"predicted {check.name}", check.quantity, units))
        error.set(
            xlabel=axis_label(f"solved {check.name}", check.quantity, units), ylabel="error [% of range]"
        )
        error.xaxis.set_major_locator(MaxNLocator(5))
        parity.text(0.04, 0.96, _error_text(check), transform=parity.transAxes, va="top", fontsize=9)
    figure.align_ylabels()
    return figure


@styled
def training_figure(curve: TrainingCurve) -> Figure:
    """Draw losses against epochs, logarithmic; the best validation loss is marked where states were kept for it."""
    figure = new_figure(5.4, 3.6)
    axes = figure.add_subplot()
    axes.semilogy(curve.epoch, curve.loss, color=BLUE, lw=1.3, label="training")
    if curve.validated:
        axes.semilogy(
            curve.epoch,
            curve.validation_loss,
            color=VERMILLION,
            lw=1.3,
            ls=(0, (4, 1.5)),
            label="validation",
        )
        best = int(np.nanargmin(curve.validation_loss))
        axes.plot(
            curve.epoch[best],
            curve.validation_loss[best],
            "v",
            ms=8,
            mfc="white",
            mec=VERMILLION,
            mew=1.5,
            label=f"best, epoch {curve.epoch[best]:.0f}",
        )
    axes.set(
        xlabel="epoch" if curve.validated else "iteration", ylabel="loss (mean squared error, scaled) [–]"
    )
    axes.margins(x=0.02)
    legend_above(figure, axes, columns=3)
    return figure


@styled
def tuning_figure(points: Sequence[tuple[str, int, float]], chosen: tuple[int, float], limit: float) -> bytes:
    """PNG of (activation, parameters, error) with the chosen one ringed and the largest error that is good enough."""
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
    colours = (BLUE, ORANGE, GREEN, PURPLE)
    for i, activation in enumerate(dict.fromkeys(name for name, _, _ in points)):
        own = [(size, 100 * error) for name, size, error in points if name == activation]
        axes.plot(*zip(*own, strict=True), "o", ms=5, color=colours[i % len(colours)], label=activation)
    axes.axhline(100 * limit, color=GREY, ls=DASHED, lw=1, label="within the margin of the best")
    axes.plot(
        chosen[0], 100 * chosen[1], "o", ms=13, mfc="none", mec="black", mew=1.4, label="smallest of these"
    )
    axes.set(xscale="log", yscale="log", xlabel="weights and biases")
    axes.set_ylabel("error on held-out states [% of the range]")
    axes.legend()
    return png_bytes(figure)


def _error_text(check: OutputCheck) -> str:
    rms, worst, beyond = rms_percent(check), worst_percent(check), int(check.outside_training_range.sum())
    if rms is None or worst is None:
        text = "no held-out states"
    else:
        text = f"RMS {rms:.2g} % of range\nworst {worst:.2g} %\n{int(check.counted.sum())} states"
    if check.all_outside:
        return text + ", all beyond the range (hollow)"
    return text + (f"\n({beyond} beyond the range, hollow)" if beyond else "")
