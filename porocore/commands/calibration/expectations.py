"""Notes on a measured curve before the fit: its sign and size beside the study's, what the study prescribes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from porocore.commands.calibration.clouds import FilmComponent
from porocore.commands.calibration.observations import MeasuredSeries, ObservedCurve, by_curve
from porocore.commands.calibration.plan import AXES, OF_LOAD, CalibrationPlan, Experiment, occurrences
from porocore.commands.calibration.problem import CurveModel, first_coordinates, values_at
from porocore.commands.calibration.settings import Kind
from porocore.core.formulas import TimeFunction, Value
from porocore.core.units import pretty, units_now
from porocore.errors import ConfigurationError, PluginError, SolveError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import Part
from porocore.macro.body.mesh import Facets
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.composition.fields import AXES as AXES_FIELD
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.problem import Boundary, MacroSetup, body_mesh
from porocore.plugins import registry
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.notes.at_rest import MOST_TETRAHEDRA, tetrahedra_solved
from porocore.study.notes.linear_reach import linear_solutions, too_large
from porocore.study.run.composition import law_of_body, with_memory
from porocore.study.run.reference import undeformed

#: Weights of nodes, and components of normals, below this are round-off.
ON_A_NODE = 1e-9
#: Axis and sign of the outward normal of the plane faces of bodies that are no files.
FACES = {f"{axis}{sign}": (k, -1 if sign == "-" else 1) for k, axis in enumerate("xyz") for sign in "-+"}
#: Values of the other sign below this share of the largest size are noise about a zero.
NOISE = 0.05
#: Values above the first share of the largest size decide the sign; the second of them have that of the largest.
DECISIVE, MOST = 0.1, 0.8
#: Of the movements along y, the other one and its direction in words.
OPPOSITE: dict[Kind, tuple[Kind, str]] = {
    "settlement": ("heave", "the movement along +y"),
    "heave": ("settlement", "the movement against y"),
}
#: Displacements so many times as large as the body are noted.
SEVERAL = 3.0
#: Parts of a study beside which one pressed face does not decide the sign of a force.
_OTHERS: frozenset[Part] = frozenset(("body_force", "contact", "initial", "regions"))


def sign_note(curve: ObservedCurve, macro: MacroSetup, load: float) -> str | None:
    """Return the note that the large values have a sign that the load excludes; None: they do not, or it may be so."""
    pushed, series = _pushed(macro, load), curve.series
    if curve.measured is None or not isinstance(series, MeasuredSeries):
        return None
    if series.indenter:
        return _indenter_note(curve, series)
    if pushed is None:
        return None
    face, pressed = pushed
    expected = _expected(series, macro, face, pressed)
    acts = f"the study {'presses' if pressed else 'pulls'} {face}, so that the {series.words}"
    low, high = float(curve.measured.min()), float(curve.measured.max())
    if expected == 0 and (low < -high * NOISE) != (high > -low * NOISE):
        other, along = OPPOSITE[series.kind]
        factor = " and 'factor: -1'" if high < -low else ""
        return (
            f"the values reach {high if high > -low else low:.4g} {pretty(curve.unit)}".rstrip()
            + f", but {acts} stays 0; change the sign of the load, or give 'quantity: {other}'{factor} if {along} was "
            "measured"
        )
    if expected == 1 and series.kind in OPPOSITE and (position := _position(curve)):
        return f"{position}, but {acts} grows; {_of_a_position(curve)} if the file holds a position"
    first = _of_other_sign((expected or 0) * curve.measured)
    if first is None:
        return None
    found, there = ("below", "above") if expected == 1 else ("above", "below")
    reached = f"{curve.measured[first]:.4g} {pretty(curve.unit)}".rstrip()
    held = ", positive in compression," if series.kind == "force" and not series.component else ""
    return (
        f"the values reach {reached}, {found} 0, but {acts}{held} is {there} 0; give 'factor: -1' if the file counts "
        "the other way"
    )


def _of_other_sign(values: Array) -> int | None:
    """Return the place of the largest value if it is negative, and most of the large ones are; None: they are not."""
    sizes = np.abs(values)
    first = int(sizes.argmax())
    if values[first] >= 0 or np.mean(values[sizes > DECISIVE * sizes[first]] < 0) < MOST:
        return None
    return first


def _indenter_note(curve: ObservedCurve, series: MeasuredSeries) -> str | None:
    """Return the note on a force, contact radius or contact area below 0, whatever the load is."""
    assert curve.measured is not None
    first = None if series.kind == "displacement" else _of_other_sign(curve.measured)
    if first is None:
        return None
    reached = f"{curve.measured[first]:.4g} {pretty(curve.unit)}".rstrip()
    why = "an indenter presses along its direction, so that" if series.kind == "force" else "but"
    return (
        f"the values reach {reached}, below 0, {why} the {series.words} is never below 0; give 'factor: -1' if the "
        "file counts the other way"
    )


def body_height(macro: MacroSetup) -> float:
    """Return the height of the body along y."""
    return float(np.ptp(body_mesh(macro).points[:, 1]))


def _position(curve: ObservedCurve) -> str:
    """Return the words on values that fall from their largest and stay far from 0; empty: they do not."""
    measured = curve.measured
    if measured is None or measured[0] <= 0 or not isinstance(curve.series, MeasuredSeries):
        return ""
    change = float(np.ptp(measured))
    if not 0 < change < measured[0] or (np.diff(measured) > NOISE * change).any():
        return ""
    unit = f" {pretty(curve.unit)}".rstrip()
    return f"the values begin at {measured[0]:.6g}{unit} and fall to {measured[-1]:.6g}{unit}"


def _of_a_position(curve: ObservedCurve) -> str:
    """Return how the movement is made of positions that fall."""
    assert curve.measured is not None
    return f"give 'offset: {f'{curve.measured[0]:.6g} {curve.unit}'.rstrip()}' and 'factor: -1'"


def size_note(curve: ObservedCurve, macro: MacroSetup) -> str | None:
    """Return the note that a displacement is several times as large as the body; None: it is not.

    Raises
    ------
    ConfigurationError
        A settlement is larger than the height of a body that stands on a held face.
    """
    if curve.series.quantity != "displacement" or curve.measured is None:
        return None
    sizes, units = np.ptp(body_mesh(macro).points, axis=0) * curve.factor, units_now()
    series = curve.series
    settles = isinstance(series, MeasuredSeries) and series.kind == "settlement"
    stands = settles and _is_held(macro, "y-")
    reached = float(curve.measured.max() if stands else np.abs(curve.measured).max())
    size = float(sizes[1] if stands else SEVERAL * sizes.max())
    if reached <= size * (1 + ON_A_NODE):
        return None
    words = f"{size if stands else size / SEVERAL:.4g} {pretty(curve.unit)}".rstrip()
    where = "" if curve.file is None else f" in {curve.file.name}"
    given = "it is taken from" if curve.unit else "give"
    advice = f"check the unit of the values ({given} '{curve.unit_key}:' or the heading)"
    if units.given and not curve.unit:
        advice += f", without which they are multiples of {units.text(1.0, 'displacement')}"
    advice += f", and macro.body{' with scales.length' if units.given else ''}"
    size_words = f"the {curve.series.words} reaches {reached:.4g} {pretty(curve.unit)}".rstrip() + where
    if position := _position(curve):
        advice = f"{position}: {_of_a_position(curve)} if they are positions, otherwise {advice}"
    if stands:
        raise ConfigurationError(
            f"{size_words}; expected less than {words}, the height of the body, which stands on y-; {advice}"
        )
    return f"{size_words}, but the body is at most {words} long; {advice}"


def require_free(series: MeasuredSeries, macro: MacroSetup, load: float) -> None:
    """Refuse a settlement, heave, displacement or pressure that the study prescribes, whatever its unknowns are.

    Raises
    ------
    ConfigurationError
        It is prescribed; the message begins with the key of the observation.
    """
    if series.indenter:
        given = "displacement" if macro.contact[series.indenter].force is None else "force"
        held = f"macro.contact.{series.indenter}.{given}" if series.kind == given else ""
    elif series.probe:
        held = _held_at(series, macro)
    else:
        pushed = _pushed(macro, load) if series.kind in ("settlement", "heave") else None
        face, pressed = pushed or ("", False)
        down = face == ("y+" if pressed else "y-")
        moved = face in ("y+", "y-") and macro.boundary[face].is_moved
        held = f"macro.boundary.{face}" if moved and down == (series.kind == "settlement") else ""
    other = "the force on a surface that is held or moved"
    if series.indenter:
        other = f"its {'displacement' if series.kind == 'force' else 'force'}"
    if held:
        raise ConfigurationError(
            f"{'probe' if series.probe else 'quantity'}: expected a curve that depends on the unknowns, but {held} "
            f"prescribes the {series.words}; fit another quantity, such as {other}, or remove the curve"
        )


def _held_at(series: MeasuredSeries, macro: MacroSetup) -> str:
    """Return the key of the surface that prescribes a series at its probe; empty where none does."""
    mesh, place = body_mesh(macro), series.place
    assert place.component is not None
    rows = interpolation(mesh, {series.probe: macro.probes[series.probe]})
    found = rows[place.component]
    columns = found.indices[np.abs(found.data) > ON_A_NODE]
    fluid = place.component == len(AXES)
    nodes = mesh.p_nodes[columns - mesh.n_u] if fluid else columns // len(AXES)
    for name, boundary in macro.boundary.items():
        key = f"macro.boundary.{name}"
        facets = Facets(mesh, mesh.surface(name, key))
        if not np.isin(nodes, facets.nodes).all():
            continue
        if fluid and boundary.pressure is not None:
            return f"{key}.pressure"
        if not fluid and boundary.displacement[place.component] is not None:
            return f"{key}.displacement"
        if not fluid and boundary.normal is not None:
            normal = facets.plane(f"{key}.normal")
            if abs(normal[place.component]) > 1 - ON_A_NODE:
                return f"{key}.normal"
    return ""


def _expected(series: MeasuredSeries, macro: MacroSetup, face: str, pressed: bool) -> int | None:
    """Return the sign of a series, 0 where it stays 0; None: it is not certain."""
    sense = 1 if pressed else -1
    if series.kind in OPPOSITE and face in ("y-", "y+"):
        down = sense * FACES[face][1]
        if down == (1 if series.kind == "settlement" else -1):
            return 1
        return 0 if _is_held(macro, "y-" if face == "y+" else "y+") else None
    axis, side = FACES.get(series.surface, (-1, 0))
    if series.kind != "force" or axis != FACES[face][0]:
        return None
    if not series.component:
        return sense
    return -sense * side if series.component == axis + 1 else None


def _is_held(macro: MacroSetup, face: str) -> bool:
    """Return True for a face across y that does not move along it."""
    boundary = macro.boundary.get(face)
    return boundary is not None and 0 in (boundary.normal, boundary.displacement[1])


def _pushed(macro: MacroSetup, load: float) -> tuple[str, bool] | None:
    """Return the only face that is loaded, ever more and along its normal, and True where it is pressed."""
    constant = all(isinstance(value, int | float) for value in macro.fields.values())
    loaded = [(name, each) for name, each in macro.boundary.items() if any(map(_acts, _values(each)))]
    if macro.body.kind == "file" or not constant or _OTHERS & macro.parts or len(loaded) != 1:
        return None
    name, boundary = loaded[0]
    acting = [value for value in _values(boundary) if _acts(value)]
    if name not in FACES or len(acting) != 1:
        return None
    axis, side = FACES[name]
    along = ((boundary.displacement[axis], side), (boundary.traction[axis], side), (boundary.plate, side))
    for value, outward in (*along, (boundary.normal, 1), (boundary.follower, -1)):
        if value is not None and _acts(value):
            end = load * outward * _rising(value, macro)
            return (name, end < 0) if end else None
    return None


def _values(boundary: Boundary) -> Sequence[Value | None]:
    """Return everything that is prescribed on a surface."""
    moved = (*boundary.displacement, boundary.normal)
    return (*moved, *boundary.traction, boundary.follower, boundary.plate, boundary.pressure, boundary.flux)


def _acts(value: Value | None) -> bool:
    return value is not None and value != 0


def _rising(value: Value, macro: MacroSetup) -> float:
    """Return the last value of one that only grows in size; 0 for any other."""
    if isinstance(value, TimeFunction):
        if value.expression is not None:
            return 0.0
        course = [0.0, *(value.at(time) for time in value.corners)]
    else:
        course = [0.0, *(value * macro.ramp(time) for time in (*macro.corners, macro.time.end))]
    grows = all(one * other >= 0 and abs(other) >= abs(one) for one, other in pairwise(course))
    return course[-1] if grows else 0.0


#: Values so many times as large or as small as those of the study are noted; laws and unknowns explain less.
FAR = 30.0
#: Values so far beyond all that an unknown modulus can make of the study's are noted, where they are FAR from these.
BEYOND = 10.0
#: Correlation of measured and predicted fields, each about 0, below whose opposite they have the wrong sign.
OPPOSED = 0.5
#: Quantities whose size hardly depends on when the data were taken.
SIZED = ("force", "displacement", "volume")


def scale_note(curve: ObservedCurve, predicted: Array, least: float, most: float, words: str) -> str | None:
    """Return the note that a curve is far larger or smaller than the study's; None: it is not.

    Parameters
    ----------
    curve
        The measured curve.
    predicted
        Values of the study, in the unit of the curve.
    least, most
        Multiples of these that the unknowns can make of them.
    words
        Where they are from, such as ``by linear poroelasticity``.
    """
    series, is_film = curve.series, isinstance(curve.series, FilmComponent)
    # A film has the times of the study, when its pressures are what they were.
    if curve.measured is None or not (is_film or series.quantity in SIZED) or curve.is_noise:
        return None
    measured, own = float(np.abs(curve.measured).max()), float(np.abs(predicted).max())
    low, high = min(least / BEYOND, 1 / FAR), max(most * BEYOND, FAR)
    if own == 0 or measured == 0 or low * own <= measured <= high * own:
        return None
    unit = f" {pretty(curve.unit)}".rstrip()
    bound = f"at most {most * own:.3g}" if measured > own else f"at least {least * own:.3g}"
    factor = "" if is_film else "'factor:', "
    return (
        f"the values reach {measured:.3g}{unit} in size, but those of the study {own:.3g}{unit} {words}, and {bound}"
        f"{unit} between the bounds; check the unit of the values ('{curve.unit_key}:' or the heading), "
        f"{factor}and the units of the study"
    )


def opposite_note(curve: ObservedCurve, predicted: Array) -> str | None:
    """Return the note that a component of a film runs against the study's; None: it does not, or shows nothing.

    Parameters
    ----------
    curve
        The measured component.
    predicted
        Its values in the study, in the unit of the curve.
    """
    measured = curve.measured
    if measured is None or not isinstance(curve.series, FilmComponent) or curve.is_noise:
        return None
    sizes = float(np.linalg.norm(measured)) * float(np.linalg.norm(predicted))
    if sizes == 0 or float(np.abs(predicted).max()) <= float(curve.deviations.max()):
        return None
    cosine = float(measured @ predicted) / sizes
    if cosine > -OPPOSED:
        return None
    advice = (
        "whether suction counts as positive"
        if curve.series.quantity == "pressure"
        else ("the directions of the camera's axes, 'camera.rotation:', and the sign of the load")
    )
    return (
        f"the values have the opposite sign of those of the study at the start values (correlation {cosine:.2f}); "
        f"check the sign of the column, which porocore does not change, and {advice}"
    )


def linear_notes(plan: CalibrationPlan) -> Iterator[str]:
    """Yield a note on each curve whose size linear poroelasticity excludes; undeformed cells and bodies are solved.

    Where they are too large for a check, or fail, nothing is noted.
    """
    for experiment in plan.experiments:
        if _is_loaded_by_an_unknown(plan, experiment) or not any(map(_is_sized, experiment.curves)):
            continue
        law = None if too_large(experiment.config.macro) else _linear_law(experiment.config)
        try:
            parts = [] if law is None else linear_solutions(_of_one_cell(experiment.config), law)
        except SolveError:
            continue
        solutions = [whole_specimen(part, experiment.config.macro) for part in parts]
        for curve in experiment.curves if solutions else ():
            series = curve.series
            if not isinstance(series, MeasuredSeries):
                continue
            values = np.concatenate([series.values(one) for one in solutions]) * curve.factor
            note = scale_note(curve, values, *_multiples(plan, experiment), "by linear poroelasticity")
            if note:
                yield f"{curve.name}: {note}"


def start_notes(plan: CalibrationPlan, model: CurveModel) -> Iterator[str]:
    """Yield a note on each curve whose size the study does not have at the start values of the unknowns."""
    try:
        values = model.curves(values_at(model.unknowns, first_coordinates(model.unknowns))).values
    except SolveError:  # the fit says so
        return
    parts = iter(by_curve(values, plan.curves))
    for experiment in plan.experiments:
        multiples = _multiples(plan, experiment, of_start=True)
        for curve, part in zip(experiment.curves, parts, strict=False):
            note = opposite_note(curve, part) or scale_note(curve, part, *multiples, "at the start values")
            if note and not _is_loaded_by_an_unknown(plan, experiment):
                yield f"{curve.name}: {note}"


def _is_sized(curve: ObservedCurve) -> bool:
    return curve.measured is not None and curve.series.quantity in SIZED


def _is_loaded_by_an_unknown(plan: CalibrationPlan, experiment: Experiment) -> bool:
    return any(each.number.kind in OF_LOAD for each in occurrences(plan.unknowns, experiment))


def _multiples(
    plan: CalibrationPlan, experiment: Experiment, *, of_start: bool = False
) -> tuple[float, float]:
    """Return by what an unknown modulus can multiply forces or divide displacements: the least and the most.

    They are multiples of what the study gives with its own modulus, or with that of the start.
    """
    found = [1.0]
    for each in occurrences(plan.unknowns, experiment):
        if each.number.kind == "modulus":
            one = plan.unknowns[each.index].unknown
            own = one.start if of_start else each.number.value / each.factor
            found += [x for end in (one.lower, one.upper) for x in (end / own, own / end)]
    return min(found), max(found)


def _linear_law(config: RunConfig) -> MacroLaw | None:
    """Return linear poroelasticity of the body, with the middle of a family; None where a cell is large."""
    found = {name: _linear_law_of_cell(config.of_cell(name)) for name in config.cell_names}
    laws = {name: law for name, law in found.items() if law is not None}
    if len(laws) < len(found):
        return None
    return law_of_body(
        config, {name: with_memory(law, config.of_cell(name), linear=True) for name, law in laws.items()}
    )


def _of_one_cell(config: RunConfig) -> RunConfig:
    """Return a study without the fields of parameters, of which the law of one cell has none."""
    macro = config.macro
    regions = {
        name: each.model_copy(update={"fields": {k: v for k, v in each.fields.items() if k == AXES_FIELD}})
        for name, each in macro.regions.items()
    }
    fields = {k: v for k, v in macro.fields.items() if k == AXES_FIELD}
    return config.model_copy(
        update={"macro": macro.model_copy(update={"fields": fields, "regions": regions, "evolution": {}})}
    )


def _linear_law_of_cell(config: RunConfig) -> MacroLaw | None:
    try:
        registry.get("cell solver", config.fem.backend)
    except PluginError:
        return None
    if tetrahedra_solved(config.cell) > MOST_TETRAHEDRA:
        return None
    reference = undeformed(config.cell, config.fem, config.conductivity, None)
    return LinearPoroelasticity(reference.coefficients(config.cell, config.conductivity))
