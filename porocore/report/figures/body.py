"""Figure of the deformed body, coloured by its pore pressure."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.body.mesh import boundary_facets
from porocore.report.figures.facets import front, pieces
from porocore.report.figures.style import axis_label, new_figure, styled
from porocore.states import Array

COLOURS = "viridis"
#: From which height and azimuth in degrees the body is seen; y is up, and the corner of least x and z in front.
VIEW = (22, -145)
#: A pressure below this share of the largest in the run is zero, and one that varies by less is uniform.
ROUND_OFF = 1e-9
#: Surfaces of more facets are drawn without the edges of their elements.
MOST_WITH_EDGES = 2000
#: Sizes of the body in its picture, of which the first is taken that leaves room for the labels.
ZOOMS = (0.98, 0.88, 0.8, 0.72, 0.64, 0.56)
#: Pixels that labels keep from the edge: the label of the axis upwards moves by 4 when the figure is saved.
EDGE = 6
#: The drawn axes, which are z, x and y of the body.
AXES = (("x", "$x_3$"), ("y", "$x_1$"), ("z", "$x_2$"))


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
    places = (solution.points + profile.u)[:, [2, 0, 1]] * units.factor("displacement")
    pressure, uniform = _pressure(solution, profile)
    pressure = pressure * units.factor("pressure")
    low, high = float(pressure.min()), float(pressure.max())
    if uniform:
        around = abs(low) if low else 1.0
        low, high = low - 0.5 * around, low + 0.5 * around
    colours = ScalarMappable(Normalize(low, high), COLOURS)
    figure = new_figure(5.4, 4.4)
    axes: Any = figure.add_subplot(projection="3d", proj_type="ortho", computed_zorder=False)
    lengths = _frame(axes, places, units)
    bar = figure.colorbar(
        colours,
        ax=axes,
        shrink=0.7,
        pad=0.13,
        label=axis_label("pore pressure $p$", "pressure", units),
        ticks=[float(pressure[0])] if uniform else None,
    )
    axes.set_title(f"$t$ = {units.text(profile.time, 'time', 6)}")
    _fit(figure, axes, lengths, bar.ax)
    _surface(axes, solution, places, pressure, colours)
    return figure


def _fit(figure: Figure, axes: Any, lengths: Array, bar: Any) -> None:
    """Draw the body as large as its axes and their labels have room; the layout takes no account of these.

    The layout ends with that: when the figure is saved, it would move the axes again, labels beyond the edge.
    """
    for zoom in ZOOMS:
        axes.set_box_aspect(lengths, zoom=zoom)
        figure.draw_without_rendering()
        needed, right = axes.get_tightbbox(), bar.get_tightbbox().x0
        if min(needed.x0, needed.y0) >= EDGE and needed.x1 <= right and needed.y1 <= figure.bbox.y1:
            break
    figure.set_layout_engine("none")


def _pressure(solution: MacroSolution, profile: Profile) -> tuple[Array, bool]:
    """Return p without round-off, and whether it is the same everywhere; what is zero up to round-off is zero."""
    largest = max(float(np.abs(each.p).max()) for each in (*solution.profiles, profile))
    slack = ROUND_OFF * max(largest, float(solution.history.pressure_max.max()), float(np.finfo(float).eps))
    if np.ptp(profile.p) > slack:
        return profile.p, False
    mean = float(profile.p.mean())
    return np.full_like(profile.p, 0.0 if abs(mean) <= slack else mean), True


def _surface(
    axes: Any, solution: MacroSolution, places: Array, pressure: Array, colours: ScalarMappable
) -> None:
    """Draw the facets that face the viewer, and the edges of the elements where they are few."""
    facets = boundary_facets(solution.cells)
    facets = facets[front(places[facets], np.radians(VIEW))]
    few = len(facets) < MOST_WITH_EDGES
    values, polygons, outline = pieces(facets.shape[1], 4 if few else 2)
    corners = np.einsum("ka,fai->fki", values, places[facets])
    shades = colours.to_rgba((pressure[facets] @ values.T)[:, polygons].mean(axis=2).ravel())
    axes.add_collection3d(
        Poly3DCollection(
            corners[:, polygons].reshape(-1, polygons.shape[1], 3),
            facecolors=shades,
            edgecolors=shades,  # no seams between the pieces
            linewidths=0.3,
            rasterized=True,
            zorder=1,
        )
    )
    if few:
        axes.add_collection3d(
            Line3DCollection(corners[:, outline], colors=(0, 0, 0, 0.35), linewidths=0.4, zorder=2)
        )


def _frame(axes: Any, places: Array, units: ResultUnits) -> Array:
    """Set the limits to the body, and ticks that keep clear of each other; return the lengths of the box."""
    first, last = places.min(axis=0), places.max(axis=0)
    lengths = np.maximum(last - first, 0.12 * (last - first).max())
    axes.view_init(*VIEW)
    axes.grid(visible=False)
    axes.tick_params(labelsize=7, pad=0)
    for (name, label), low, high, length in zip(AXES, first, last, lengths, strict=True):
        axis = getattr(axes, f"{name}axis")
        getattr(axes, f"set_{name}lim")(low, high)
        axis.set_label_text(axis_label(label, "displacement", units) if units.given else label)
        axis.pane.set_visible(False)
        # The ends of the two lower axes meet in front: only one of them has its number there.
        axis.set_ticks(_ticks(low, high, float(length / lengths.max()), open_end=name == "x"))
    # Labels stand in the middle of their places, and long ones would reach into the body.
    longest = max((len(f"{tick:g}") for tick in axes.get_zticks()), default=1)
    axes.tick_params("z", pad=1 + 3 * longest)
    axes.zaxis.labelpad = 5 * longest - 2
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90)
    return np.asarray(lengths)


def _ticks(low: float, high: float, share: float, *, open_end: bool) -> list[float]:
    """Return ticks of an axis with a ``share`` of the largest length; none at its low end if that is open."""
    slack = 1e-6 * (high - low)
    round_numbers = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    found = [float(t) for t in round_numbers if low - slack <= t <= high + slack]
    if open_end:
        found = [t for t in found if t > low + 0.12 * (high - low)]
    return found if share > 0.4 else found[-1:]
