"""Models of the section `calibration:`: unknowns, observations, experiments, fit, posterior."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from porocore.commands.calibration.problem import Scale
from porocore.core.echo import echo
from porocore.core.models.bounds import LARGEST_NUMBER, LARGEST_SEED
from porocore.core.models.name import Name
from porocore.core.models.strict import StrictModel

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
GridCount = Annotated[int, Field(ge=1, le=1000)]
Kind = Literal[
    "settlement",
    "heave",
    "displacement",
    "force",
    "pressure",
    "pressure_min",
    "drained",
    "inflow",
    "contact_radius",
    "contact_area",
]


class PriorSettings(StrictModel):
    """Prior knowledge of an unknown: a normal distribution."""

    mean: Value
    """Mean of the prior; on a log scale the prior is log-normal, and this is its median."""
    deviation: Value
    """Standard deviation of the prior, in the unit of the mean; on a log scale that of ln x, a plain number such as
    0.2."""


Axis = Literal["x", "y", "z"]
Line = Annotated[tuple[Value, ...], Field(min_length=2, max_length=MOST_CONTROLS)]


class ControlSettings(StrictModel):
    """Field of a cell parameter over the body, given by control values along an axis or on a grid."""

    along: Axis | None = None
    """Axis along which the parameter varies, such as the depth."""
    at: Line | None = None
    """Coordinates of the control values, in ascending order, as multiples of the study's length or with a unit. The
    parameter is linear between them, and constant outside the first and the last."""
    grid: Annotated[dict[Axis, Line], Field(max_length=3)] = Field(default={})
    """Coordinates of a grid of control values along two or three axes, in place of ``along`` and ``at``. The parameter
    is multilinear between them. The first axis runs fastest."""
    start: Annotated[tuple[Value, ...], Field(max_length=MOST_CONTROLS)] = ()
    """Start values, one for each control value; empty: ``start`` for all of them, or the field of the study."""
    smoothing: Value | None = None
    """Prior standard deviation of the difference between neighbouring control values, in the unit of the values (on a
    log scale that of ln x); null: no smoothing prior."""

    @property
    def lines(self) -> dict[Axis, tuple[float | str, ...]]:
        """Coordinates of the control values by their axes, in the order of these."""
        if self.along is not None and self.at is not None:
            return {self.along: self.at}
        return {axis: self.grid[axis] for axis in get_args(Axis) if axis in self.grid}

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.along is None) != (self.at is None):
            raise ValueError("along and at belong together: the axis and the coordinates; add the other")
        if (self.along is None) == (not self.grid):
            raise ValueError("expected either along and at, or a grid of coordinates; give one of them")
        if math.prod(map(len, self.lines.values())) > MOST_CONTROLS:
            raise ValueError(f"grid: expected at most {MOST_CONTROLS} control values; give fewer coordinates")
        return self


class UnknownSettings(StrictModel):
    """One unknown: a number or a profile."""

    of: Name | None = None
    """The number in the study that this unknown fits: a parameter or another number of the cell, such as ``radius``;
    ``modulus`` (of the whole solid); ``viscosity`` (of the fluid); ``pore`` (edge of the cell); ``load``; a boundary
    value such as ``boundary.y+.pressure``; a number of an indenter such as ``contact.ball.radius``; one of the
    relaxation, the fixed charges or the evolution, such as ``relaxation.1.time``, ``charges.density`` or
    ``evolution.radius.k``; or ``time_shift``, which is added to the times of the data; null: the number that has the
    name of the unknown."""
    lower: Value
    """Lower bound of the search."""
    upper: Value
    """Upper bound of the search; a parameter of the cell is sampled between both bounds."""
    start: Value | None = None
    """Start value; null: the value of the study, or the middle of the bounds where that value is not between them."""
    scale: Scale | None = None
    """Coordinate of the search and of the intervals: x (``linear``) or ln x (``log``); null: ``log`` for modulus,
    viscosity, pore and times of the relaxation, else ``linear``."""
    prior: PriorSettings | None = None
    """Prior of the unknown; null: no prior."""
    field: ControlSettings | None = None
    """Control values along an axis or on a grid. Each is an unknown with these bounds: ``radius[0]``, ``radius[1]`` and
    so on; null: one value in the whole body."""
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
    ``displacement`` of a probe, or of an indenter along its direction; ``force`` on a surface (positive in compression;
    with ``component``: the force along this axis, positive in its direction), or of an indenter along its direction;
    ``pressure`` (largest in the body, or that of a probe); ``pressure_min`` (smallest in the body, negative under
    suction); ``drained`` volume; ``inflow`` through a surface; ``contact_radius`` and ``contact_area`` of an indenter
    (of the undeformed surface that it touches)."""
    surface: Name | None = None
    """Surface of a force or an inflow."""
    indenter: Name | None = None
    """Indenter of a force, a displacement, a contact radius or a contact area, by its name in ``macro.contact``."""
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
    row of units below the headings; if there is neither of these, the times are
    dimensionless."""
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
    """Texts that mark a missing number, such as ``---`` or ``NaN``. If one of the columns that are read has such a text
    in a row, this row is left out."""
    factor: Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)] = 1.0
    """Factor by which the values are multiplied, such as -1 to change the sign."""
    offset: Value = 0.0
    """Reading of the channel at zero, such as the force before contact of the piston, in the unit of the column or with
    its own unit. It is subtracted before the factor is applied."""
    deviation: Value | None = None
    """Standard deviation of each value. Without a unit it is in the unit of the column and is multiplied by the
    absolute value of the factor. With a unit it is the standard deviation of the quantity after the factor is
    applied."""
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
            "contact_radius": ("indenter",),
            "contact_area": ("indenter",),
        }
        may = {"force": ("component",), "pressure": ("probe",)}
        if self.indenter is not None and self.quantity in ("force", "displacement"):
            needs, may = {self.quantity: ("indenter",)}, {}
        for key in ("surface", "probe", "component", "indenter"):
            given = getattr(self, key)
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


#: Components of a measured field, and all columns that its files may have.
Component = Literal["u1", "u2", "u3", "p"]
Column = Literal[
    "x", "y", "z", "t", "u1", "u2", "u3", "p", "u1_deviation", "u2_deviation", "u3_deviation", "p_deviation"
]
Degrees = Annotated[float, Field(ge=-360, le=360)]


class CameraSettings(StrictModel):
    """Place of a camera: x = offset + R x' and u = R u', with places x' and displacements u' along its own axes."""

    offset: tuple[Value, Value, Value] = (0.0, 0.0, 0.0)
    """Place of the origin of the camera's axes in the body, in the unit of the places or with a unit of its own."""
    rotation: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    """Rotation vector from the camera's axes to those of the body, in degrees: its direction is the axis, its length
    the angle. ``[0, 0, 90]`` turns the camera's x axis to y."""
    unknown: Annotated[tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...], Field(max_length=6)] = ()
    """Parts of the place that are unknowns beside the given ones: further offsets along x, y and z, and angles of a
    further rotation about the axes of the body through the mean of the points, in degrees."""
    offset_bound: Value | None = None
    """Largest size of an unknown offset, in the unit of the places or with a unit of its own; null: a tenth of the
    largest edge of the body."""
    rotation_bound: Annotated[float, Field(gt=0, le=90)] = 10.0
    """Largest size of an unknown angle in degrees."""


