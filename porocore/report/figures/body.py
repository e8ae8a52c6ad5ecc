"""Figures of the deformed body and of its cells: pressure, parameters, regions, material axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from porocore.core.units import units_now
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.body.kinds import Section, most_telling, sections
from porocore.macro.body.mesh import boundary_facets
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.report.figures import style
from porocore.report.figures.curves import ColumnAxis, is_column, pressure_label
from porocore.report.figures.indenters import POINTS, across, drawn_indenters, front_of, section_of
from porocore.report.figures.style import axis_label, legend_above, lighter, named, new_figure, styled
from porocore.report.words.parameters import BodyCells
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.report.page import Picture, Pictures


#: Corners of a facet in its own coordinates.
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
TRIANGLE = SQUARE[:2] + SQUARE[3:]


def pieces(nodes: int, parts: int) -> tuple[Array, IntArray, IntArray]:
    """Return how a quadratic facet is cut, with ``parts`` pieces along each edge.

    Parameters
    ----------
    nodes
        9 of a quadrilateral or 6 of a triangle: corners, middles of the edges, and the middle.
    parts
        2 or more.

    Returns
    -------
    values : (k, nodes)
        Shape functions at the corners of the pieces.
    polygons : (m, 4 or 3)
        Corners of each piece.
    outline : (n,)
        Corners around the facet, closed.
    """
    i, j = (grid.ravel() for grid in np.indices((parts + 1, parts + 1)))
    if nodes == 9:
        return _square_values(i / parts, j / parts), _squares(parts), _around(parts, SQUARE)
    inside = i + j <= parts
    number = np.cumsum(inside) - 1
    values = _triangle_values(i[inside] / parts, j[inside] / parts)
    return values, number[_triangles(parts)], number[_around(parts, TRIANGLE)]


def towards(height: float, azimuth: float) -> Array:
    """Return the direction towards a viewer at this height and azimuth in degrees."""
    height, azimuth = np.radians((height, azimuth))
    return np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])


def front(facets: Array, view: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Return which facets (k, nodes, 3), seen from height and azimuth in degrees, do not turn their back (k,)."""
    corners = 4 if facets.shape[1] == 9 else 3
    around = facets[:, :corners] - facets[:, :corners].mean(axis=1, keepdims=True)
    normals = np.cross(around, np.roll(around, -1, axis=1)).sum(axis=1)
    return np.asarray(normals @ towards(*view) > 0)


def _square_values(s: Array, t: Array) -> Array:
    a, b = (np.stack([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)]) for x in (s, t))
    order = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (1, 2), (2, 1), (0, 2), (2, 2)]
    return np.stack([a[m] * b[n] for m, n in order], axis=1)


def _triangle_values(s: Array, t: Array) -> Array:
    corners = (1 - s - t, s, t)
    edges = [4 * corners[m] * corners[(m + 1) % 3] for m in range(3)]
    return np.stack([*(c * (2 * c - 1) for c in corners), *edges], axis=1)


def _squares(parts: int) -> IntArray:
    """Return the squares of a grid, by the numbers of its points."""
    i, j = (grid.ravel() for grid in np.indices((parts, parts)))
    first = i * (parts + 1) + j
    return np.stack([first, first + parts + 1, first + parts + 2, first + 1], axis=1)


def _triangles(parts: int) -> IntArray:
    """Return the halves of the squares on one side of the grid's diagonal."""
    squares = _squares(parts)
    i, j = np.divmod(squares[:, 0], parts + 1)
    lower, upper = squares[i + j < parts][:, [0, 1, 3]], squares[i + j < parts - 1][:, [1, 2, 3]]
    return np.concatenate([lower, upper])


def _around(parts: int, corners: tuple[tuple[int, int], ...]) -> IntArray:
    """Return the points of the grid along a closed line from corner to corner."""
    start, end = np.array(corners), np.roll(corners, -1, axis=0)
    steps = np.arange(parts)[:, None]
    line = np.concatenate([parts * a + steps * (b - a) for a, b in zip(start, end, strict=True)])
    return np.append(line, line[:1], axis=0) @ [parts + 1, 1]


