"""Notes on loads and magnitudes: missing units, pulls, plates on parts, times of a run, cells across the body.

Between two surfaces across an axis whose displacements are prescribed, a component of H has a known mean along every
line that joins them, so it reaches at least this mean somewhere on the line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from pydantic import BaseModel

from porocore.cell.cell import Cell
from porocore.cell.materials.material import SWELLING
from porocore.core.echo import echo
from porocore.core.files.yaml_document import dotted
from porocore.core.formulas import TimeFunction, Value
from porocore.core.models.strict import Place, walk
from porocore.core.units import Dimension, InScales, ResultUnits, length_text
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.composition.fields import TableField
from porocore.macro.composition.regions import sections
from porocore.macro.problem import Boundary, MacroSetup, body_mesh
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig


def left_out(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a line for each section of ``macro`` that leaves out values with a unit; nothing without scales."""
    if not units.given:
        return
    found: dict[str, dict[str, list[str]]] = {}
    for place in walk(MacroSetup, macro):
        dimension = next((extra for extra in place.metadata if isinstance(extra, Dimension)), None)
        value = place.value
        if dimension is None or dimension.si or not isinstance(value, float) or not value:
            continue
        field = _field(place)
        assert field.above is not None
        if field.path[-1] not in field.above.value.model_fields_set:
            values = found.setdefault(".".join(("macro", *field.above.path)), {})
            values.setdefault(str(field.path[-1]), []).append(units.text(value, dimension.quantity))
    for section, keys in found.items():
        said = "; ".join(f"{key} {', '.join(values)}" for key, values in keys.items())
        yield f"not given in {section}, so at the defaults, multiples of the scales: {said}"


