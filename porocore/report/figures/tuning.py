"""Error against size of the architectures that were tried."""

from __future__ import annotations

from collections.abc import Sequence

from porocore.report.figures.style import (
    BLUE,
    DASHED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    new_figure,
    png_bytes,
    styled,
)


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
