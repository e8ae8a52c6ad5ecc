"""Plan of a calibration (CalibrationPlan): experiments, unknowns and the numbers of studies that they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from porocore.commands.calibration.observations import ObservedCurve
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.settings import FitSettings, PosteriorSettings
from porocore.commands.calibration.suggestions import IdentifiabilityRule
from porocore.core.files.claim import WorkFolder
from porocore.core.files.yaml_document import Location
from porocore.core.units import QUANTITIES, pretty, unit_in_si
from porocore.interfaces.sensitivities import HatFunction
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig

NumberKind = Literal[
    "cell",
    "modulus",
    "viscosity",
    "pore",
    "load",
    "boundary",
    "indenter",
    "law",
    "law_field",
    "time_shift",
    "camera",
]
#: Unknown numbers by which a load may have either sign, and any size.
OF_LOAD: tuple[NumberKind, ...] = ("load", "boundary")
#: Those by which the units of a run are multiplied: they are above 0, and searched in ln x by default.
OF_SCALES: tuple[NumberKind, ...] = ("modulus", "viscosity", "pore")
#: Names of the coordinates, in order.
AXES: tuple[Literal["x"], Literal["y"], Literal["z"]] = ("x", "y", "z")


@dataclass(frozen=True)
class StudyNumber:
    """A number of a study.

    Attributes
    ----------
    kind
        What it is.
    name
        Name of a parameter of the cell or of the law of the body, ``boundary.SURFACE.KEY`` or
        ``contact.INDENTER.KEY``; else the kind.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; empty for a plain number.
    value
        That of the study, dimensionless; of a ``law_field`` 1, since the number is the factor of a field.
    path
        Keys below ``macro`` of a value on the boundary or of an indenter; cloud and part of the place of a camera.
    hat
        Of a control value of a parameter's field; None: the number holds everywhere.
    """

    kind: NumberKind
    name: str
    quantity: str
    value: float
    path: Location = ()
    hat: HatFunction | None = None

    @property
    def is_scale(self) -> bool:
        """True for a modulus, a viscosity or an edge, by which the units of a run are multiplied."""
        return self.kind in OF_SCALES


def with_indenter(macro: MacroSettings, number: StudyNumber, value: float) -> MacroSettings:
    """Return a body with another radius of an indenter, or its place moved along its direction by ``value``."""
    _, name, key = number.path
    indenter = macro.contact[name]
    if key == "offset":
        place = tuple(float(x) for x in np.array(indenter.place) + value * indenter.along)
        indenter = indenter.model_copy(update={"place": place})
    else:
        shape = indenter.shape.model_copy(update={"radius": value})
        indenter = indenter.model_copy(update={"shape": shape})
    return macro.model_copy(update={"contact": {**macro.contact, name: indenter}})


@dataclass(frozen=True, eq=False)
class Experiment:
    """One test: its study, load and curves.

    Attributes
    ----------
    name
        Empty where there is one alone.
    config
        Study of the family of its cells.
    load
        Its load.
    curves
        What was measured, or will be.
    """

    name: str
    config: RunConfig
    load: float
    curves: tuple[ObservedCurve, ...]


@dataclass(frozen=True, eq=False)
class PlannedUnknown:
    """An unknown, and the number that it is in each experiment.

    Attributes
    ----------
    unknown
        Name, bounds, start, scale, prior, unit.
    numbers
        The number by the name of the experiment; experiments that it does not belong to are left out.
    resolution
        Distance of the ends of its interval from its value with which it is identifiable, in its unit; None: by the
        rule.
    """

    unknown: Unknown
    numbers: dict[str, StudyNumber]
    resolution: float | None = None

    def dimensionless(self, experiment: Experiment) -> float:
        """Return the factor from values of the unknown to the dimensionless numbers of an experiment."""
        number = self.numbers[experiment.name]
        # Angles of a camera are in degrees everywhere.
        if not self.unknown.unit or not number.quantity:
            return 1.0
        scales = experiment.config.scales
        assert scales is not None
        size = unit_in_si(self.unknown.unit, number.quantity)
        return float(size / QUANTITIES[number.quantity].factor(scales.exact))


@dataclass(frozen=True)
class Occurrence:
    """Unknown in one experiment.

    Attributes
    ----------
    index
        Position of the unknown among all.
    number
        The number of the study that it is.
    factor
        A value of the unknown times it is the dimensionless number.
    """

    index: int
    number: StudyNumber
    factor: float

    def value(self, values: Array) -> float:
        """Return the dimensionless number for values (k,) of all unknowns."""
        return float(values[self.index]) * self.factor


def occurrences(unknowns: Sequence[PlannedUnknown], experiment: Experiment) -> list[Occurrence]:
    """Return the unknowns that occur in an experiment."""
    return [
        Occurrence(i, each.numbers[experiment.name], each.dimensionless(experiment))
        for i, each in enumerate(unknowns)
        if experiment.name in each.numbers
    ]


@dataclass(frozen=True)
class FittedField:
    """Field of a parameter whose control values are unknowns.

    Attributes
    ----------
    name
        Of the unknown in the configuration.
    lines
        Coordinates of the control values by their axes ``x``, ``y`` or ``z``, in the order of these.
    unit
        Of the coordinates; empty for dimensionless ones.
    members
        Positions of the control values among the unknowns, the first axis running fastest.
    """

    name: str
    lines: Mapping[str, tuple[float, ...]]
    unit: str
    members: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class CalibrationPlan:
    """Experiments and unknowns of a calibration.

    Attributes
    ----------
    title
        Heading of the report.
    experiments, unknowns
        In the order of the configuration.
    fit
        Settings of the search.
    notes
        Settings of the studies that a family of cells cannot have, with what stands in their place, and what was done
        to the rows of files.
    posterior
        Settings of the draws from the posterior distribution; None: there are none.
    documents
        Name and text of each configuration that was read, that of the calibration first.
    """

    title: str
    experiments: tuple[Experiment, ...]
    unknowns: tuple[PlannedUnknown, ...]
    fit: FitSettings
    notes: tuple[str, ...] = field(default=())
    posterior: PosteriorSettings | None = None
    documents: tuple[tuple[str, str], ...] = ()

    @property
    def fields(self) -> tuple[FittedField, ...]:
        """Fields among the unknowns, with coordinates of the first experiment that each belongs to."""
        members: dict[str, list[int]] = {}
        for i, each in enumerate(self.unknowns):
            if next(iter(each.numbers.values())).hat is not None:
                members.setdefault(each.unknown.name.rpartition("[")[0], []).append(i)
        return tuple(self._field(name, found) for name, found in members.items())

    def _field(self, name: str, members: list[int]) -> FittedField:
        experiment, number = next(iter(self.unknowns[members[0]].numbers.items()))
        assert number.hat is not None
        units = next(each.config.result_units for each in self.experiments if each.name == experiment)
        factor = units.factor("displacement")
        lines: dict[str, tuple[float, ...]] = {
            AXES[axis]: tuple(factor * place for place in line)
            for axis, line in zip(number.hat.axes, number.hat.places, strict=True)
        }
        unit = units.name("displacement") if units.given else ""
        return FittedField(name, lines, unit, tuple(members))

    @property
    def rule(self) -> IdentifiabilityRule:
        """Rule by which the unknowns are identifiable."""
        plain = IdentifiabilityRule()
        found = {each.unknown.name: self._resolution(each, plain) for each in self.unknowns}
        return IdentifiabilityRule(distances={name: x for name, x in found.items() if x is not None})

    def _resolution(self, each: PlannedUnknown, rule: IdentifiabilityRule) -> float | None:
        """Return the distance for an unknown whose value is no scale for it, in its unit; None: its value is one.

        A clock is read against the times of the data, half of which lie before the middle one. The length of the test
        would say less: many end with a long rest, in which the clock does not matter.
        """
        number = next(iter(each.numbers.values()))
        if each.resolution is not None:
            return each.resolution
        if number.kind == "time_shift":
            middles = [
                float(np.median(curve.times) - curve.times[0]) / each.dimensionless(experiment)
                for experiment in self.experiments
                if experiment.name in each.numbers
                for curve in experiment.curves
            ]
            return rule.relative * min(middles) or None
        return rule.without_scale(number.name) if each.unknown.scale == "linear" else None

    @property
    def curves(self) -> list[ObservedCurve]:
        """All curves, those of the first experiment first."""
        return [curve for experiment in self.experiments for curve in experiment.curves]

    @property
    def is_planned(self) -> bool:
        """True where a curve has no values yet."""
        return any(curve.measured is None for curve in self.curves)

    @property
    def section(self) -> list[str]:
        """The outline below its heading, as a part of the outline of a study."""
        return ["calibration:", *(f"  {line}" for line in self.outline)]

    @property
    def outline(self) -> list[str]:
        """A line for each unknown, curve and note."""
        unknowns = [
            f"unknown {one.name} from {one.lower:.5g} to {one.upper:.5g} {pretty(one.unit)}".rstrip()
            for one in (each.unknown for each in self.unknowns)
        ]
        curves = [f"{curve.name}: {curve.outline}" for curve in self.curves]
        return [*unknowns, *curves, *(f"note: {note}" for note in self.notes)]


RECORD = "calibrate.json"


class CalibrationFolder(WorkFolder):
    """Folder of one calibration."""

    record, work, version = RECORD, "calibration", 3
