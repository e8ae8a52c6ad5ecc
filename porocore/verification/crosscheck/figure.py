"""Figure of a crosscheck: histories of all macro solvers, differences of every pair."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.figure import Figure

from porocore.report.figures.style import DASHED, DOTTED, GREY, TIME_COLOURS, legend_above, new_figure, styled
from porocore.verification.crosscheck.bodies import BodyRun, history_difference
from porocore.verification.crosscheck.comparison import BODY

PANELS = {
    "settlement": r"settlement max$(-u_2)$ [–]",
    "pressure_max": "largest pore pressure $p\\,/E$ [–]",
    "drained": "drained volume [–]",
}
#: What is smaller is drawn here: a difference of zero has no place on a logarithmic axis.
LEAST = 1e-17


@styled
def difference_figure(runs: Sequence[BodyRun]) -> Figure:
    """One law; three histories side by side.

    Parameters
    ----------
    runs
        Of one law, at least one with a solution.

    Returns
    -------
    Figure
        Above, the histories of every macro solver; below, the relative difference of every pair with the
        same time steps, logarithmic, with the tolerance.
    """
    solved = [(run.backend, run.solution.history) for run in runs if run.solution is not None]
    pairs = list(combinations(range(len(solved)), 2))
    figure = new_figure(11.5, 5.6 if pairs else 3.4)
    rows = 2 if pairs else 1
    ratios = (1.25, 1)[:rows]
    panels = figure.subplots(rows, 3, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})
    for column, (name, label) in enumerate(PANELS.items()):
        axes = panels[0, column]
        for i, (backend, history) in enumerate(solved):
            # The first pale and wide, so that those that coincide with it are seen on it.
            look = {"lw": 5.0, "alpha": 0.35} if i == 0 else {"lw": 1.7, "ls": "-" if i == 1 else DASHED}
            axes.plot(history.time, getattr(history, name), color=TIME_COLOURS[i % 6], label=backend, **look)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.margins(x=0.01)
    for column, name in enumerate(PANELS if pairs else ()):
        axes = panels[1, column]
        for k, (i, j) in enumerate(pairs):
            (one, a), (other, b) = solved[i], solved[j]
            if len(a.time) != len(b.time):
                continue
            difference = history_difference(getattr(a, name), getattr(b, name))[1:]
            axes.plot(
                a.time[1:],
                np.maximum(difference, LEAST),
                color=TIME_COLOURS[(k + 2) % 6],
                marker="o",
                ms=(4.4, 3.0, 1.8)[k % 3],
                lw=(2.6, 1.6, 1.0)[k % 3],
                ls=("-", DASHED, DOTTED)[k % 3],
                label=f"{one} – {other}",
            )
        axes.axhline(BODY, color=GREY, ls=DASHED, lw=1.2, label="tolerance")
        axes.set_yscale("log")
    panels[-1, 1].set_xlabel("time $t$ [–]")
    if pairs:
        limits = [axes.get_ylim() for axes in panels[1]]
        for axes in panels[1]:
            axes.set_ylim(min(low for low, _ in limits), max(10 * BODY, *(high for _, high in limits)))
        panels[1, 0].set_ylabel("relative difference [–]")
        panels[1, 2].legend(loc="best")
    figure.align_ylabels()
    legend_above(figure, panels[0, 0], columns=6)
    return figure