class PointsSettings(StrictModel):
    """Measured fields: displacements or pressures at many points, such as those of a filmed test."""

    file: Annotated[str, Field(min_length=1)] | None = None
    """CSV file with a line of headings, VTU file or NPZ file with places, times and values; or a pattern such as
    ``frames/*.csv`` of files of one time each. A relative path starts at the folder of the configuration."""
    columns: dict[Column, Annotated[str, Field(min_length=1, max_length=200)]] = Field(default={})
    """Heading, or name in the file, of a column or of a component such as ``disp[0]``, by the name here: ``x``, ``y``,
    ``z`` (place), ``t`` (time), ``u1``, ``u2``, ``u3`` (displacement), ``p`` (pressure), and ``u1_deviation``, …,
    ``p_deviation`` (standard deviations). Columns that have these names need no entry."""
    quantities: Annotated[tuple[Component, ...], Field(max_length=4)] = ()
    """Components that are fitted; empty: all in the file."""
    frames: Annotated[tuple[Value, ...], Field(max_length=MOST_POINTS)] = ()
    """Times of the files of a pattern, in the order of their names; or the only one of a single file."""
    fixed: dict[Axis, Value] = Field(default={})
    """Coordinates that all points have, such as ``{z: 0}`` for a film of that plane."""
    unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the places; null: that in the headings of the CSV file; if there is none, places are dimensionless."""
    displacement_unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the displacements; null: that in the headings; if there is none, that of the places."""
    pressure_unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the pressures; null: that in the heading; if there is none, pressures are dimensionless."""
    time_unit: Annotated[str, Field(max_length=60)] | None = None
    """Unit of the times; null: that in the heading; if there is none, times are dimensionless."""
    encoding: Annotated[str, Field(max_length=60), AfterValidator(_encoding)] | None = None
    """Encoding of a CSV file; null: UTF-8 or UTF-16 if the file is valid as such, else Windows-1252."""
    missing: Annotated[tuple[Annotated[str, Field(max_length=60)], ...], Field(max_length=20)] = ()
    """Further texts that mark a missing number, beside empty cells, ``NaN``, ``NA``, ``n/a``,
    ``null``, ``none`` and ``---`` in capital or small letters."""
    deviation: Value | None = None
    """Standard deviation of each displacement, in the unit of the displacements or with a unit of its own."""
    pressure_deviation: Value | None = None
    """Standard deviation of each pressure, in the unit of the pressures or with a unit of its own."""
    weight: Positive = 1.0
    """Weight of each squared residual, such as the reciprocal of the number of points within the distance over which
    the errors of an image correlation are correlated."""
    place: Literal["reference", "deformed"] = "reference"
    """Whether the places are those of the particles in the undeformed body (``reference``), or those at which the
    particles are at each time (``deformed``)."""
    camera: CameraSettings = CameraSettings()
    """Place of the camera."""
    outside: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Largest share of the points that may lie outside the body. They are left out."""
    since: Value | None = None
    """Values before this time are left out; null: none."""
    until: Value | None = None
    """Values after this time are left out; null: none."""
    grid: tuple[GridCount, GridCount, GridCount] | None = None
    """Numbers of points of synthetic data along x, y and z, evenly in the box around the body, where there is no
    file."""
    times: SyntheticTimes | None = None
    """Times of synthetic data, where there is no file."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.grid is None) != (self.times is None):
            raise ValueError("grid and times of synthetic data belong together; add the other")
        if self.file is not None and self.grid is not None:
            raise ValueError("expected either a file, or the grid and times of synthetic data; remove one")
        if len(set(self.quantities)) < len(self.quantities):
            raise ValueError("quantities: one is there twice; keep it once")
        return self


#: Curves by name.
Observations = Annotated[dict[Name, ObservationSettings], Field(max_length=100)]
#: Measured fields by name.
Films = Annotated[dict[Name, PointsSettings], Field(max_length=20)]


def _require_apart(observations: Observations, points: Films) -> None:
    """Refuse a curve and a field of one name."""
    if both := observations.keys() & points.keys():
        raise ValueError(f"observations and points both have '{min(both)}'; rename one")


class ExperimentSettings(StrictModel):
    """One test: a study under one load, and what was measured in it."""

    study: Annotated[str, Field(min_length=1)] | None = None
    """Configuration of the study; null: the study that contains the section."""
    load: Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)] | None = None
    """Load of the test, in place of ``macro.loads``; null: the only load there."""
    observations: Observations = Field(default={})
    """Measured curves by name."""
    points: Films = Field(default={})
    """Measured fields by name."""

    @model_validator(mode="after")
    def _measured(self) -> Self:
        if not self.observations and not self.points:
            raise ValueError(
                "expected 'observations:' or 'points:' with something that was measured; add one"
            )
        _require_apart(self.observations, self.points)
        return self


class FitSettings(StrictModel):
    """Search of the unknowns: starts, evaluations, tolerance."""

    starts: Annotated[int, Field(ge=1, le=100)] = 2
    """Number of searches: the first from the start values, the others from points spread between the bounds."""
    evaluations: Annotated[int, Field(ge=2, le=10_000)] = 60
    """Largest number of evaluations of one search."""
    tolerance: Annotated[float, Field(ge=1e-14, le=1e-2)] = 1e-8
    """Relative tolerance: a search ends if the sum of squares, or the unknowns, change by less than this share."""
    rounds: Annotated[int, Field(ge=0, le=20)] = 3
    """Largest number of rounds in which further cells are solved. A round follows if the fitted body leaves the range
    in which the surrogate is trusted."""
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
    observations: Observations = Field(default={})
    """Measured curves by name, where there is one experiment: the study in which the section stands."""
    points: Films = Field(default={})
    """Measured fields by name, such as displacements of many points of a film, where there is one experiment."""
    experiments: Annotated[dict[Name, ExperimentSettings], Field(max_length=100)] = Field(default={})
    """Tests by name, where there are several, or in a file of its own."""
    fit: FitSettings = FitSettings()
    """Search of the unknowns."""
    posterior: PosteriorSettings | None = None
    """Settings of the posterior distribution; null: no draws."""

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        if bool(self.observations or self.points) == bool(self.experiments):
            raise ValueError(
                "expected either 'observations:' or 'points:' of this study, or 'experiments:' with observations of "
                "their own; give one of them"
            )
        _require_apart(self.observations, self.points)
        return self
