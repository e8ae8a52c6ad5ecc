"""Records of what the page of a calibration shows (CalibrationContents): results, axes, facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from porocore.commands.calibration.derived import DerivedCell
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import CalibrationPlan, FittedField
from porocore.commands.calibration.posterior import Posterior
from porocore.commands.calibration.problem import CurveData, Unknown
from porocore.core.units import pretty
from porocore.report.figures.style import named
from porocore.states import Array, IntArray


@dataclass(frozen=True)
class CurveAxes:
    """Words and units of one measured curve.

    Attributes
    ----------
    label
        Of the values, such as ``settlement``; empty: the name of the curve.
    unit, time_unit
        Of the numbers in the data; empty for dimensionless ones.
    """

    label: str = ""
    unit: str = ""
    time_unit: str = ""


@dataclass(frozen=True, eq=False)
class CalibrationContents:
    """Everything that the page shows.

    Attributes
    ----------
    title
        Heading.
    data
        Measured curves.
    inference
        What they say.
    axes
        Of the curves, one each; empty: dimensionless ones.
    truth : (k,)
        Values of the unknowns with which data were made up; None: they were measured.
    facts
        Rows of name and value, such as the number of cell solves.
    warnings
        Sentences at the top.
    fields
        Fields among the unknowns.
    posterior
        Draws from the posterior distribution; None: not shown.
    derived
        Physical numbers of the fitted undeformed cells.
    plan
        Bounds, priors, data and configurations; None: not shown.
    versions
        Of porocore, its plugins and packages.
    """

    title: str
    data: CurveData
    inference: Inference
    axes: tuple[CurveAxes, ...] = ()
    truth: Array | None = None
    facts: tuple[tuple[str, str], ...] = ()
    warnings: tuple[str, ...] = ()
    fields: tuple[FittedField, ...] = ()
    posterior: Posterior | None = None
    derived: tuple[DerivedCell, ...] = ()
    plan: CalibrationPlan | None = None
    versions: Mapping[str, str] = field(default_factory=dict)

    def curve_axes(self, curve: int) -> CurveAxes:
        """Return the axes of a curve."""
        return self.axes[curve] if self.axes else CurveAxes()

    def rows_of(self, curve: int) -> IntArray:
        """Return the rows of a curve in the data, in the order of time."""
        rows = np.flatnonzero(self.data.curve == curve)
        return np.asarray(rows[np.argsort(self.data.times[rows], kind="stable")])


def labelled(name: str, unit: str) -> str:
    """Return the label of an axis: a name without underscores, and the unit in brackets; a dash without one."""
    return f"{named(name.replace('_', ' '))} [{pretty(unit) or '–'}]"


def unknown_label(unknown: Unknown) -> str:
    """Return the label of the axis of an unknown."""
    return labelled(unknown.name, unknown.unit)


def values_at(unknown: Unknown, coordinates: Array) -> Array:
    """Return the values (n,) of an unknown at coordinates (n,)."""
    return np.array([unknown.value(float(x)) for x in coordinates])
