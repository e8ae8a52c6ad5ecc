"""Notes on how far the body leaves the sampled ranges in a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import NAMES, InputSpace, components
from porocore.core.units import ResultUnits
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.body.kinds import point_states
from porocore.macro.body.mesh import BodyMesh
from porocore.plugins.border import prediction_of
from porocore.report.metrics import LeftOut
from porocore.states import Array, IntArray, MacroState

#: A proposed range goes beyond what was reached by this share of its width.
MARGIN = 0.1
#: Components that one warning names.
MOST = 4
#: The kept times tell why a body is flagged, if at one of them this share of what is ever flagged is.
KEPT_SHARE = 0.9
#: No range is proposed below this stretch 1 + H_ii along an axis: a cell is crushed there, and at 0 a body is turned
#: inside out.
LEAST_STRETCH = 0.2
#: The reach beyond a range, as a share of its width, that is round-off.
ROUND_OFF = 1e-6
DIAGONAL = ("H11", "H22", "H33")
MINUS = str.maketrans("-", "−")


@dataclass(frozen=True)
class Reach:
    """Component of the state that leaves what is sampled.

    Attributes
    ----------
    name
        From ``H11`` … ``H33`` and ``p``.
    value
        Farthest of what it reaches.
    sampled
        Its sampled range; None where it was not sampled.
    low, high
        All that it reaches.
    where
        Place and time of ``value`` in words.
    """

    name: str
    value: float
    sampled: tuple[float, float] | None
    low: float
    high: float
    where: str

    def in_words(self, units: ResultUnits) -> str:
        """Return what is reached and what was sampled."""
        known = "not sampled"
        if self.sampled is not None:
            ends = ", ".join(written(self.name, end, units) for end in self.sampled)
            known = f"sampled in [{ends}]".translate(MINUS)
        value = written(self.name, self.value, units).translate(MINUS)
        # Not in the place: a surface may be called y-.
        return f"{self.name} = {value} {self.where} ({known})"

    def line(self, units: ResultUnits, further: float = 0.0) -> str:
        """Return the line of the configuration that samples it, and at least this share more of what was missing."""
        ends = (*(self.sampled or (0.0, 0.0)), self.low, self.high)
        low, high = min(ends), max(ends)
        more = MARGIN * (high - low)
        inside = self.sampled or (0.0, 0.0)
        low = _outward(low - max(more, further * (inside[0] - low)), -1) if low < inside[0] else inside[0]
        high = _outward(high + max(more, further * (high - inside[1])), 1) if high > inside[1] else inside[1]
        if self.name in DIAGONAL:
            low = min(max(low, LEAST_STRETCH - 1), inside[0])
        return f"{self.name}: {{range: [{', '.join(written(self.name, end, units) for end in (low, high))}]}}"


def written(name: str, value: float, units: ResultUnits) -> str:
    """Return a value of a component as the configuration may have it."""
    if name != "p" or not units.given or value == 0:
        return f"{value:.3g}"
    return f"{value * units.factor('pressure'):.3g} {units.units.of('pressure')}"


def advice(reached: Sequence[Reach], units: ResultUnits) -> str:
    """Return what is reached, and the lines to write."""
    shown = reached[:MOST]
    more = f"; and {len(reached) - MOST} more" if len(reached) > MOST else ""
    said = "; ".join(each.in_words(units) for each in shown)
    return f"{said}{more}. Write under 'sampling.inputs:' " + ", ".join(each.line(units) for each in reached)


def beyond(inputs: InputSpace, rows: Array, where: Callable[[int], str]) -> list[Reach]:
    """Return the components that leave what is sampled in ``rows`` (10, n), the worst first; ``where`` names places.

    A component that is no input leaves it where it is not negligible. The worst is that with the largest excess as a
    share of its range, those that are no inputs before all others.
    """
    found: list[tuple[float, Reach]] = []
    for column, name in enumerate(NAMES):
        values = rows[column]
        if name in inputs.names:
            k = inputs.names.index(name)
            ends = inputs.lower[k], inputs.upper[k]
            excess = np.maximum(ends[0] - values, values - ends[1]) / (ends[1] - ends[0])
            least, rank, sampled = ROUND_OFF, 0.0, ends
        else:
            excess, least, rank, sampled = np.abs(values), inputs.negligible, 1e6, None
        if len(excess) and np.nanmax(excess) > least:
            worst = int(np.nanargmax(excess))
            reach = Reach(
                name, float(values[worst]), sampled, float(values.min()), float(values.max()), where(worst)
            )
            found.append((rank + float(excess[worst]), reach))
    return [reach for _, reach in sorted(found, key=lambda each: -each[0])]


#: What gives more states.
MORE = "raise sampling.options.count"


def flagged_place(
    solution: MacroSolution,
    surrogate: Surrogate,
    objective: bool = False,
    units: ResultUnits | None = None,
    more: str = MORE,
) -> str:
    """Return which components take a body out of what is sampled, where and when, and what to write.

    Where all lie within their ranges, the first of the elements that are flagged most at the latest kept time is named
    with the component at fault. The text is empty without flagged elements.

    Parameters
    ----------
    solution
        With the surrogate; the points of flagged elements at its kept times are looked at.
    surrogate
        With its inputs.
    objective
        Whether the surrogate does not change when a state is turned.
    units
        Units of the results; None: without.
    more
        What gives more states.
    """
    units = units or ResultUnits()
    shares = [float(profile.flagged.max(initial=0.0)) for profile in solution.profiles]
    if not max(shares, default=0.0) > 0:
        return ""
    states, where = visited(solution, units, flagged=True)
    if objective:
        states = surrogate.inputs.without_rotation(states)
    reached = beyond(surrogate.inputs, components(states), where)
    if reached:
        return f"Beyond what was sampled: {advice(reached, units)}."
    latest = len(shares) - 1 - int(np.argmax(shares[::-1]))
    profile = solution.profiles[latest]
    element = int(np.argmax(profile.flagged))
    why = surrogate.reasons(_worst(solution, latest, element, surrogate))[0]
    example = (
        f"An example is the element {_place(solution, element, profile.time, units)}{why and ': ' + why}"
    )
    return f"{example}. All lies within the sampled ranges, so more states help: {more}."


def change_without(shear: float, largest: float) -> float:
    """Return by which share results change at most, about, if a shear is left out that reaches ``shear``.

    A mirror turns the signs of two of the three shears and leaves the cell as it is, so the energy is even in them; a
    potential has the stiffness against them at rest. So the change is as the square of the shear over the largest
    component of H. Measured on a voxel scaffold under 10 % compression, with H13 = −0.009: 0.52 % by this, 0.42 % in
    the force.
    """
    return (shear / largest) ** 2 if largest else 0.0


def shears(names: Iterable[str]) -> list[str]:
    """Return those of the components of H that are off its diagonal."""
    return [name for name in names if name[0] == "H" and name[1] != name[2]]


def left_out_shear(
    solution: MacroSolution, surrogate: Surrogate, tolerance: float, units: ResultUnits | None = None
) -> LeftOut | None:
    """Return the shear that was not sampled, where without such the surrogate flags nothing at the kept times.

    The surrogate is that of a potential of a cell with mirrors, none of whose shears was sampled. None where something
    else flags as well, or where the body is flagged most between the kept times.
    """
    units, inputs = units or ResultUnits(), surrogate.inputs
    history, kept = solution.history, [profile.time for profile in solution.profiles]
    at_kept = np.interp(kept, history.time, history.flagged) if kept else np.zeros(1)
    if at_kept.max() < max(KEPT_SHARE * history.flagged.max(), ROUND_OFF):
        return None
    states, where = visited(solution, units, flagged=True)
    if not len(states):
        return None
    turned = inputs.without_rotation(states)
    reached = beyond(inputs, components(turned), where)
    if not reached or set(shears(NAMES)).isdisjoint(each.name for each in reached):
        return None
    plain = turned.grad_u * np.eye(3)
    flagged = prediction_of(surrogate, replace(turned, grad_u=plain), tangent=False).flagged
    if flagged.any():
        return None
    worst = max((each for each in reached if each.name in shears(NAMES)), key=lambda each: abs(each.value))
    largest = float(np.abs(visited(solution, units)[0].grad_u).max())
    lines = ", ".join(each.line(units) for each in reached)
    return LeftOut(worst.name, worst.value, change_without(worst.value, largest), tolerance, lines)


def _worst(solution: MacroSolution, i: int, element: int, surrogate: Surrogate) -> MacroState:
    """Return the first state of an element that the surrogate flags; its mean where it flags none of the points."""
    points = _point_states(solution, BodyMesh.of(solution), i, np.array([element]))
    flagged = prediction_of(surrogate, points, tangent=False).flagged
    if not flagged.any():
        return solution.cell_states(i)[[element]]
    return points[flagged][:1]


def _point_states(solution: MacroSolution, mesh: BodyMesh, i: int, elements: IntArray) -> MacroState:
    """Return the states at the points of some elements at profile ``i``, as their cells see them."""
    profile = solution.profiles[i]
    states = point_states(mesh, profile.u, profile.p, elements)
    return solution.seen_by_cells(states, i, np.repeat(elements, len(mesh.element.weights)))


def visited(
    solution: MacroSolution, units: ResultUnits, *, flagged: bool = False
) -> tuple[MacroState, Callable[[int], str]]:
    """Return the states at all points at the kept times after rest, or those of flagged elements, and where each is.

    They are those that the cells see; see :meth:`~porocore.interfaces.solution.MacroSolution.seen_by_cells`.
    """
    mesh = BodyMesh.of(solution)
    elements = [np.flatnonzero(_wanted(profile, flagged)) for profile in solution.profiles]
    found = [_point_states(solution, mesh, i, some) for i, some in enumerate(elements)]
    of, points = np.concatenate(elements), len(mesh.element.weights)
    times = np.repeat([profile.time for profile in solution.profiles], [len(some) for some in elements])

    def where(row: int) -> str:
        return _place(solution, int(of[row // points]), float(times[row // points]), units)

    return MacroState.concatenate(found), where


def _wanted(profile: Profile, flagged: bool) -> npt.NDArray[np.bool_]:
    share = profile.flagged
    return share > 0 if flagged else np.full(len(share), profile.time > 0)


def _place(solution: MacroSolution, element: int, time: float, units: ResultUnits) -> str:
    centre = solution.points[solution.cells[element]].mean(axis=0) * units.factor("displacement")
    at = f"at ({', '.join(f'{x:.3g}' for x in centre)})"
    at += f" {units.name('displacement')}" if units.given else ""
    return f"{at} at t = {units.text(time, 'time', 3)}"


def _outward(value: float, sign: int) -> float:
    """Return a number of two digits that is not nearer to the other end than ``value``."""
    if value == 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return float(f"{sign * math.ceil(sign * value / step - 1e-9) * step:.6g}")
