"""Figure of a fitted field: its control values with their intervals over a coordinate of the body."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from porocore.calibration.plan import FittedField
from porocore.calibration.report.contents import CalibrationContents, labelled
from porocore.report.figures.style import BLACK, BLUE, GREY, legend_above, new_figure, styled


@styled
def field_figure(contents: CalibrationContents, field: FittedField) -> Figure:
    """Draw one field: fitted values with bars of their 95 % intervals, and the truth of made-up data."""
    inference, members = contents.inference, list(field.members)
    places, values = np.array(field.places), inference.values[members]
    ends = [inference.intervals[i].values for i in members]
    bars = np.array(
        [
            [0.0 if low is None else value - low for value, (low, _) in zip(values, ends, strict=True)],
            [0.0 if high is None else high - value for value, (_, high) in zip(values, ends, strict=True)],
        ]
    )
    figure = new_figure(4.4, 3.2)
    axes = figure.add_subplot()
    if contents.truth is not None:
        axes.plot(places, contents.truth[members], color=BLACK, ls="--", label="truth")
    axes.errorbar(
        places, values, np.maximum(bars, 0.0), fmt="o-", ms=4, color=BLUE, ecolor=GREY, elinewidth=1.2, capsize=3,
        label="fit, 95 % intervals",
    )  # fmt: skip
    axes.set_xlabel(labelled(field.along, field.unit))
    axes.set_ylabel(labelled(field.name, inference.unknowns[members[0]].unit))
    legend_above(figure, axes, columns=2)
    return figure
