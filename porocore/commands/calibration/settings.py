"""Models of the section `calibration:`: numbers of a study that may be unknown, experiments, fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
from annotated_types import Ge, Gt
from pydantic import AfterValidator, BeforeValidator, Field, model_validator
from pydantic.fields import FieldInfo

from porocore.cell.family.family import possible_parameters
from porocore.commands.calibration.problem import Scale
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location
from porocore.core.formulas import TimeFunction
from porocore.core.models.bounds import LARGEST_NUMBER, LARGEST_SEED
from porocore.core.models.name import Name
from porocore.core.models.strict import StrictModel, walk
from porocore.core.units import UnitError, dimensions, value_of
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HatFunction
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.axes import as_field
from porocore.macro.composition.fields import Points
from porocore.macro.problem import body_mesh
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig
from porocore.study.sweep.plan import quantities_of

#: Points of one curve at most, and control values of one field.
MOST_POINTS, MOST_CONTROLS = 100_000, 100


def _no_switch(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError(f"expected a number, got {echo(value)}; write a number")
    return value


def _share(value: object) -> object:
    """Return a value that may be a share; one of 1 or more, or with a %, is refused as a percentage."""
    text = str(_no_switch(value)).strip()
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        return value
    if 1 <= number < math.inf or text.endswith("%"):
        raise ValueError(
            f"expected a share of the largest value, between 0 and 1, got {echo(value)}; write {number / 100:g} for "
            f"{number:g} %"
        )
    return value


def _encoding(name: str) -> str:
    try:
        known = bool("1".encode(name))
    except (LookupError, ValueError, TypeError):
        known = False
    if not known:
        raise ValueError(f"expected an encoding such as utf-8, latin-1 or cp850, got {echo(name)}")
    return name


#: A plain number, or a text with a unit, whose quantity another key decides.
Value = Annotated[float | Annotated[str, Field(max_length=120, min_length=1)], BeforeValidator(_no_switch)]
Positive = Annotated[float, Field(gt=0, le=LARGEST_NUMBER)]
Kind = Literal[
    "settlement", "heave", "displacement", "force", "pressure", "pressure_min", "drained", "inflow"
]


class PriorSettings(StrictModel):
    """Prior knowledge of an unknown: a normal distribution."""

    mean: Value
    """Mean of the prior; on a log scale the prior is log-normal, and this is its median."""
    deviation: Value
    """Standard deviation of the prior, in the unit of the mean; on a log scale that of ln x, a plain number such as
    0.2."""


class ControlSettings(StrictModel):
    """Profile of a cell parameter along an axis of the body, given by control values."""

    along: Literal["x", "y", "z"]
    """Axis along which the parameter varies, such as the depth."""
    at: Annotated[tuple[Value, ...], Field(min_length=2, max_length=MOST_CONTROLS)]
    """Coordinates of the control values, in ascending order, as multiples of the study's length or with a unit. The
    parameter is linear between them, and constant outside the first and the last."""
    start: Annotated[tuple[Value, ...], Field(max_length=MOST_CONTROLS)] = ()
    """Start values, one for each coordinate; empty: ``start`` for all of them, or the field of the study."""
    smoothing: Value | None = None
    """Prior standard deviation of the difference between neighbouring control values, in the unit of the values (on a
    log scale that of ln x); null: no smoothing prior."""


class UnknownSettings(StrictModel):
    """One unknown: a number or a profile."""

    of: Name | None = None
    """Number of the study that is fitted: a parameter or another number of the cell, such as ``radius``; ``modulus``
    (of the whole solid); ``viscosity`` (of the fluid); ``pore`` (edge of the cell); ``load``; a boundary value such as
    ``boundary.y+.pressure``; or ``time_shift``, which is added to the times of the data; null: the number with the name
    of the unknown."""
    lower: Value
    """Lower bound of the search."""
    upper: Value
    """Upper bound of the search; a parameter of the cell is sampled between both bounds."""
    start: Value | None = None
    """Start value; null: the value of the study, or the middle of the bounds where that value is not between them."""
    scale: Scale | None = None
    """Coordinate of the search and of the intervals: x (``linear``) or ln x (``log``); null: ``log`` for modulus,
    viscosity and pore, else ``linear``."""
    prior: PriorSettings | None = None
    """Prior of the unknown; null: no prior."""
    field: ControlSettings | None = None
    """Control values along an axis. Each is an unknown with these bounds: ``radius[0]``, ``radius[1]`` and so on; null:
    one value in the whole body."""
    resolution: Value | None = None
    """Limit of identifiability, in the unit of the unknown: the unknown is identifiable if both ends of its 95 %
    interval lie within this distance of its value; null: 10 % of the value, 0.04 for a Poisson's ratio, 9 degrees for
    an angle, and for a ``time_shift`` 10 % of the time from the first datum to the middle one."""
    experiments: tuple[Name, ...] = ()
    """Experiments in which the unknown occurs; empty: all."""


class SyntheticTimes(StrictModel):
    """Times of a synthetic curve."""

    first: Value
    """First time."""
    last: Value
    """Last time."""
    count: Annotated[int, Field(ge=2, le=MOST_POINTS)] = 40
    """Number of times."""
    spacing: Scale = "log"
    """Equal steps of the time (``linear``) or of its logarithm (``log``)."""


class ObservationSettings(StrictModel):
    """One measured curve: a column of a CSV file against a column of times."""

    quantity: Kind
    """Measured quantity: ``settlement`` (largest in the body); ``heave`` (largest displacement along +y);
    ``displacement`` of a probe; ``force`` on a surface (positive in compression, or along an axis with ``component``);
    ``pressure`` (largest in the body, or that of a probe); ``pressure_min`` (smallest in the body, negative under
    suction); ``drained`` volume; ``inflow`` through a surface."""
    surface: Name | None = None
    """Surface of a force or an inflow."""
    probe: Name | None = None
    """Probe of a displacement or a pressure."""
    component: Literal[1, 2, 3] | None = None
    """Component of a displacement or a force."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """CSV file with a line of headings, such as the export of a testing machine. A relative path starts at the folder
    of the configuration."""
    time: Name = "time"
    """Heading of the column of times, without the unit."""
    values: Name | None = None
    """Heading of the column of values, without the unit; null: the only other column, or the one with the name of the
    curve."""
    time_unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the times, or ``mm:ss`` or ``hh:mm`` for clock times; null: the unit in brackets in the heading, or in a
    row of units below the headings; without either the times are dimensionless."""
    unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the values; null: as for ``time_unit``."""
    encoding: Annotated[str, Field(max_length=60), AfterValidator(_encoding)] | None = None
    """Encoding of the file, such as ``cp850``; null: UTF-8 or UTF-16 if the file is valid as such, else Windows-1252
    (which includes Latin-1)."""
    heading_line: Annotated[int, Field(ge=1)] | None = None
    """Number of the line of headings; null: the line that contains the named headings, above numbers."""
    last_line: Annotated[int, Field(ge=1)] | None = None
    """Number of the last line that is read; null: the last line of the file."""
    decimal: Literal[".", ","] | None = None
    """Decimal mark of all numbers; null: it is inferred from the numbers."""
    missing: Annotated[tuple[Annotated[str, Field(max_length=60)], ...], Field(max_length=20)] = ()
    """Texts that mark a missing number, such as ``---`` or ``NaN``. A row with such a text in a column that is read is
    left out."""
    factor: Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)] = 1.0
    """Factor by which the values are multiplied, such as -1 to change the sign."""
    offset: Value = 0.0
    """Reading of the channel at zero, such as the force before contact of the piston, in the unit of the column or with
    its own unit. It is subtracted before the factor is applied."""
    deviation: Value | None = None
    """Standard deviation of each value. Without a unit it is in the unit of the column and is multiplied by the
    absolute value of the factor; with a unit it is that of the quantity."""
    deviation_share: Annotated[float, Field(gt=0, lt=1), BeforeValidator(_share)] | None = None
    """Standard deviation of each value as a share of the largest absolute value of the curve, such as 0.01."""
    deviation_column: Name | None = None
    """Heading of a column of standard deviations, in the unit of the column of values. They are multiplied by the
    absolute value of the factor."""
    weight: Positive = 1.0
    """Weight of each squared residual: the standard deviation is divided by the square root of the weight."""
    weight_column: Name | None = None
    """Heading of a column of weights, one for each value; they multiply ``weight``."""
    since: Value | None = None
    """Values before this time are left out; null: none."""
    until: Value | None = None
    """Values after this time are left out; null: none."""
    times: SyntheticTimes | None = None
    """Times of synthetic data (``--synthetic``), where there is no file."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needs: dict[str, tuple[str, ...]] = {
            "displacement": ("probe", "component"),
            "force": ("surface",),
            "inflow": ("surface",),
        }
        may = {"force": ("component",), "pressure": ("probe",)}
        for key in ("surface", "probe", "component"):
            given = {"surface": self.surface, "probe": self.probe, "component": self.component}[key]
            if given is None and key in needs.get(self.quantity, ()):
                raise ValueError(f"the quantity '{self.quantity}' needs '{key}:'; add it")
            if given is not None and key not in (*needs.get(self.quantity, ()), *may.get(self.quantity, ())):
                raise ValueError(f"the quantity '{self.quantity}' has no '{key}'; remove it")
        if self.factor == 0:
            raise ValueError("a factor of 0 leaves nothing of the values; give another")
        said = (self.deviation, self.deviation_share, self.deviation_column)
        if sum(each is not None for each in said) != 1:
            raise ValueError(
                "expected exactly one of deviation, deviation_share and deviation_column, one of which gives "
                "the standard deviation of the values"
            )
        return self