COLOURS = "viridis"
#: Of the contact pressure, and the share of the largest one from which a place is drawn as touched.
CONTACT_COLOURS, TOUCHED = "YlOrRd", 0.02
#: Without an indenter.
NONE: Mapping[str, RigidIndenter] = {}
#: From which height and azimuth in degrees the body is seen; y is up, and the corner of least x and z in front.
VIEW = (22, -145)
#: A pressure below this share of the largest in the run is zero, and one that varies by less is uniform.
ROUND_OFF = 1e-9
#: Surfaces of more facets are drawn without the edges of their elements.
MOST_WITH_EDGES = 2000
#: Sizes of the body in its picture, of which the first is taken that leaves room for the labels.
ZOOMS = (1.9, 1.75, 1.6, 1.48, 1.36, 1.26, 1.16, 1.07, 0.98, 0.88, 0.8, 0.72, 0.64, 0.56)
#: Pixels that labels keep from the edge: the label of the axis upwards moves by 4 when the figure is saved.
EDGE = 6
#: Angles in degrees between which a body of revolution is drawn, the opening towards the viewer, and elements around.
REVOLVED, SEGMENTS = (-80.0, 190.0), 18
#: Nodes of flat elements, by their number, in the order in which they are seen from the other side.
FLAT = {9: [0, 3, 2, 1, 7, 6, 5, 4, 8], 6: [0, 2, 1, 5, 4, 3]}
#: The drawn axes, which are z, x and y of the body.
AXES = (("x", "$x_3$"), ("y", "$x_1$"), ("z", "$x_2$"))


@styled
def body_figure(
    solution: MacroSolution, profile: Profile, indenters: Mapping[str, RigidIndenter] = NONE
) -> Figure:
    """Draw the deformed surface of the body at one time, coloured by p; edges of elements where they are few.

    A body of revolution lacks the quarter towards the viewer, so that its meridian is seen; one in plane strain is
    drawn in its plane. Where an indenter touches the body the colour is that of the contact pressure.

    Parameters
    ----------
    solution
        With the mesh.
    profile
        One of its profiles.
    indenters
        Rigid indenters by name; their front is drawn at the place at that time.
    """
    if solution.cells.shape[1] in FLAT and not solution.revolved:
        return plane_figure(solution, profile, indenters)
    places = (solution.points + profile.u) * units_now().factor("displacement")
    colours, pressure, ticks = _colours(solution, profile)
    touched, contact = _contact_colours(profile)
    facets = _facets(solution, places, pressure, contact)
    fronts = _fronts(solution, profile, indenters)
    figure = new_figure(5.4, 4.6 if touched is not None else 4.2)
    figure.set_layout_engine("none")  # it takes no account of what is drawn in space
    low = 0.2 if touched is not None else 0.02
    axes: Any = figure.add_axes(
        (0.0, low, 0.83, 0.93 - low), projection="3d", proj_type="ortho", computed_zorder=False
    )
    drawn = [at.reshape(-1, 3) for at, *_ in facets] + [each.reshape(-1, 3) for each in fronts]
    lengths = _frame(axes, np.concatenate(drawn))
    beside = figure.add_axes((0.85, low + 0.12, 0.022, 0.7 - low), label="<colorbar>")
    label = axis_label(pressure_label(solution), "pressure")
    bar = figure.colorbar(colours, cax=beside, label=label, ticks=ticks)
    if touched is not None:
        below = figure.add_axes((0.16, 0.14, 0.5, 0.022), label="<contact>")
        figure.colorbar(
            touched, cax=below, orientation="horizontal", label=axis_label("contact pressure", "pressure")
        )
    axes.set_title(f"$t$ = {units_now().text(profile.time, 'time', 6)}")
    _fit(figure, axes, lengths, bar.ax)
    _surface(axes, facets, colours, touched)
    for each in fronts:
        _front_surface(axes, each)
    return figure


def _colours(solution: MacroSolution, profile: Profile) -> tuple[ScalarMappable, Array, list[float] | None]:
    """Return the colours of the pore pressure, p (nodes,) in units, and its tick where it is uniform."""
    pressure, uniform = _pressure(solution, profile)
    pressure = pressure * units_now().factor("pressure")
    low, high = float(pressure.min()), float(pressure.max())
    if uniform:
        around = abs(low) if low else 1.0
        low, high = low - 0.5 * around, low + 0.5 * around
    return ScalarMappable(Normalize(low, high), COLOURS), pressure, [float(pressure[0])] if uniform else None


