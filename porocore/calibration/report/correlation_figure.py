"""Figure of the correlations of the unknowns."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from porocore.calibration.inference.infer import Inference
from porocore.report.figures.style import named, new_figure, styled

#: Unknowns at most whose correlations are written into the figure.
MOST_NUMBERS = 10


@styled
def correlation_figure(inference: Inference) -> Figure:
    """Draw the correlations of the coordinates to first order, without priors, each with its number, or a dash."""
    names = [named(one.name.replace("_", " ")) for one in inference.unknowns]
    correlations = inference.correlations
    count = len(names)
    numbers = count <= MOST_NUMBERS
    figure = new_figure(2.4 + 0.75 * count, 1.3 + 0.62 * count) if numbers else new_figure(9.9, 7.5)
    axes = figure.add_subplot()
    image = axes.imshow(correlations, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_xticks(range(count), names, rotation=30, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(count), names)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for (i, j), value in np.ndenumerate(correlations) if numbers else ():
        text = _text(float(value)) if i != j else "1"
        axes.text(
            j, i, text, ha="center", va="center", fontsize=9, color="white" if abs(value) > 0.6 else "black"
        )
    figure.colorbar(image, ax=axes, shrink=0.85).set_label("correlation [–]")
    return figure


def _text(value: float) -> str:
    """Return two digits, and as many nines as there are up to four; a dash for NaN."""
    if value != value:
        return "–"
    for digits in (2, 3, 4):
        if abs(round(value, digits)) < 1:
            # Without the sign of a zero.
            return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")
    return "> 0.9999" if value > 0 else "< −0.9999"
