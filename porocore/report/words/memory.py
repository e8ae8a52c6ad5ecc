"""Memory of a body (BodyMemory): overstress, fixed charges, parameters that evolve, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.cell.materials.prony import Relaxation
from porocore.core.units import ResultUnits, units_now
from porocore.interfaces.solution import PORE_PRESSURE, MacroSolution, Profile
from porocore.macro.laws.relaxation import OVERPRESSURE, OVERSTRESS
from porocore.report.format import in_unit, measured, percent, unit
from porocore.report.words.parameters import MEAN_DIGITS, ParameterRange, from_to, volumes_of
from porocore.states import Array

#: An overstress of which less than this share of the largest is left has relaxed.
RELAXED = 1e-2
#: A parameter stands at an end of its range to this share of its width; means have round-off.
AT_END = 10.0 ** (3 - MEAN_DIGITS)
#: Quantities of a body with fixed charges: quantity of the unit, in words, and as a label.
OF_CHARGES = {
    "osmotic_pressure": ("pressure", "osmotic pressure", r"osmotic pressure $\pi$"),
    "fixed_charge_density": ("concentration", "fixed charge density", "fixed charge density $c_F$"),
    PORE_PRESSURE: ("pressure", "pore pressure", "pore pressure $p$"),
    "swelling_stretch": ("", "swelling stretch", "swelling stretch $J^{1/3}$"),
}


@dataclass(frozen=True, eq=False)
class Course:
    """A field of the elements at the kept times.

    Attributes
    ----------
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    plain, label
        In words, and as a label in matplotlib's mathematics.
    values : (profiles, elements)
        NaN where it is not there.
    """

    quantity: str
    plain: str
    label: str
    values: Array


@dataclass(frozen=True, eq=False)
class BodyMemory:
    """A solution whose law has a memory.

    Attributes
    ----------
    solution
        With profiles.
    ranges
        Range of each parameter of the cell, by the name of the parameter, for each region: the rest of the body first.
    relaxations
        Those of the cells whose solid relaxes.
    """

    solution: MacroSolution
    ranges: Sequence[Mapping[str, ParameterRange]] = ()
    relaxations: Sequence[Relaxation] = ()

    @property
    def times(self) -> Array:
        """Times of the profiles."""
        return np.array([each.time for each in self.solution.profiles])

    @property
    def branches(self) -> int:
        """Number of the branches by which the solid relaxes."""
        return sum(name.startswith(OVERSTRESS) for name in self.solution.quantities)

    def courses(self) -> dict[str, Course]:
        """Return what the body with fixed charges has, then the parameters that evolve, by their names."""
        solution, found = self.solution, {}
        for name, (quantity, plain, label) in OF_CHARGES.items() if solution.has_charges else ():
            values = [_of_charges(profile, name) for profile in solution.profiles]
            found[name] = Course(quantity, plain, label, np.stack(values))
        cells = solution.element_cells
        for name in solution.evolving:
            assert cells is not None
            values = [cells.field(name, i) for i in range(len(solution.profiles))]
            found[name] = Course(self._quantity(name), name, name.replace("_", r"\_"), np.stack(values))
        return found

    def _quantity(self, name: str) -> str:
        return next((each[name].quantity for each in self.ranges if name in each), "")

    def figures(self) -> dict[str, Any]:
        """Return the figures of each kind of memory, dimensionless and ready for JSON; empty without one.

        Returns
        -------
        dict
            ``relaxation``: for each branch ``strength`` and ``time``, least and largest in the body; the largest size
            √(Q:Q) of the overstress and of the overpressure at the kept times, and at the end; when the first is
            largest, and which share of it is left. ``charges``: by quantity, least, mean and largest in the body at
            each of the ``times``. ``evolution``: by parameter, least and largest at first and at the end;
            shares of the body that stand at the lower and the upper end of the range then; time and place of the first
            element that does.
        """
        found: dict[str, Any] = {}
        if self.branches:
            found["relaxation"] = [self._branch(k) for k in range(1, self.branches + 1)]
        courses, volumes = self.courses(), volumes_of(self.solution)
        if self.solution.has_charges:
            found["charges"] = {"times": self.times.tolist()} | {
                name: [_summed(values, volumes) for values in courses[name].values] for name in OF_CHARGES
            }
        if self.solution.evolving:
            found["evolution"] = {
                name: self._evolution(name, courses[name], volumes) for name in self.solution.evolving
            }
        return found

    def _branch(self, k: int) -> dict[str, Any]:
        stresses, pressures = (
            np.array([np.abs(_size(each.internal[f"{name}{k}"])).max() for each in self.solution.profiles])
            for name in (OVERSTRESS, OVERPRESSURE)
        )
        largest = int(stresses.argmax())
        return {
            "strength": self._number(k, "strength"),
            "time": self._number(k, "time"),
            "overstress_largest": float(stresses[largest]),
            "time_of_largest_overstress": float(self.times[largest]),
            "overstress_end": float(stresses[-1]),
            "overstress_left": float(stresses[-1] / stresses[largest]) if stresses[largest] else None,
            "overpressure_largest": float(pressures.max()),
            "overpressure_end": float(pressures[-1]),
        }

    def _number(self, k: int, name: str) -> list[float] | None:
        """Return the least and the largest strength or time of branch k of all cells; None where it is not known."""
        known = [getattr(each.branches[k - 1], name) for each in self.relaxations if len(each.branches) >= k]
        return _ends(np.array(known)) if known else None

    def _evolution(self, name: str, course: Course, volumes: Array) -> dict[str, Any]:
        lower, upper = self.ends_of(name)
        width = upper - lower
        slack, known = np.where(np.isfinite(width), AT_END * width, 0.0), np.isfinite(course.values[0])
        stopped = [course.values <= lower + slack, course.values >= upper - slack]
        shares = [float(volumes[each[-1]].sum() / volumes[known].sum()) for each in stopped]
        first = np.argwhere(stopped[0] | stopped[1])
        at = None
        if len(first):
            i, element = map(int, first[0])
            centre = self.solution.points[self.solution.cells[element]].mean(axis=0)
            at = {"time": float(self.times[i]), "place": centre.tolist()}
        return {
            "at_first": _ends(course.values[0]),
            "at_end": _ends(course.values[-1]),
            "share_at_lower_end": shares[0],
            "share_at_upper_end": shares[1],
            "first_at_an_end": at,
        }

    def ends_of(self, name: str) -> tuple[Array, Array]:
        """Return the ends of the range of a parameter (elements,); infinite where it has none."""
        cells = self.solution.element_cells
        assert cells is not None
        ends = [
            (each[name].lower, each[name].upper) if name in each else (-np.inf, np.inf)
            for each in self.ranges
        ]
        found = np.array(ends or [(-np.inf, np.inf)] * (1 + len(cells.regions)))[cells.region]
        return found[:, 0], found[:, 1]


def _of_charges(profile: Profile, name: str) -> Array:
    values: Array = profile.internal[name] if name in profile.internal else getattr(profile, name)
    return values


def _size(values: Array) -> Array:
    """Return √(Q:Q) of tensors (n, 3, 3); numbers (n,) as they are."""
    return values if values.ndim == 1 else np.asarray(np.linalg.norm(values, axis=(1, 2)))


def _ends(values: Array) -> list[float]:
    """Return the least and the largest of the finite values, without the round-off of means."""
    known = values[np.isfinite(values)]
    return [float(f"{end:.{MEAN_DIGITS}g}") for end in (known.min(), known.max())]


def _summed(values: Array, volumes: Array) -> list[float]:
    low, high = _ends(values)
    return [low, float(values @ volumes / volumes.sum()), high]


def figures_in_units(figures: dict[str, Any], memory: BodyMemory, units: ResultUnits) -> dict[str, Any]:
    """Return the figures with the units of parameters that evolve; the others are known by their keys."""
    if not units.given or "evolution" not in figures:
        return figures
    courses = memory.courses()

    def with_unit(name: str, key: str, value: Any) -> Any:
        quantity = courses[name].quantity
        if not quantity or key not in ("at_first", "at_end"):
            return value
        in_units = [units.value(each, quantity) for each in value]
        return {"value": in_units, "unit": units.name(quantity), "dimensionless": value}

    evolution = {
        name: {key: with_unit(name, key, value) for key, value in found.items()}
        for name, found in figures["evolution"].items()
    }
    return figures | {"evolution": evolution}


def relaxation_sentence(figures: dict[str, Any]) -> str:
    """Return the overstress in words; empty without a relaxation."""
    branches = figures.get("relaxation", [])
    if not branches:
        return ""
    count = "one branch" if len(branches) == 1 else f"{len(branches)} branches"
    said = f"The solid relaxes by {count}."
    worst = max(branches, key=lambda each: each["overstress_largest"])
    if not worst["overstress_largest"]:
        return f"{said} At the times at which profiles are stored there is no overstress."
    left = [each for each in branches if (each["overstress_left"] or 0.0) >= RELAXED]
    said += (
        " At the times at which profiles are stored, the largest overstress of a branch is "
        f"{measured(worst['overstress_largest'], 'stress', 3)} "
        f"at t = {measured(worst['time_of_largest_overstress'], 'time', 3)}"
    )
    if worst["overstress_left"] == 1:
        return f"{said}, the end."
    said += "."
    if not left:
        return f"{said} At the end, less than {100 * RELAXED:g} % of the overstress is left: the solid has relaxed."
    most = max(left, key=lambda each: each["overstress_end"])
    return (
        f"{said} At the end, the largest is {measured(most['overstress_end'], 'stress', 3)}, "
        f"{percent(most['overstress_left'])} of what was the largest of its branch."
    )


def charges_sentence(figures: dict[str, Any]) -> str:
    """Return osmotic pressure, charge density and swelling in words; empty without charges."""
    found = figures.get("charges")
    if found is None:
        return ""
    said = []
    for name in ("osmotic_pressure", "fixed_charge_density", "swelling_stretch"):
        quantity, plain, _ = OF_CHARGES[name]
        first, last = (
            f"{_between(found[name][i], quantity)} at t = {measured(found['times'][i], 'time', 3)}"
            for i in (0, -1)
        )
        said.append(f"the {plain} is {first} and {last}")
    return f"In the elements of the body, {'; '.join(said)}. The pore pressure is p = μ + π."


def evolution_sentences(figures: dict[str, Any], memory: BodyMemory) -> list[str]:
    """Return each parameter that evolves in words."""
    found, courses = [], memory.courses()
    for name, each in figures.get("evolution", {}).items():
        quantity = courses[name].quantity
        said = f"The parameter {name} evolves: it is {_ends_text(each['at_first'], quantity)} at first and "
        said += f"{_ends_text(each['at_end'], quantity)} at the end."
        at_ends = [
            f"at the {end} end of its range in {percent(share)} of the body"
            for end, share in (("lower", each["share_at_lower_end"]), ("upper", each["share_at_upper_end"]))
            if share
        ]
        if at_ends:
            said += f" Then it stands {' and '.join(at_ends)}, beyond which it does not go."
        if (first := each["first_at_an_end"]) is not None:
            place = ", ".join(in_unit(x, "displacement", 3) for x in first["place"])
            said += (
                f" In the stored profiles, the first element at an end of the range is that at ({place})"
                f"{unit_after('displacement')} at t = {measured(first['time'], 'time', 3)}."
            )
        found.append(said)
    return found


def unit_after(quantity: str) -> str:
    """Return the unit behind a number in a text, with a space; empty without scales."""
    units = units_now()
    return f" {units.name(quantity)}" if units.given else ""


def memory_sentences(memory: BodyMemory) -> list[str]:
    """Return all that the law remembered in words."""
    found = memory.figures()
    said = [relaxation_sentence(found), charges_sentence(found), *evolution_sentences(found, memory)]
    return [each for each in said if each]


def _between(values: Sequence[float], quantity: str) -> str:
    return _ends_text([values[0], values[-1]], quantity)


def _ends_text(ends: Sequence[float], quantity: str) -> str:
    low, high = (in_unit(end, quantity) for end in ends)
    after = unit_after(quantity) if quantity else ""
    return f"{low}{after}" if low == high else f"{low} to {high}{after}"


#: Heads and rows of a table.
Table = tuple[list[str], list[list[str]]]


def memory_tables(memory: BodyMemory) -> dict[str, Table]:
    """Return a table for each kind of memory, by its heading."""
    figures, tables = memory.figures(), dict[str, Table]()
    if branches := figures.get("relaxation"):
        heads = ["branch", "strength", f"time{unit('time')}", f"largest overstress{unit('stress')}"]
        heads += [f"at t{unit('time')}", f"at the end{unit('stress')}", "left"]
        heads += [f"largest overpressure{unit('pressure')}", f"at the end{unit('pressure')}"]
        rows = [
            [
                str(k),
                from_to(np.array(each["strength"] or [])),
                from_to(np.array(each["time"] or []) * units_now().factor("time")),
                in_unit(each["overstress_largest"], "stress", 3),
                in_unit(each["time_of_largest_overstress"], "time", 3),
                in_unit(each["overstress_end"], "stress", 3),
                percent(each["overstress_left"]),
                in_unit(each["overpressure_largest"], "pressure", 3),
                in_unit(each["overpressure_end"], "pressure", 3),
            ]
            for k, each in enumerate(branches, start=1)
        ]
        tables["Overstress"] = heads, rows
    if charges := figures.get("charges"):
        heads = [f"t{unit('time')}", *(f"{plain}{unit(q)}" for q, plain, _ in OF_CHARGES.values())]
        rows = [
            [
                in_unit(time, "time", 3),
                *(_mean_and_ends(charges[name][i], q) for name, (q, *_) in OF_CHARGES.items()),
            ]
            for i, time in enumerate(charges["times"])
        ]
        tables["Fixed charges"] = heads, rows
    if evolution := figures.get("evolution"):
        courses = memory.courses()
        heads = ["parameter", "range", "at first", "at the end", "at the lower end", "at the upper end"]
        rows = []
        for name, each in evolution.items():
            factor = units_now().factor(courses[name].quantity)
            ends = np.unique(np.stack(memory.ends_of(name)))
            rows.append(
                [
                    units_now().titled(name, courses[name].quantity),
                    from_to(ends * factor),
                    *(from_to(np.array(each[key]) * factor) for key in ("at_first", "at_end")),
                    *(percent(each[f"share_at_{end}_end"]) for end in ("lower", "upper")),
                ]
            )
        tables["Parameters that evolve"] = heads, rows
    return tables


def _mean_and_ends(values: Sequence[float], quantity: str) -> str:
    low, mean, high = (in_unit(value, quantity) for value in values)
    return mean if low == high else f"{mean} ({low} to {high})"