def _contact_colours(profile: Profile) -> tuple[ScalarMappable | None, Array]:
    """Return the colours of the contact pressure, None without contact, and its values (nodes,)."""
    contact = profile.contact_pressure * units_now().factor("pressure")
    if not contact.any():
        return None, contact
    return ScalarMappable(Normalize(0.0, float(contact.max())), CONTACT_COLOURS), contact


def _contact_bar(figure: Figure, axes: Any, colours: ScalarMappable) -> None:
    figure.colorbar(
        colours,
        ax=axes,
        location="bottom",
        shrink=0.7,
        aspect=30,
        pad=0.02,
        label=axis_label("contact pressure", "pressure"),
    )


@styled
def plane_figure(
    solution: MacroSolution, profile: Profile, indenters: Mapping[str, RigidIndenter] = NONE
) -> Figure:
    """Draw a body in two dimensions in its plane, coloured by p, with the contact pressure along its surface.

    The parameters are those of :func:`body_figure`.
    """
    length = units_now().factor("displacement")
    places = (solution.points + profile.u)[:, :2] * length
    colours, pressure, ticks = _colours(solution, profile)
    touched, contact = _contact_colours(profile)
    size = float(np.ptp(solution.points, axis=0).max())
    sections = [
        section_of(each, motion, size, revolved=solution.revolved) * length
        for each, motion in drawn_indenters(solution, profile, indenters)
    ]
    extent = np.ptp(np.concatenate([places, *sections]), axis=0)
    high = float(np.clip(4.2 * extent[1] / extent[0], 1.6, 4.6))
    figure = new_figure(5.8, high + (1.7 if touched is not None else 1.0))
    axes = figure.add_subplot()
    at, values = places[solution.cells], pressure[solution.cells]
    few = len(at) < MOST_WITH_EDGES
    shapes, polygons, outline = pieces(at.shape[1], 4 if few else 2)
    corners = np.einsum("ka,fai->fki", shapes, at)
    shades = colours.to_rgba((values @ shapes.T)[:, polygons].mean(axis=2).ravel())
    drawn = corners[:, polygons].reshape(-1, polygons.shape[1], 2)
    axes.add_collection(
        PolyCollection(drawn, facecolors=shades, edgecolors=shades, linewidths=0.3, rasterized=True)
    )
    if few:
        axes.add_collection(LineCollection(corners[:, outline], colors=(0, 0, 0, 0.35), linewidths=0.4))
    for each in sections:
        axes.fill(*each.T, fc="0.86", ec="0.35", lw=1.0, zorder=2)
    axes.set_aspect("equal")
    axes.autoscale_view()
    if touched is not None:
        axes.add_collection(_touched_line(solution, places, contact, touched))
        _contact_bar(figure, axes, touched)
    axes.grid(visible=False)
    axes.set_xlabel(length_label("radius $x_1$" if solution.revolved else "$x_1$"))
    axes.set_ylabel(length_label("$x_2$"))
    axes.set_title(f"$t$ = {units_now().text(profile.time, 'time', 6)}")
    label = axis_label(pressure_label(solution), "pressure")
    figure.colorbar(colours, ax=axes, shrink=0.8, label=label, ticks=ticks)
    return figure


def _touched_line(
    solution: MacroSolution, places: Array, contact: Array, colours: ScalarMappable
) -> LineCollection:
    """Return the parts of the edge that are touched, coloured by the contact pressure."""
    edges = boundary_facets(solution.cells)
    if solution.revolved:  # without the axis
        edges = edges[places[edges, 0].max(axis=1) > 1e-9 * places[:, 0].max()]
    t = np.linspace(0, 1, 9)
    values = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    line, pressure = (np.einsum("ka,fa...->fk...", values, each[edges]) for each in (places, contact))
    middle = (pressure[:, 1:] + pressure[:, :-1]) / 2
    shown = middle > TOUCHED * contact.max()
    segments = np.stack([line[:, :-1], line[:, 1:]], axis=2)[shown]
    return LineCollection(
        list(segments), colors=colours.to_rgba(middle[shown]), linewidths=4.0, capstyle="round", zorder=3
    )


