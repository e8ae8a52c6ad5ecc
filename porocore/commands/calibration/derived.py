"""Physical numbers that follow from a calibration, such as H_A and the permeability (DerivedCell)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.commands.calibration.cells import CellAtRest
from porocore.commands.calibration.entries import derived_intervals
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.profiles import IntervalEnd
from porocore.core.units import ResultUnits, pretty
from porocore.macro.laws.linear import SAME, EffectiveProperties
from porocore.states import Array

#: How the intervals are found, for reports and files.
METHOD = (
    "delta method: the covariance of the fit, priors counted, and the slopes of the learned cell at rest by the "
    "unknowns; in the logarithm, but for porosity and Poisson's ratios"
)
#: A conductivity below this share of the largest along another axis is none.
NONE = 1e-9
#: SI units of quantities whose values papers print in these.
_SI = {"conductivity": "m⁴/(N s)", "permeability": "m²", "diffusivity": "m²/s"}
_AXES, _PLANES = ("x", "y", "z"), ("yz", "xz", "xy")
_PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)


@dataclass(frozen=True, eq=False)
class DerivedNumber:
    """A number that follows from the unknowns, at the best point.

    Attributes
    ----------
    name
        Key in files, such as ``aggregate_modulus``, with ``_x`` where it differs from axis to axis.
    words
        Name for a reader.
    unit
        Of the numbers; empty for a dimensionless one.
    value
        At the best point.
    low, high
        Ends of the 95 % interval.
    """

    name: str
    words: str
    unit: str
    value: float
    low: IntervalEnd
    high: IntervalEnd

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Both ends; None where the data set none."""
        return self.low.value, self.high.value


@dataclass(frozen=True, eq=False)
class DerivedCell:
    """Numbers of the fitted undeformed cell of some experiments.

    Attributes
    ----------
    experiments
        Their names; the only one of a study has none.
    place
        Coordinate of the body where a parameter is fitted as a field; else empty.
    numbers
        The numbers.
    """

    experiments: tuple[str, ...]
    place: str
    numbers: tuple[DerivedNumber, ...]

    @property
    def values(self) -> dict[str, float]:
        """Values by name."""
        return {each.name: each.value for each in self.numbers}

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """95 % intervals by name."""
        return {each.name: each.interval for each in self.numbers}

    @property
    def title(self) -> str:
        """Experiments and place in words; empty where there is one cell alone."""
        return ", ".join(text for text in (" and ".join(filter(None, self.experiments)), self.place) if text)

    def entries(self) -> dict[str, Any]:
        """Return what a JSON file holds."""
        numbers = {
            each.name: {
                "value": each.value,
                "unit": each.unit,
                "interval95": list(each.interval),
                "open_ends": {
                    side: end.reason
                    for side, end in (("low", each.low), ("high", each.high))
                    if end.value is None
                },
            }
            for each in self.numbers
        }
        return {"experiments": list(filter(None, self.experiments)), "place": self.place, "numbers": numbers}


@dataclass(frozen=True, eq=False)
class _Kind:
    """Numbers of one kind: key, words, quantity, and the value along each axis, in each plane or by each pair."""

    name: str
    words: str
    quantity: str
    along: tuple[str, ...]
    values: Array


def derived_cells(inference: Inference, cells: Sequence[CellAtRest]) -> tuple[DerivedCell, ...]:
    """Return the derived numbers of the undeformed cells at the best point of a fit."""
    return tuple(DerivedCell(each.experiments, each.place, _numbers(inference, each)) for each in cells)


def _kinds(found: EffectiveProperties) -> Iterator[_Kind]:
    """Yield the numbers of an undeformed cell, dimensionless."""
    confined, K = found.confined_moduli, np.diag(found.conductivity)
    yield _Kind("porosity", "porosity φ_f", "", ("",), np.array([found.porosity]))
    yield _Kind("aggregate_modulus", "aggregate modulus H_A", "stress", _AXES, confined)
    yield _Kind("young_modulus", "Young’s modulus E, drained", "stress", _AXES, found.young_moduli)
    ratios = np.array([found.poisson_ratios[pair] for pair in _PAIRS])
    pairs = tuple(_AXES[i] + _AXES[j] for i, j in _PAIRS)
    yield _Kind("poisson_ratio", "Poisson’s ratio ν, drained", "", pairs, ratios)
    yield _Kind("shear_modulus", "shear modulus G", "stress", _PLANES, found.shear_moduli)
    yield _Kind("hydraulic_permeability", "hydraulic permeability K", "conductivity", _AXES, K)
    k = np.diag(found.permeability)
    yield _Kind("intrinsic_permeability", "intrinsic permeability k = K μ_f", "permeability", _AXES, k)
    c_v = found.consolidation_coefficients
    yield _Kind("consolidation_coefficient", "consolidation coefficient c_v", "diffusivity", _AXES, c_v)
    words = "H_A K, which is c_v if solid and fluid are incompressible"
    yield _Kind("aggregate_modulus_times_permeability", words, "diffusivity", _AXES, confined * K)


def _numbers(inference: Inference, cell: CellAtRest) -> tuple[DerivedNumber, ...]:
    """Return the numbers of one cell in their units; those that are the same along all axes once."""
    shown: dict[str, tuple[str, str, float]] = {}
    places: dict[str, tuple[int, int]] = {}
    for k, kind in enumerate(_kinds(cell.of(inference.values))):
        unit, factor = _unit(cell.units, kind.quantity)
        largest = float(np.abs(kind.values).max())
        one = float(np.ptp(kind.values)) <= SAME * largest
        for i, along in enumerate(kind.along[:1] if one else kind.along):
            if kind.quantity and abs(kind.values[i]) <= NONE * largest:
                continue
            name = kind.name if one else f"{kind.name}_{along}"
            shown[name] = (kind.words if one else f"{kind.words}, {along}", unit, factor)
            places[name] = (k, i)

    def numbers(values: Array) -> dict[str, float]:
        kinds = list(_kinds(cell.of(values)))
        return {name: shown[name][2] * float(kinds[k].values[i]) for name, (k, i) in places.items()}

    found = derived_intervals(inference, numbers, _is_plain)
    return tuple(DerivedNumber(name, words, unit, *found[name]) for name, (words, unit, _) in shown.items())


def _is_plain(name: str) -> bool:
    """Tell whether a number need not be positive, or is a share."""
    return name.startswith(("porosity", "poisson_ratio"))


def _unit(units: ResultUnits, quantity: str) -> tuple[str, float]:
    """Return the unit of a quantity and the factor of dimensionless numbers."""
    if not quantity or units.scales is None:
        return "", 1.0
    if quantity in _SI:
        return _SI[quantity], units.scales.factor(quantity)
    return pretty(units.name(quantity)), units.factor(quantity)
