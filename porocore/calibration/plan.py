"""Plan of a calibration (CalibrationPlan): experiments with studies and curves; unknowns."""

from __future__ import annotations

from dataclasses import dataclass, field

from porocore.calibration.config.numbers import StudyNumber
from porocore.calibration.config.settings import FitSettings
from porocore.calibration.observations.curve import ObservedCurve
from porocore.calibration.problem import Unknown
from porocore.core.units.quantities import unit_in_si
from porocore.core.units.scales import QUANTITIES
from porocore.study.config.config import RunConfig


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
    """

    unknown: Unknown
    numbers: dict[str, StudyNumber]

    def dimensionless(self, experiment: Experiment) -> float:
        """Return the factor from values of the unknown to the dimensionless numbers of an experiment."""
        number = self.numbers[experiment.name]
        if not self.unknown.unit:
            return 1.0
        scales = experiment.config.scales
        assert scales is not None
        size = unit_in_si(self.unknown.unit, number.quantity)
        return float(size / QUANTITIES[number.quantity].factor(scales.exact))


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
        Settings of the studies that a family of cells cannot have, and what stands in their place.
    """

    title: str
    experiments: tuple[Experiment, ...]
    unknowns: tuple[PlannedUnknown, ...]
    fit: FitSettings
    notes: tuple[str, ...] = field(default=())

    @property
    def curves(self) -> list[ObservedCurve]:
        """All curves, those of the first experiment first."""
        return [curve for experiment in self.experiments for curve in experiment.curves]