def formulas(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a line for each formula of place or time, with the unit in which each counts; nothing without scales."""
    if not units.given:
        return
    for place in walk(MacroSetup, macro):
        if not isinstance(place.value, str) or InScales() not in place.metadata:
            continue
        used = set(re.findall(r"[A-Za-z_]\w*", place.value))  # a rate has other names besides
        counts = [
            f"{', '.join(names)} in multiples of {units.text(1.0, quantity)}"
            for names, quantity in (
                ([name for name in "xyz" if name in used], "displacement"),
                ([name for name in "t" if name in used], "time"),
            )
            if names
        ]
        if counts:
            key = dotted(("macro", *place.path))
            yield f"{key}: the formula {echo(place.value)} has {' and '.join(counts)}, the scales of the study"


def _field(place: Place) -> Place:
    """Return the field of a section that holds a value, or the value itself where it is one."""
    while place.above is not None and not isinstance(place.above.value, BaseModel):
        place = place.above
    return place


#: A surface is across an axis if its nodes differ by less than this share of the body along it.
FLAT = 1e-6
#: Share of the change in a table below which the body has none of it.
LEVEL = 0.01
#: Times at which prescribed values are looked at, beside those of their kinks.
TIMES = 200


@dataclass(frozen=True, eq=False)
class Known:
    """Component of the state that is sure to occur, without the load.

    Attributes
    ----------
    name
        From ``H11`` … ``H33`` and ``p``.
    values : (times,)
        Its value, or its mean along a line.
    where
        Its place in words.
    moved
        Of a stretch, the surfaces with their displacement along its axis (times,) and the key of it.
    width
        Of a stretch, the distance of the surfaces.
    """

    name: str
    values: Array
    where: str
    moved: tuple[tuple[str, Array, str], ...] = ()
    width: float = 0.0


@dataclass(frozen=True, eq=False)
class _Face:
    """Surface across an axis, with the corners of its bounding box."""

    name: str
    axis: int
    at: float
    low: Array
    high: Array
    boundary: Boundary

    def displacement(self, i: int, upper: bool) -> tuple[Value, float, str] | None:
        """Return the prescribed displacement along ``i``, its sign and its key; None if it is free."""
        if self.boundary.normal is not None:
            return (self.boundary.normal, 1.0 if upper else -1.0, "normal") if i == self.axis else None
        value = self.boundary.displacement[i]
        return None if value is None else (value, 1.0, "displacement")

    def meets(self, other: _Face) -> bool:
        """Tell whether lines along the axis join it with another one."""
        others = [axis for axis in range(3) if axis != self.axis]
        overlap = (np.minimum(self.high, other.high) - np.maximum(self.low, other.low))[others]
        return self.axis == other.axis and abs(other.at - self.at) >= 1e-9 and bool((overlap > 0).all())


def require_right_side_out(macro: MacroSettings, mesh: BodyMesh, units: ResultUnits) -> None:
    """Refuse displacements of two surfaces that push one through the other under any load.

    Raises
    ------
    ConfigurationError
        The body would be turned inside out; names the key, the value, and the size of the body.
    """
    times = prescribed_times(macro)
    for each in known(macro, mesh, times):
        if not each.moved:
            continue
        for load in macro.loads:
            k = int((load * each.values).argmin())
            if load * each.values[k] > -1:
                continue
            name, course, key = max(each.moved, key=lambda one: abs(one[1][k]))
            axis = int(each.name[1]) - 1
            said = units.text(load * float(course[k]), "displacement", 4)
            asked = "is that its sign and size?"
            if units.given:
                one = units.text(1.0, "displacement", 4)
                asked = f"did you leave out a unit? A number without one is a multiple of {one}"
            raise ConfigurationError(
                f"macro.boundary.{name}.{key}: u_{axis + 1} = {said} at t = {units.text(float(times[k]), 'time', 3)} "
                f"under the load {load:g} turns the body inside out, which is "
                f"{units.text(each.width, 'displacement', 4)} long {each.where}; expected less than that; "
                f"{asked}"
            )


def prescribed_times(macro: MacroSetup) -> Array:
    """Return times of a run (n,), with all kinks of what is prescribed."""
    plan = macro.time
    kinks = [*macro.corners, plan.end_of_ramp]
    return np.asarray(np.unique(np.concatenate([kinks, np.linspace(0, plan.end, TIMES + 1)])))


def known(macro: MacroSetup, mesh: BodyMesh, times: Array) -> Iterator[Known]:
    """Yield components of the state that are sure to occur at ``times``."""
    for name, boundary in macro.boundary.items():
        if boundary.pressure is not None:
            yield Known("p", _course(macro, boundary.pressure, times), f"on the surface {name}")
    for one, two in combinations(_faces(macro, mesh), 2):
        if not one.meets(two):
            continue
        for i in range(3):
            first, second = one.displacement(i, one.at > two.at), two.displacement(i, two.at > one.at)
            if first is None or second is None:
                continue
            courses = [sign * _course(macro, value, times) for value, sign, _ in (first, second)]
            moved = ((one.name, courses[0], first[2]), (two.name, courses[1], second[2]))
            yield Known(
                f"H{i + 1}{one.axis + 1}",
                (courses[1] - courses[0]) / (two.at - one.at),
                f"between the surfaces {one.name} and {two.name}",
                moved if i == one.axis else (),
                abs(two.at - one.at),
            )


def _faces(macro: MacroSetup, mesh: BodyMesh) -> list[_Face]:
    """Return all surfaces across an axis that have facets."""
    size, found = np.ptp(mesh.points, axis=0), []
    for name, facets in mesh.surfaces.items():
        boundary = macro.boundary.get(name)
        if boundary is None or not len(facets):  # Patches may have taken all facets.
            continue
        points = mesh.points[np.unique(facets)]
        low, high = points.min(axis=0), points.max(axis=0)
        for j in np.flatnonzero(high - low < FLAT * size):
            found.append(_Face(name, int(j), float(low[j]), low, high, boundary))
    return found


def _course(macro: MacroSetup, value: Value, times: Array) -> Array:
    """Return a prescribed value at ``times``, without the load."""
    factor = np.array([macro.factor(value, float(time)) for time in times])
    return factor * value if isinstance(value, int | float) else factor


#: A ramp below this share of the time of consolidation is a jump, and most often one whose unit was left out; 1e-2 to
#: 1e-3 is usual where a relaxation is asked for.
JUMP = 1e-4
#: Before this share of the time half of the fluid is still in a column (0.46): such a run shows little of it.
EARLY = 0.2
#: A run so many times as long, in steps that are longer than it, shows nothing of it either.
LATE = 100.0
#: All that the time of consolidation depends on.
GROWS = (
    "the time grows with cell.viscosity, of which a number without unit is a multiple of scales.viscosity, and with "
    "the square of the size, and falls with the modulus and the square of the pore size (scales.pore or voxel_size)"
)


def run_times(
    macro: MacroSetup, consolidation: float, units: ResultUnits, *, slower: bool = False
) -> Iterator[str]:
    """Yield notes on ramps, end and steps of a run that are far from the time in which the body consolidates.

    A body whose cells evolve has times of its own, by which long steps are chosen; so may have one that is ``slower``.
    """

    def text(time: float) -> str:
        return units.text(time, "time", 3)

    plan, told = macro.time, text(consolidation)
    for key, time in _ramps(macro):
        if time < JUMP * consolidation:
            yield (
                f"{key} is {text(time)}, and the body consolidates in {told}: a jump of the load, which Newton's "
                f"iteration and the sampled ranges have to bear; {_unit(units)}"
            )
    scales = (
        f", the body's size and the scales: {GROWS}"
        if units.given
        else ", cell.viscosity and the size of the body"
    )
    if plan.end < EARLY * consolidation:
        yield (
            f"the run ends after {text(plan.end)}, long before the body consolidates ({told}); "
            f"check macro.time{scales}"
        )
    elif plan.end > LATE * consolidation and plan.step > consolidation and not (slower or macro.evolution):
        yield (
            f"the run ends after {text(plan.end)}, and its steps of {text(plan.step)} are longer than the "
            f"consolidation ({told}); check macro.time{scales}"
        )


def long_step(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a note on steps of equal length that are longer than the run."""
    plan = macro.time
    if plan.tolerance is None and plan.step > plan.end:
        step, end = (units.text(time, "time", 3) for time in (plan.step, plan.end))
        yield (
            f"macro.time.step is {step}, longer than the whole run, which ends at {end}: after the ramp it takes one "
            "step; give a shorter step, or a later end"
        )


def unloaded(macro: MacroSetup, cells: Iterable[Cell]) -> Iterator[str]:
    """Yield a note where all that is prescribed is 0 and no solid of the cells swells, so that the body rests."""
    times = prescribed_times(macro)
    values = [*macro.body_force, *(value for face in macro.boundary.values() for value in _values(face))]
    values += [indenter.motion for indenter in macro.contact.values()]
    acts = any(_course(macro, value, times).any() for value in values)
    begun = macro.initial.pressure != 0 or np.any(macro.initial.gradient)
    swells = any(cell.solid.swells or any(p.path[-1] == SWELLING for p in cell.parameters) for cell in cells)
    if acts or begun or swells:
        return
    yield (
        "nothing loads the body, since all prescribed values are 0, and all results are 0: under macro.boundary give a "
        "displacement, normal, traction, follower, plate, pressure or flux other than 0, or give macro.contact, "
        "macro.body_force, macro.initial or cell.material.swelling"
    )


def pulls(macro: MacroSettings) -> Iterator[str]:
    """Yield a note on the plane surfaces that are pulled under a load, and on how they would be pressed."""
    times = prescribed_times(macro)
    mesh = body_mesh(macro)
    for name, face in macro.boundary.items():
        facets = Facets(mesh, mesh.surface(name, name))
        if not len(facets.nodes):
            continue
        normal = facets.normals.sum(axis=(0, 1))
        axis = int(np.abs(normal).argmax())
        sign = float(np.sign(normal[axis]))
        for value, outwards, what in (
            (face.traction[axis], sign, f"t_{axis + 1} on {name}"),
            (face.displacement[axis], sign, f"u_{axis + 1} on {name}"),
            (face.normal, 1.0, f"the normal displacement of {name}"),
            (face.plate, 1.0, f"the force of the plate on {name}"),
        ):
            outward = outwards * _course(macro, value or 0.0, times)
            pulling = [load for load in macro.loads if (load * outward).max() > 0 >= (load * outward).min()]
            if pulling:
                told = ", ".join(f"{load:g}" for load in pulling)
                yield (
                    f"{what} times the load {told} points out of the body and pulls; give the other sign where the "
                    "surface is to be pressed"
                )
    yield from _only_pressure(macro, times)


def _only_pressure(macro: MacroSettings, times: Array) -> Iterator[str]:
    """Yield a note where the pressure of the pore fluid on surfaces is all that loads the body."""
    acting = {
        name: [value for value in _values(face) if _course(macro, value, times).any()]
        for name, face in macro.boundary.items()
    }
    acting = {name: values for name, values in acting.items() if values}
    alone = acting and all(values == [macro.boundary[name].pressure] for name, values in acting.items())
    if alone and not any(_course(macro, value, times).any() for value in macro.body_force):
        yield (
            f"all that loads the body is 'pressure:' on {', '.join(acting)}: that of the fluid in the pores, "
            "which flows in and widens the body; a piston presses by a traction, such as [0, -20 kPa, 0] on y+"
        )


def free_cuts(macro: MacroSetup) -> Iterator[str]:
    """Yield a note on plane sides without any condition that look like cuts through a whole body."""
    mesh, size = body_mesh(macro), np.ptp(body_mesh(macro).points, axis=0)
    low = mesh.points.min(axis=0)
    flat, free = set[tuple[int, bool]](), dict[str, tuple[int, bool]]()
    planes = Symmetry.of(macro).normals
    for name, facets in mesh.surfaces.items():
        if not len(facets):
            continue
        points = mesh.points[np.unique(facets)]
        for j in np.flatnonzero(np.ptp(points, axis=0) < FLAT * size):
            side = int(j), bool(points[:, j].mean() > low[j] + size[j] / 2)
            flat.add(side)
            face = macro.boundary.get(name)
            if name not in planes and (face is None or _is_free(face)):
                free[name] = side
    cuts = [name for name, (axis, upper) in free.items() if (axis, not upper) not in flat]
    if len(cuts) > 1:
        yield (
            f"the plane sides {' and '.join(cuts)} are free, and the sides across from them are not plane: "
            "if they cut a whole body, they need 'normal: 0' under macro.boundary"
        )


def _is_free(face: Boundary) -> bool:
    """Return whether nothing is prescribed on a surface, not even 0; tractions are 0 where none is given."""
    prescribed = (*face.displacement, face.normal, face.follower, face.plate, face.pressure, face.flux)
    return not any(value is not None for value in prescribed) and not any(face.traction)


def level_tables(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a note on each table of a field of which the body has next to nothing."""
    points = body_mesh(macro).points
    for prefix, fields in sections(macro):
        for name, field in fields.items():
            if not isinstance(field, TableField):
                continue
            at, values = np.array(field.table).T
            axis = "xyz".index(field.along)
            low, high = points[:, axis].min(), points[:, axis].max()
            reached = np.interp(np.append(at[(at > low) & (at < high)], [low, high]), at, values)
            if np.ptp(reached) >= LEVEL * np.ptp(values) or not np.ptp(values):
                continue
            unit = units.text(1.0, "displacement", 4)
            asked = f"; a coordinate without a unit is a multiple of {unit}" if units.given else ""
            yield (
                f"{prefix}.{name}: the table goes from {units.text(float(at[0]), 'displacement', 4)} to "
                f"{units.text(float(at[-1]), 'displacement', 4)}, and the body from "
                f"{units.text(float(low), 'displacement', 4)} to {units.text(float(high), 'displacement', 4)} along "
                f"{field.along}, where next to nothing of it changes{asked}"
            )


def sideways(macro: MacroSetup) -> Iterator[str]:
    """Yield a note where no load acts along y, in whose direction settlement and heave are."""
    mesh, times, axes = body_mesh(macro), prescribed_times(macro), set[int]()

    def acting(values: tuple[Value | None, ...]) -> set[int]:
        return {
            i for i, value in enumerate(values) if value is not None and _course(macro, value, times).any()
        }

    axes |= acting(macro.body_force)
    for indenter in macro.contact.values():
        if acting((indenter.motion,)):
            axes |= set(np.flatnonzero(np.abs(indenter.along) > FLAT).tolist())
    for name, face in macro.boundary.items():
        axes |= acting(face.displacement) | acting(face.traction)
        facets = Facets(mesh, mesh.surface(name, name))
        if len(facets.nodes) and acting((face.normal, face.follower, face.plate, face.pressure, face.flux)):
            axes |= set(np.flatnonzero(np.abs(facets.normals).max(axis=(0, 1)) > FLAT).tolist())
    if axes and 1 not in axes:
        along = " and ".join("xyz"[i] for i in sorted(axes))
        components = " or ".join(f"u_{i + 1}" for i in sorted(axes))
        yield (
            f"the loads act along {along}, and settlement and heave are displacements along y; for the displacement "
            f"along the loads take {components} of a probe (macro.probes), or the largest size of the displacement "
            "('displacement' of the history)"
        )


def part_as_it_is(macro: MacroSetup) -> Iterator[str]:
    """Yield a note where a plate presses a part with planes that may be those of a symmetry that is not given."""
    plates = [name for name, face in macro.boundary.items() if face.plate is not None]
    if not plates or macro.body.symmetry_planes:
        return
    mesh = body_mesh(macro)
    held = [each for each in _faces(macro, mesh) if _slides(each)]
    pressed = {face.axis for face in _faces(macro, mesh) if face.name in plates}
    alone = [
        face.name
        for face in held
        if face.axis not in pressed
        and not any(other is not face and other.axis == face.axis for other in held)
        and not (mesh.revolved and face.axis == 0)  # it goes around
    ]
    if alone:
        planes = ", ".join(alone)
        yield (
            f"no macro.body.symmetry is given, so the force on {' and '.join(plates)} is that on the part as it is, "
            f"and results are those of the part; if {planes} cut a whole specimen, add 'symmetry: [{planes}]' under "
            "macro.body: forces and volumes are then those of the whole"
        )


def _slides(face: _Face) -> bool:
    """Return True if only the displacement along the normal is held, at 0."""
    held, others = face.boundary.displacement[face.axis], list(face.boundary.displacement)
    del others[face.axis]
    return others == [None, None] and _held(face.boundary.normal, held)


def _unit(units: ResultUnits) -> str:
    if not units.given:
        return "is that what you want?"
    return f"did you leave out a unit, here or of cell.viscosity? {GROWS[0].upper()}{GROWS[1:]}"


def _ramps(macro: MacroSetup) -> Iterator[tuple[str, float]]:
    """Yield the keys of all ramps, and the times at which their loads are reached."""
    plain: list[Value] = [value for value in macro.body_force if not isinstance(value, TimeFunction)]
    for name, face in macro.boundary.items():
        plain += [value for value in _values(face) if not isinstance(value, TimeFunction)]
        for course in face.time_functions:
            if course.until is not None:
                yield f"'until' of a ramp under macro.boundary.{name}", course.until
            elif len(course.table) > 1:
                yield f"the last time of a table under macro.boundary.{name}", course.table[-1][0]
    if any(value != 0 for value in plain) and not macro.time.load_curve:
        time = macro.time.end_of_ramp
        yield "the ramp of macro.time, ramp_increments times ramp_step,", time


def _values(face: Boundary) -> list[Value]:
    several = (
        *face.displacement,
        face.normal,
        *face.traction,
        face.follower,
        face.plate,
        face.pressure,
        face.flux,
    )
    return [value for value in several if value is not None]


#: Begin of a line on what makes the results of a run worthless, so that no run is proposed.
WARNING = "warning: "
#: Cells across a body below which its results are hardly those of many cells.
FEW = 10.0
#: Components of a unit normal below this are none.
NORMAL = 1e-9


def separation(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield a note where few cells lie across the body, none without scales, in which the cell has no length.

    The cells along each axis are counted by their own edge along it; the fewest are named.
    """
    cells, across, check = _across(config, mesh)
    if 1 <= cells < FEW:
        yield (
            f"the body is {cells:.2g} cells thick: {across}; "
            f"its law is that of very many cells, and below {FEW:g} results are to be taken with care: {check}"
        )


def too_thin(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield a warning where not one cell lies across the body."""
    cells, across, check = _across(config, mesh)
    if cells < 1:
        yield (
            f"the body is thinner than one cell: {across}; "
            f"it is no body of such cells, and no result means anything: {check}"
        )


#: Operations under which a cell and its mirror image in the plane z = 0 are one: tensors do not change with a point
#: reflection.
MIRROR = np.diag([1, 1, -1])


def out_of_plane(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield a note where a cell is no mirror image of itself in the plane of a body in two dimensions."""
    cells = {name: config.cell_named(name) for name in config.cell_names}
    for name, cell in cells.items():
        if not mesh.flat or MIRROR in cell.point_group:
            continue
        which = "the cell" if name is None else f"the cell {name}"
        away = "turns the body about its axis" if mesh.revolved else "shears the body out of its plane"
        yield (
            f"{which} is no mirror image of itself in the plane z = 0, so that strain in the plane {away}, by as much "
            "as its pores, fibres or voxels differ; two dimensions leave that out: compare with a body of three "
            f"dimensions{', such as a wedge' if mesh.revolved else ''}"
        )


def _across(config: RunConfig, mesh: BodyMesh) -> tuple[float, str, str]:
    """Return how many cells lie across the body, where in words, and what to check; without scales endlessly many."""
    if config.scales is None:
        return np.inf, "", ""
    edges = np.array(config.cell.geometry.sides) * config.scales.pore
    sizes = _sizes(config.macro, mesh) * config.scales.length
    i = int(np.argmin(sizes / edges))
    cells = float(sizes[i] / edges[i])
    body, cell = length_text(float(sizes[i])), length_text(float(edges[i]))
    across = f"{body} along {'xyz'[i]}, and the edge of the periodic cell along it is {cell}{_others(sizes / edges, i)}"
    source = "scales.pore" if config.cell.geometry.length is None else "cell.geometry.voxel_size"
    check = f"check {source}, macro.body, and the unit of each length"
    return cells, across, check


def _others(counts: Array, least: int) -> str:
    """Return in words how many cells lie along the other axes."""
    finite = [
        f"{counts[i]:.2g} along {axis}"
        for i, axis in enumerate("xyz")
        if i != least and np.isfinite(counts[i])
    ]
    endless = [axis for i, axis in enumerate("xyz") if not np.isfinite(counts[i])]
    said = f" ({' and '.join(finite)})" if finite else ""
    if endless:
        said += f"; along {' and '.join(endless)} both faces are held, as if the body went on, and nothing is counted"
    return said


def _sizes(macro: MacroSetup, mesh: BodyMesh) -> Array:
    """Return the sizes of the whole body along x, y and z; it goes on for ever between two planes of symmetry."""
    sizes = _extents(mesh)
    for normal in Symmetry.of(macro).normals.values():
        across = np.abs(normal) > 1 - NORMAL
        sizes = np.where(across, 2 * sizes, sizes)
    for i, axis in enumerate("xyz"):
        faces = [macro.boundary.get(f"{axis}{sign}") for sign in "-+"]
        if all(face is not None and _held(face.normal, face.displacement[i]) for face in faces):
            sizes[i] = np.inf
    return sizes if np.isfinite(sizes).any() else _extents(mesh)


def _extents(mesh: BodyMesh) -> Array:
    """Return the sizes of the body along x, y and z; of one of revolution its diameter, or the wall of a hollow one."""
    sizes: Array = np.ptp(mesh.points, axis=0)
    if mesh.revolved:
        sizes[0] = sizes[2] = sizes[0] * (2 if len(mesh.on_axis) else 1)
    elif mesh.flat:
        sizes[2] = np.inf
    return sizes


def _held(normal: object, displacement: object) -> bool:
    return normal == 0 or displacement == 0