def _fronts(solution: MacroSolution, profile: Profile, indenters: Mapping[str, RigidIndenter]) -> list[Array]:
    """Return the fronts of the indenters as drawn, lines (n, points, 3) side by side."""
    size, found = float(np.ptp(solution.points, axis=0).max()), []
    for each, motion in drawn_indenters(solution, profile, indenters):
        if solution.revolved:
            (line,) = front_of(each, motion, np.array([[1.0, 0.0, 0.0]]), size)
            angles = np.radians(np.linspace(*REVOLVED, 2 * SEGMENTS + 1))
            lines = _turned(np.broadcast_to(line, (len(angles), *line.shape)), angles[:, None])
        else:
            lines = front_of(each, motion, across(each, np.linspace(0, 2 * np.pi, 49)), size)[..., [2, 0, 1]]
            lines = _beside(lines, solution)
        found.append(lines * units_now().factor("displacement"))
    return found


def _beside(lines: Array, solution: MacroSolution) -> Array:
    """Return lines as drawn with what lies beyond the sides of the body moved to them: a part of a symmetric body."""
    low, high = solution.points.min(axis=0), solution.points.max(axis=0)
    for drawn, own in ((0, 2), (1, 0)):
        lines[..., drawn] = np.clip(lines[..., drawn], low[own], high[own])
    return lines


