"""Signs of measured forces and settlements that contradict the load of a study for certain (sign_note)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from porocore.calibration.observations.curve import ObservedCurve
from porocore.calibration.observations.series import MeasuredSeries
from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.interfaces.macro import Part
from porocore.macro.problem import Boundary, MacroSetup

#: Axis and sign of the outward normal of the plane faces of bodies that are no files.
FACES = {f"{axis}{sign}": (k, -1 if sign == "-" else 1) for k, axis in enumerate("xyz") for sign in "-+"}
#: Values of the expected sign below this share of the largest size are noise about zero.
NOISE = 0.05
#: Parts of a study beside which one pressed face does not decide the sign of a force.
_OTHERS: frozenset[Part] = frozenset(("body_force", "initial", "regions"))


def sign_note(curve: ObservedCurve, macro: MacroSetup, load: float) -> str | None:
    """Return the note that all values have the sign that the load excludes; None: they do not, or it may be so."""
    pushed = _pushed(macro, load)
    if pushed is None or curve.measured is None:
        return None
    face, pressed = pushed
    expected = _expected(curve.series, face, pressed)
    values = expected * curve.measured
    if values.min() >= 0 or values.max() > -NOISE * values.min():
        return None
    found, there = ("below", "above") if expected > 0 else ("above", "below")
    held = ", positive in compression," if curve.series.kind == "force" and not curve.series.component else ""
    return (
        f"the values are {found} 0, but the study {'presses' if pressed else 'pulls'} {face}, so that the "
        f"{curve.series.words}{held} is {there} 0; give 'factor: -1' if the file counts the other way"
    )


def _expected(series: MeasuredSeries, face: str, pressed: bool) -> int:
    """Return the sign of a series; 0: it is not certain."""
    if series.kind == "settlement":
        return int(face == "y+" and pressed)
    axis, side = FACES.get(series.surface, (-1, 0))
    if series.kind != "force" or axis != FACES[face][0]:
        return 0
    sense = 1 if pressed else -1
    if not series.component:
        return sense
    return -sense * side if series.component == axis + 1 else 0


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
