"""The deformed body, coloured by its pore pressure."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.body.mesh import boundary_facets
from porocore.report.figures.style import axis_label, new_figure, styled
from porocore.states import Array, IntArray

COLOURS = "viridis"
#: From which azimuth and height the body is seen; y is up.
VIEW = (22, -145)


@styled
def body_figure(solution: MacroSolution, profile: Profile, units: ResultUnits | None = None) -> Figure:
    """Draw the deformed surface of the body at one time, coloured by p; edges of elements where they are few.

    Parameters
    ----------
    solution
        With the mesh.
    profile
        One of its profiles.
    units
        Of lengths, time and pressure.
    """
    units = units or ResultUnits()
    facets = boundary_facets(solution.cells)
    places = (solution.points + profile.u)[:, [2, 0, 1]] * units.factor("displacement")
    pressure = profile.p * units.factor("pressure")
    low, high = float(pressure.min()), float(pressure.max())
    if high - low < 1e-12:
        low, high = low - 0.5e-12, high + 0.5e-12
    norm = Normalize(low, high)
    colours = ScalarMappable(norm, COLOURS)
    figure = new_figure(5.4, 4.4)
    axes = figure.add_subplot(projection="3d")
    polygons, values = _fine(facets, places, pressure)
    lines = (
        {"linewidths": 0.15, "edgecolors": (0, 0, 0, 0.35)}
        if len(polygons) < 8000
        else {"edgecolors": "none"}
    )
    surface = Poly3DCollection(polygons, facecolors=colours.to_rgba(values), rasterized=True, **lines)
    axes.add_collection3d(surface)
    first, last = places.min(axis=0), places.max(axis=0)
    for axis, (a, b) in zip("xyz", zip(first, last, strict=True), strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
    axes.set_box_aspect(np.maximum(last - first, 0.12 * (last - first).max()), zoom=0.88)
    for axis, name in zip("xyz", ("$x_3$", "$x_1$", "$x_2$"), strict=True):
        getattr(axes, f"set_{axis}label")(axis_label(name, "displacement", units) if units.given else name)
    axes.tick_params(labelsize=7, pad=0)
    axes.locator_params(nbins=4)
    axes.view_init(*VIEW)
    figure.colorbar(
        colours, ax=axes, shrink=0.7, pad=0.16, label=axis_label("pore pressure $p$", "pressure", units)
    )
    axes.set_title(f"$t$ = {units.text(profile.time, 'time', 6)}")
    return figure


def _fine(facets: IntArray, places: Array, pressure: Array) -> tuple[Array, Array]:
    """Return each facet cut at the middles of its edges, so that the colours have its resolution."""
    if facets.shape[1] == 9:
        parts = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]])
    else:
        parts = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    small = facets[:, parts].reshape(-1, parts.shape[1])
    return places[small], pressure[small].mean(axis=1)