def _front_surface(axes: Any, lines: Array) -> None:
    """Draw the front of an indenter, translucent, with a few of its lines."""
    corners = np.stack([lines[:-1, :-1], lines[1:, :-1], lines[1:, 1:], lines[:-1, 1:]], axis=2)
    quads = corners.reshape(-1, 4, 3)
    first, second = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    normal = np.cross(first, second)
    size = np.linalg.norm(normal, axis=1)
    shown = size > 1e-9 * size.max()
    light = np.abs(normal[shown] @ towards(*VIEW)) / size[shown]
    shades = np.column_stack([*(3 * [0.5 + 0.4 * light]), np.full(len(light), 0.45)])
    axes.add_collection3d(
        Poly3DCollection(quads[shown], facecolors=shades, edgecolors="none", rasterized=True, zorder=3)
    )
    rims = [lines[0], lines[-1], lines[:, -1], lines[:, POINTS // 2]]
    axes.add_collection3d(Line3DCollection(rims, colors=(0, 0, 0, 0.55), linewidths=0.7, zorder=4))


def _facets(
    solution: MacroSolution, places: Array, pressure: Array, contact: Array
) -> list[tuple[Array, Array, Array]]:
    """Return facets as drawn (k, nodes, 3), with p and contact pressure there (k, nodes), by the number of nodes."""
    cells, facets = solution.cells, boundary_facets(solution.cells)
    if not solution.revolved:
        return [(places[facets][..., [2, 0, 1]], pressure[facets], contact[facets])]
    first, last = REVOLVED
    angles = np.radians(np.linspace(first, last, 2 * SEGMENTS + 1))
    #: Node of the edge and step of the angle of each of the nine nodes of a facet.
    edge, step = np.array([(0, 0), (1, 0), (1, 2), (0, 2), (2, 0), (1, 1), (2, 2), (0, 1), (2, 1)]).T
    turns = angles[2 * np.arange(SEGMENTS)[:, None] + step]
    around = places[facets[:, edge]][:, None]
    found = [
        (
            _turned(np.broadcast_to(around, (len(facets), *turns.shape, 3)), turns).reshape(-1, 9, 3),
            np.repeat(pressure[facets[:, edge]], SEGMENTS, axis=0),
            np.repeat(contact[facets[:, edge]], SEGMENTS, axis=0),
        )
    ]
    for angle, order in ((angles[-1], slice(None)), (angles[0], FLAT[cells.shape[1]])):
        shown = cells[:, order]
        cut = np.zeros(shown.shape)
        found.append((_turned(places[shown], np.full(shown.shape, angle)), pressure[shown], cut))
    return found


def _turned(places: Array, angles: Array) -> Array:
    """Return places (..., 3) of a meridian turned about the y axis by angles (...), as drawn."""
    r, y = places[..., 0], places[..., 1]
    return np.stack([r * np.sin(angles), r * np.cos(angles), y], axis=-1)


def _fit(figure: Figure, axes: Any, lengths: Array, bar: Any) -> None:
    """Draw the body as large as its axes and their labels have room between title and colour bars."""
    figure.draw_without_rendering()
    over = bar.get_tightbbox().x1 - (figure.bbox.x1 - EDGE)
    if over > 0:
        place = bar.get_position()
        bar.set_position((place.x0 - over / figure.bbox.width, place.y0, place.width, place.height))
    others: list[Any] = [each for each in figure.axes if each not in (axes, bar)]
    bottom = max((each.get_tightbbox().y1 for each in others), default=0.0) + EDGE
    top, right = axes.title.get_window_extent().y0, bar.get_tightbbox().x0 - EDGE
    for zoom in ZOOMS:
        axes.set_box_aspect(lengths, zoom=zoom)
        figure.draw_without_rendering()
        needed, ends = axes.get_tightbbox(), _corners(axes)
        low, high = np.minimum(ends.min(axis=0), needed.p0), np.maximum(ends.max(axis=0), (needed.x1, 0))
        if low[0] >= EDGE and low[1] >= bottom and high[0] <= right and high[1] <= top:
            break


def _corners(axes: Any) -> Array:
    """Return the corners (8, 2) of the box in pixels."""
    ends = [getattr(axes, f"get_{name}lim")() for name in "xyz"]
    grid = np.stack([each.ravel() for each in np.meshgrid(*ends)])
    x, y, _ = proj_transform(*grid, axes.get_proj())
    return np.asarray(axes.transData.transform(np.column_stack([x, y])))


def _pressure(solution: MacroSolution, profile: Profile) -> tuple[Array, bool]:
    """Return p without round-off, and whether it is the same everywhere; what is zero up to round-off is zero."""
    largest = max(float(np.abs(each.p).max()) for each in (*solution.profiles, profile))
    slack = ROUND_OFF * max(largest, float(solution.history.pressure_max.max()), float(np.finfo(float).eps))
    if np.ptp(profile.p) > slack:
        return profile.p, False
    mean = float(profile.p.mean())
    return np.full_like(profile.p, 0.0 if abs(mean) <= slack else mean), True


def _surface(
    axes: Any,
    facets: Sequence[tuple[Array, Array, Array]],
    colours: ScalarMappable,
    touched: ScalarMappable | None,
) -> None:
    """Draw the facets that face the viewer, and the edges of the elements where they are few."""
    facing = [front(places, VIEW) for places, *_ in facets]
    largest = max(float(contact.max()) for *_, contact in facets)
    few = sum(int(each.sum()) for each in facing) < MOST_WITH_EDGES
    drawn: list[Array] = []
    lines: list[Array] = []
    found: list[Array] = []
    for (places, pressure, contact), shown in zip(facets, facing, strict=True):
        shapes, polygons, outline = pieces(places.shape[1], 4 if few else 2)
        corners = np.einsum("ka,fai->fki", shapes, places[shown])
        drawn += [*corners[:, polygons].reshape(-1, polygons.shape[1], 3)]
        own, pushed = (
            (each[shown] @ shapes.T)[:, polygons].mean(axis=2).ravel() for each in (pressure, contact)
        )
        colour = np.asarray(colours.to_rgba(own))
        if touched is not None:
            inside = pushed > TOUCHED * largest
            colour[inside] = touched.to_rgba(pushed[inside])
        found.append(colour)
        lines += [*corners[:, outline]]
    shades = np.concatenate(found)
    axes.add_collection3d(
        Poly3DCollection(
            drawn,
            facecolors=shades,
            edgecolors=shades,  # no seams between the pieces
            linewidths=0.3,
            rasterized=True,
            zorder=1,
        )
    )
    if few:
        axes.add_collection3d(Line3DCollection(lines, colors=(0, 0, 0, 0.35), linewidths=0.4, zorder=2))


def length_label(name: str) -> str:
    """Return the label of a coordinate, with the unit of lengths where there is one."""
    return axis_label(name, "displacement") if units_now().given else name


def _frame(axes: Any, places: Array) -> Array:
    """Set the limits to the body, and ticks that keep clear of each other; return the lengths of the box."""
    first, last = places.min(axis=0), places.max(axis=0)
    lengths = np.maximum(last - first, 0.12 * (last - first).max())
    axes.view_init(*VIEW)
    axes.grid(visible=False)
    axes.tick_params(labelsize=7, pad=0)
    for (name, label), low, high, length in zip(AXES, first, last, lengths, strict=True):
        axis = getattr(axes, f"{name}axis")
        getattr(axes, f"set_{name}lim")(low, high)
        axis.set_label_text(length_label(label))
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


FIELD_COLOURS = "viridis"
#: Colours of regions: the rest of the body first.
REGIONS = [
    "#e8e8e8",
    *(
        lighter(colour, 0.35)
        for colour in (style.SKY, style.ORANGE, style.GREEN, style.PURPLE, style.VERMILLION, style.BLUE)
    ),
]
#: Colours of the three material axes.
MATERIAL_AXES = (style.BLUE, style.VERMILLION, style.GREEN)
#: Lines of an axis along the longer side of a section, and their length as a share of their distance.
LINES, LENGTH = 14, 0.8
#: A field that varies by less than this share of its size is uniform, and is not drawn.
UNIFORM = 1e-9
#: Longest and shortest side of a section on the page [inches].
LONGEST, SHORTEST = 4.2, 1.1
#: Greatest width of one of two sections beside each other [inches].
BESIDE = 2.4


@styled
def field_along_column(
    line: ColumnAxis,
    values: Sequence[tuple[float, Array]],
    label: str,
    cells: ElementCells,
) -> Figure:
    """Draw a field along a column at some times, element by element, over bands of the regions.

    ``values`` are times and values (elements,), one pair where the field does not change; ``label`` has the unit.
    """
    figure = new_figure(5.4, 3.4)
    axes = figure.add_subplot()
    length = units_now().factor("displacement")
    edges = np.append(line.ends[:, 0], line.ends[-1, 1]) * length
    _bands(axes, line, cells, length)
    for (time, field), colour in zip(values, style.TIME_COLOURS, strict=False):
        said = f"$t$ = {units_now().text(time, 'time', 6)}" if len(values) > 1 else None
        axes.stairs(field[line.elements], edges, baseline=None, color=colour, lw=1.8, label=said)
    axes.set_xlabel(axis_label("position along the column $X_2$", "displacement"))
    axes.set_ylabel(label)
    axes.set_xlim(edges[0], edges[-1])
    axes.margins(y=0.08)
    if axes.get_legend_handles_labels()[1]:
        legend_above(figure, axes, columns=3)
    return figure


def _bands(axes: Any, line: ColumnAxis, cells: ElementCells, length: float) -> None:
    """Colour the regions along a column."""
    region, told = cells.region[line.elements], set[int]()
    for number, (low, high) in zip(region.tolist(), line.ends * length, strict=True):
        if number:
            label = None if number in told else cells.regions[number - 1]
            axes.axvspan(low, high, color=_colour(number), lw=0, zorder=0, label=label)
            told.add(number)


@styled
def field_in_section(among: Sequence[Section], values: Sequence[tuple[float, Array]], label: str) -> Figure:
    """Draw a field in the middle section in which it varies most, at some times side by side.

    ``values`` and ``label`` are as in :func:`field_along_column`.
    """
    section = most_telling(among, np.stack([field for _, field in values], axis=1))
    figure, panels = _panels(section, len(values))
    inside = section.element[section.element >= 0]
    shown = np.concatenate([field[inside] for _, field in values])
    norm = Normalize(float(np.nanmin(shown)), float(np.nanmax(shown)))
    for axes, (time, field) in zip(panels, values, strict=True):
        _image(axes, section, section.image(field), norm=norm, cmap=FIELD_COLOURS)
        if len(values) > 1:
            axes.set_title(f"$t$ = {units_now().text(time, 'time', 6)}")
    figure.colorbar(ScalarMappable(norm, FIELD_COLOURS), ax=list(panels), label=label, shrink=0.8)
    _labels(panels, section)
    return figure


@styled
def regions_in_section(among: Sequence[Section], cells: ElementCells) -> Figure:
    """Draw the regions in the middle section in which most of them are, with their names."""
    present = [np.unique(cells.region[each.element[each.element >= 0]]) for each in among]
    best = max(range(len(among)), key=lambda i: (len(present[i]), -i))
    section = among[best]
    figure, (axes,) = _panels(section, 1)
    count = len(cells.regions) + 1
    colours = ListedColormap([_colour(number) for number in range(count)])
    _image(axes, section, section.image(cells.region), norm=Normalize(-0.5, count - 0.5), cmap=colours)
    names = ["elsewhere", *map(named, cells.regions)]
    figure.legend(
        handles=[Patch(fc=_colour(k), ec=style.GREY, lw=0.6, label=names[k]) for k in present[best]],
        loc="outside upper left",
        ncols=4,
        handlelength=1.2,
        columnspacing=1.3,
    )
    _labels([axes], section)
    return figure


@styled
def axes_in_section(among: Sequence[Section], axes_of: Array, cells: ElementCells) -> Figure:
    """Draw the material axes (elements, 3, 3) as lines in the middle section in which they vary most, over the regions.

    A line is the projection of an axis onto the section: one across it is a dot.
    """
    section = most_telling(among, lambda each: axes_of[:, list(each.sides)])
    figure, (axes,) = _panels(section, 1)
    count = len(cells.regions) + 1
    colours = ListedColormap([lighter(_colour(number), 0.5) for number in range(count)])
    _image(axes, section, section.image(cells.region), norm=Normalize(-0.5, count - 0.5), cmap=colours)
    right, up = section.places()
    step = max(1, round(max(len(right), len(up)) / LINES))
    rows, columns = (
        found.ravel()
        for found in np.meshgrid(
            np.arange(step // 2, len(up), step), np.arange(step // 2, len(right), step), indexing="ij"
        )
    )
    element = section.element[rows, columns]
    rows, columns, element = (each[element >= 0] for each in (rows, columns, element))
    length = units_now().factor("displacement")
    distance = step * max(np.ptp(right) / max(len(right) - 1, 1), np.ptp(up) / max(len(up) - 1, 1)) * length
    places = np.stack([right[columns], up[rows]], axis=1) * length
    for k, colour in enumerate(MATERIAL_AXES):
        along = axes_of[element][:, list(section.sides), k]
        ends = places[:, None, :] + LENGTH * distance / 2 * along[:, None, :] * np.array([-1, 1])[:, None]
        for first, last in ends:
            axes.plot(*np.stack([first, last]).T, color=colour, lw=1.4, solid_capstyle="round")
        axes.plot(*places[np.linalg.norm(along, axis=1) < 0.15].T, "o", ms=2.2, color=colour, mew=0)
        axes.plot([], [], color=colour, lw=1.6, label=f"axis {k + 1}")
    legend_above(figure, axes, columns=3)
    _labels([axes], section)
    return figure


@styled
def axes_along_column(line: ColumnAxis, axes_of: Array, cells: ElementCells) -> Figure:
    """Draw the components of the first two of the material axes (elements, 3, 3) along a column."""
    figure = new_figure(5.4, 4.4)
    panels = figure.subplots(2, 1, sharex=True)
    length = units_now().factor("displacement")
    edges = np.append(line.ends[:, 0], line.ends[-1, 1]) * length
    for k, panel in enumerate(panels):
        _bands(panel, line, cells, length)
        for i, colour in enumerate(MATERIAL_AXES):
            panel.stairs(
                axes_of[line.elements, i, k],
                edges,
                baseline=None,
                color=colour,
                lw=1.8,
                label=f"along $X_{i + 1}$",
            )
        panel.set_ylabel(f"material axis {k + 1} [–]")
        panel.set_ylim(-1.1, 1.1)
        panel.set_xlim(edges[0], edges[-1])
    panels[-1].set_xlabel(axis_label("position along the column $X_2$", "displacement"))
    legend_above(figure, panels[0], columns=3)
    return figure


def _panels(section: Section, count: int) -> tuple[Figure, Sequence[Any]]:
    """Return a figure with panels that have the shape of the section, and these."""
    lengths = section.ends[:, 1] - section.ends[:, 0]
    width, height = np.clip(LONGEST * lengths / lengths.max(), SHORTEST, LONGEST)
    if count > 1 and width > BESIDE:
        width, height = BESIDE, max(BESIDE / width * height, SHORTEST)
    figure = new_figure(min(count * (width + 0.5) + 1.7, 7.2), height + 1.1)
    panels = figure.subplots(1, count, squeeze=False)[0]
    for axes in panels:
        axes.set_aspect("equal")
        axes.grid(visible=False)
    return figure, panels


def _image(axes: Any, section: Section, image: Array, **how: Any) -> None:
    length = units_now().factor("displacement")
    (left, right), (bottom, top) = section.ends * length
    axes.imshow(
        image,
        origin="lower",
        extent=(left, right, bottom, top),
        interpolation="nearest",
        aspect="equal",
        **how,
    )
    axes.autoscale(enable=False)


def _labels(panels: Sequence[Any], section: Section) -> None:
    """Name the sides of a section, and where it is."""
    names = [f"$X_{axis + 1}$" for axis in section.sides]
    texts = list(map(length_label, names))
    for axes in panels:
        axes.set_xlabel(texts[0])
    panels[0].set_ylabel(texts[1])
    at = units_now().text(section.at, "displacement", 3)
    panels[0].annotate(
        f"$X_{section.across + 1}$ = {at}", (0.0, 0.0), (0, -34), "axes fraction", "offset points",
        fontsize=8, color=style.BLACK, va="top",
    )  # fmt: skip


def _uniform(values: Array) -> bool:
    """Return whether values that are known are the same up to round-off."""
    known = values[np.isfinite(values)]
    return not len(known) or float(np.ptp(known)) <= UNIFORM * float(np.abs(known).max())


def _colour(number: int) -> Any:
    """Return the colour of a region by its number; 0 is the rest of the body."""
    return REGIONS[0] if number == 0 else REGIONS[1 + (number - 1) % (len(REGIONS) - 1)]


def body_fields(solution: MacroSolution, body: BodyCells, pictures: Pictures) -> list[Picture]:
    """Return the pictures of a body of many cells: regions, parameters, porosity and K at rest, material axes."""
    cells = body.cells
    column = is_column(solution)
    line = ColumnAxis.from_solution(solution) if column else None
    among = () if column else sections(solution.points, solution.cells)
    where = "along the column" if column else "in a middle section"

    def field(name: str, values: Sequence[tuple[float, Array]], label: str) -> Picture:
        text = f"{name} {where}"
        if line is not None:
            return pictures.svg(f"body_{name}", field_along_column(line, values, label, cells), text)
        return pictures.png(f"body_{name}", field_in_section(among, values, label), text)

    found: list[Picture] = []
    if cells.regions and line is None:
        drawn = regions_in_section(among, cells)
        found.append(pictures.png("body_regions", drawn, f"Regions of the body {where}"))
    shown = [
        (name, body.field(name), named(name), body.quantities.get(name, "")) for name in cells.parameters
    ]
    if body.porosity is not None:
        shown.append(("porosity", [(0.0, body.porosity)], r"porosity at rest $\varphi_f$", ""))
    K = body.conductivity[:, 1, 1]
    shown.append(("conductivity", [(0.0, K)], "conductivity at rest $K_{22}$", "conductivity"))
    found += [
        field(
            name,
            [(time, at * units_now().factor(quantity)) for time, at in values],
            axis_label(label, quantity),
        )
        for name, values, label, quantity in shown
        if not _uniform(np.concatenate([at for _, at in values]))
    ]
    last = cells.axes_at(body.shown[-1])
    if last is not None:
        drawn = (
            axes_along_column(line, last, cells) if line is not None else axes_in_section(among, last, cells)
        )
        found.append(pictures.png("body_axes", drawn, f"Material axes {where}"))
    return found