#: Curves by name.
Observations = Annotated[dict[Name, ObservationSettings], Field(min_length=1)]


class ExperimentSettings(StrictModel):
    """One test: a study under one load, and what was measured in it."""

    study: Annotated[str, Field(min_length=1)] | None = None
    """Configuration of the study; null: the study that contains the section."""
    load: Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)] | None = None
    """Load of the test, in place of ``macro.loads``; null: the only load there."""
    observations: Observations
    """Measured curves by name."""


class FitSettings(StrictModel):
    """Search of the unknowns: starts, evaluations, tolerance."""

    starts: Annotated[int, Field(ge=1, le=100)] = 2
    """Number of searches: the first from the start values, the others from points spread between the bounds."""
    evaluations: Annotated[int, Field(ge=2, le=10_000)] = 60
    """Largest number of evaluations of one search."""
    tolerance: Annotated[float, Field(ge=1e-14, le=1e-2)] = 1e-8
    """Relative tolerance: a search ends if the sum of squares, or the unknowns, change by less than this share."""
    rounds: Annotated[int, Field(ge=0, le=20)] = 3
    """Largest number of rounds of further cells, which are solved if the fitted body leaves the range in which the
    surrogate is trusted."""
    rays: Annotated[int, Field(ge=0, le=360)] = 16
    """Number of rays by which the 95 % region of the two least determined unknowns is found, fewer if neighbouring rays
    agree; 0: no region."""
    seed: Annotated[int, Field(ge=0, le=LARGEST_SEED)] = 0
    """Seed of the noise of synthetic data."""


class PosteriorSettings(StrictModel):
    """Draws from the posterior distribution of the unknowns, by emcee."""

    steps: Annotated[int, Field(ge=100, le=1_000_000)] = 4000
    """Steps of each walker; the first quarter is discarded."""
    walkers: Annotated[int, Field(ge=4, le=10_000)] | None = None
    """Number of walkers, at least twice the number of unknowns; null: four times that number, at least 32."""
    checks: Annotated[int, Field(ge=4, le=1000)] = 24
    """Points in each check of the density by exact runs: half of them are draws, half come from broader densities."""
    seed: Annotated[int, Field(ge=0, le=LARGEST_SEED)] = 0
    """Seed of the random numbers."""

    def walkers_of(self, unknowns: int) -> int:
        """Return the number of walkers for a number of unknowns."""
        return self.walkers or max(32, 4 * unknowns)


class CalibrationSettings(StrictModel):
    """Unknowns of one or more experiments, and the curves that were measured in them."""

    title: str = ""
    """Heading of the report; empty: that of the study."""
    unknowns: Annotated[dict[Name, UnknownSettings], Field(min_length=1, max_length=50)]
    """Numbers that are fitted, by names."""
    observations: Annotated[dict[Name, ObservationSettings], Field(max_length=100)] = Field(default={})
    """Measured curves by name, where there is one experiment: the study in which the section stands."""
    experiments: Annotated[dict[Name, ExperimentSettings], Field(max_length=100)] = Field(default={})
    """Tests by name, where there are several, or in a file of its own."""
    fit: FitSettings = FitSettings()
    """Search of the unknowns."""
    posterior: PosteriorSettings | None = None
    """Settings of the posterior distribution; null: no draws."""

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        if bool(self.observations) == bool(self.experiments):
            raise ValueError(
                "expected either 'observations:' of this study or 'experiments:' with observations of their own; "
                "give one of them"
            )
        return self


NumberKind = Literal["cell", "modulus", "viscosity", "pore", "load", "boundary", "time_shift"]
#: Numbers with a name of their own, with their quantities.
OWN: dict[NumberKind, str] = {
    "modulus": "stress",
    "viscosity": "viscosity",
    "pore": "pore-size",
    "load": "",
    "time_shift": "time",
}
#: Unknown numbers by which a load may have either sign, and any size.
OF_LOAD: tuple[NumberKind, ...] = ("load", "boundary")
#: Those that are above 0, whose search is in ln x unless something else is said.
POSITIVE: tuple[NumberKind, ...] = ("modulus", "viscosity", "pore")
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
        Name of a parameter of the cell, or ``boundary.SURFACE.KEY``; else the kind.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; empty for a plain number.
    value
        That of the study, dimensionless.
    path
        Keys below ``macro`` of a value on the boundary.
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
    def is_positive(self) -> bool:
        """True for a modulus, a viscosity or an edge, searched in ln x unless something else is said."""
        return self.kind in POSITIVE


def study_number(text: str, config: RunConfig, load: float) -> StudyNumber:
    """Return the number of a study that a text names.

    Parameters
    ----------
    text
        Such as ``radius``, ``modulus``, ``load`` or ``boundary.y+.pressure``.
    config, load
        The study and its load.

    Raises
    ------
    ConfigurationError
        There is no such number; similar ones are proposed.
    """
    cell = _cell_numbers(config)
    own = {
        "modulus": 1.0,
        "viscosity": config.cell.viscosity,
        "pore": 1.0,
        "load": load,
        "time_shift": 0.0,
    }
    boundary = _boundary_numbers(config.macro)
    for kind, quantity in OWN.items():
        if text == kind and not (kind == "viscosity" and _is_range(config, kind)):
            return StudyNumber(kind, text, quantity, own[kind])
    if text in cell:
        _require_one_value(text, config)
        return cell[text]
    if text in boundary:
        return boundary[text]
    names = [*(name for name in cell if name not in own), *own, *boundary]
    raise ConfigurationError(
        f"expected a number of the study, got {echo(text)}; {suggestion(text, names, 'the numbers are')}"
    )


def field_number(text: str, config: RunConfig) -> StudyNumber:
    """Return the parameter of the cell that a text names, which may differ within the body.

    Raises
    ------
    ConfigurationError
        There is no such parameter, or a region has its own value.
    """
    cell = _cell_numbers(config)
    if text not in cell:
        raise ConfigurationError(
            f"expected a parameter of the cell, which alone may be a field over the body, got {echo(text)}; "
            f"{suggestion(text, cell, 'the parameters are')}"
        )
    _require_no_regions(text, config)
    return cell[text]


def _is_range(config: RunConfig, name: str) -> bool:
    return any(parameter.name == name for parameter in config.cell.parameters)


def _cell_numbers(config: RunConfig) -> dict[str, StudyNumber]:
    """Return the numbers of the cell that may be parameters, with the values that the body has."""
    quantities = quantities_of(config.cell)
    base = {parameter.name: parameter.base for parameter in config.cell.parameters}
    own = {place.path: place.value for place in walk(type(config.cell), config.cell)}
    found = {}
    for path, name in possible_parameters(config.cell).items():
        given = config.macro.fields.get(name)
        value = float(given) if isinstance(given, float | int) else base.get(name, own[path])
        found[name] = StudyNumber("cell", name, quantities.get(name, ""), value)
    return found


def declared_positive(name: str, config: RunConfig) -> bool:
    """Return whether a parameter of the cell is declared to be above 0, as a radius is and a Poisson's ratio is not."""
    paths = {own: path for path, own in possible_parameters(config.cell).items()}
    place = next(each for each in walk(type(config.cell), config.cell) if each.path == paths[name])
    declared = [each.metadata if isinstance(each, FieldInfo) else [each] for each in place.metadata]
    zero: Any = 0.0  # the package declares no type of its limits that compares with a number
    return any(
        (isinstance(each, Gt) and each.gt >= zero) or (isinstance(each, Ge) and each.ge > zero)
        for each in chain.from_iterable(declared)
    )


def _require_one_value(name: str, config: RunConfig) -> None:
    """Refuse a parameter of the cell that differs within the body.

    Raises
    ------
    ConfigurationError
        It is a field, or has values of their own in regions.
    """
    given = config.macro.fields.get(name)
    if given is not None and not isinstance(given, float | int):
        raise ConfigurationError(
            f"{echo(name)} is a field over the body, which is no number; give a number in macro.fields.{name}, or "
            "'field:' with the coordinates of its control values"
        )
    _require_no_regions(name, config)


def _require_no_regions(name: str, config: RunConfig) -> None:
    """Refuse a parameter of the cell that has values of its own in regions."""
    for region, settings in config.macro.regions.items():
        if name in settings.fields:
            raise ConfigurationError(
                f"{echo(name)} has a value of its own in the region '{region}'; remove it there to fit that of the body"
            )


def _boundary_numbers(macro: MacroSettings) -> Mapping[str, StudyNumber]:
    """Return the prescribed numbers other than 0 by names such as ``boundary.y+.traction.y``."""
    found = {}
    for place, dimension in dimensions(type(macro), macro):
        value, path = place.value, place.path
        if path[:1] != ("boundary",) or isinstance(value, bool) or not isinstance(value, float) or value == 0:
            continue
        if place.above is not None and isinstance(place.above.value, TimeFunction) and path[-1] != "ramp":
            continue
        if "table" in path:
            continue
        quantity = "" if dimension is None else dimension.quantity
        words = [AXES[int(part)] if part.isdigit() and part in "012" else part for part in path[2:]]
        name = ".".join((*path[:2], *words))
        found[name] = StudyNumber("boundary", name, quantity, value, path)
    return found


def control_numbers(number: StudyNumber, given: ControlSettings, config: RunConfig) -> list[StudyNumber]:
    """Return the control values of a field as numbers of a study, with the values that the study has there.

    Parameters
    ----------
    number
        The parameter of the cell.
    given
        Axis and coordinates.
    config
        The study.

    Raises
    ------
    ConfigurationError
        The coordinates do not ascend, a control value concerns no point of the body, or the field of the study changes
        with time.
    """
    axis = AXES.index(given.along)
    places, mesh = _places(given, config), body_mesh(config.macro)
    hats = [HatFunction(axis, places, i) for i in range(len(places))]
    _require_points(given, hats, mesh)
    values = _values_of_study(number, hats, mesh, config)
    return [replace(number, hat=hat, value=float(value)) for hat, value in zip(hats, values, strict=True)]


def _places(given: ControlSettings, config: RunConfig) -> tuple[float, ...]:
    """Return the coordinates of the control values, dimensionless."""
    try:
        found = tuple(
            value_of(each, "displacement", config.scales) if isinstance(each, str) else each
            for each in given.at
        )
    except UnitError as error:
        raise ConfigurationError(f"field.at: {error}") from None
    for k, (one, other) in enumerate(pairwise(found)):
        if not one < other:
            raise ConfigurationError(
                f"field.at: expected ascending coordinates, got {_text(given.at[k])} before {_text(given.at[k + 1])}"
            )
    return found


def _text(coordinate: float | str) -> str:
    return echo(coordinate) if isinstance(coordinate, str) else f"{coordinate:g}"


def _require_points(given: ControlSettings, hats: list[HatFunction], mesh: BodyMesh) -> None:
    """Refuse a control value that holds at no point of the body."""
    points = mesh.quadrature_points.reshape(-1, 3)
    for hat, told in zip(hats, given.at, strict=True):
        if not hat.values(points).any():
            along = mesh.points[:, hat.axis]
            raise ConfigurationError(
                f"field.at: no point of the body has the value at {_text(told)}; the body reaches from "
                f"{along.min():.6g} to {along.max():.6g} along {given.along}, dimensionless, and each value needs an "
                "element beside it; give fewer coordinates, or others"
            )


def _values_of_study(
    number: StudyNumber, hats: list[HatFunction], mesh: BodyMesh, config: RunConfig
) -> Array:
    """Return the values at the control places, of a field of the study those along a line through the body's middle."""
    own = config.macro.fields.get(number.name)
    if own is None or isinstance(own, float | int):
        return np.full(len(hats), number.value)
    key, field = f"macro.fields.{number.name}", as_field(own)
    if field.varies:
        raise ConfigurationError(
            f"field: {key} changes with time, which the fitted field would not; remove it, or give numbers"
        )
    middle = (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2
    line = np.tile(middle, (len(hats), 1))
    line[:, hats[0].axis] = hats[0].places
    return field.reached(Points(line, line, np.arange(len(line))), 0.0, key)
