"""The configuration as a whole (RunConfig): its sections, its cells, values in the body.

Every stage has an identity, a hash of what its result depends on, so that a change of the macroscale does not
invalidate the samples.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from porocore.cell.cell import Cell
from porocore.cell.materials.prony import Relaxation
from porocore.core.echo import cut, echo, joined, suggestion
from porocore.core.files.plain_data import json_hash
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.inputs import MOST, InputSpace, farthest
from porocore.core.models.bounds import LARGEST_NUMBER, LARGEST_SEED, MOST_STATES, MOST_WORKERS
from porocore.core.models.name import Name
from porocore.core.models.strict import StrictModel
from porocore.core.units import (
    ByKey,
    Carried,
    Dimension,
    OutputUnits,
    ResultUnits,
    Scales,
    Unit,
    dimensions,
    length_text,
    units_now,
)
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.boundary.symmetry import part_problem
from porocore.macro.composition.evolution import EvolutionCourse
from porocore.macro.composition.fields import AXES
from porocore.macro.composition.regions import BodyFields, CellRanges, field_times, regions_of_cell
from porocore.macro.laws.closure import CLOSURES, ConductivityLaw
from porocore.macro.problem import MacroProblem, MacroSetup, body_mesh
from porocore.plugins.registry import registry
from porocore.sampling.execution.pool import ExecutorName, contradiction
from porocore.states import Array, IntArray

InputName = Literal["H11", "H12", "H13", "H21", "H22", "H23", "H31", "H32", "H33", "p"]
InRange = Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Positive = Annotated[float, Field(gt=0)]


#: Held-out states of one member of a family: a member is a mesh and its factors more.
STATES_TOGETHER = 4
#: Members that errors over the parameters are judged by, four for each third of a range, unless there are fewer states.
LEAST_MEMBERS = 12


class FemSettings(StrictModel):
    """The finite-element backend, of the cell and of the macroscale alike, and its own options."""

    backend: str = "skfem"
    """Backend of the cell, and of the macroscale unless ``macro.backend`` is given; ``porocore run --fem NAME``
    overrides it."""
    options: dict[str, Any] = Field(default={})
    """Options of the backend's cell solver."""


class SweptInput(StrictModel):
    """Closed range of one input and the sampler's default step in it."""

    range: Annotated[tuple[InRange, InRange], Carried()]
    """[lower, upper], closed; for ``density-sweep`` it includes 0."""
    step: Annotated[Positive | None, Carried()] = None
    """Default step; ``density-sweep`` needs it for every input, the other samplers take none."""

    @model_validator(mode="after")
    def _not_empty(self) -> SweptInput:
        low, high = self.range
        if not low < high:
            # It is not known here that the input is p, whose numbers would be without the unit that was written.
            ends = "" if units_now().given else f" [{low:g}, {high:g}]"
            raise ValueError(f"range{ends} is empty; give [lower, upper] with lower < upper")
        return self


#: Inputs by name.
SweptInputs = Annotated[dict[InputName, SweptInput], Field(min_length=1), ByKey({"p": Dimension("pressure")})]


class CellSampling(StrictModel):
    """Inputs of one of several cells."""

    inputs: SweptInputs
    """Components that move over other ranges than under ``sampling.inputs``, or do not move there."""


class HeldOutSettings(StrictModel):
    """Random states that no surrogate is trained on; its error is measured there."""

    count: Annotated[int, Field(ge=1, le=MOST_STATES)] = 100
    """Random states with values that no surrogate is trained on; the surrogate's error is measured there."""
    seed: Annotated[int, Field(ge=0, le=LARGEST_SEED)] = 0
    """Seed of their draw."""
    states_per_member: Annotated[int, Field(ge=1, le=MOST_STATES)] | None = None
    """Held-out states in a row with the same parameters of the cell; null: 4, but fewer where the states would be of
    less than 12 members, which tell little about errors over the parameters; without parameters it does nothing."""

    @property
    def together(self) -> int:
        """Number of states in a row with the same parameters of the cell."""
        if self.states_per_member is not None:
            return self.states_per_member
        return min(STATES_TOGETHER, max(1, self.count // LEAST_MEMBERS))


class SamplingSettings(StrictModel):
    """States of the cell that are solved to learn from."""

    sampler: str = "density-sweep"
    """Name of the sampler; ``porocore plugins`` lists those that are installed."""
    inputs: SweptInputs
    """The components that move, H11 … H33 and p, in the order of the sweeps: the first is swept alone, the next from
    every value of it."""
    tolerance: Positive | None = None
    """Tolerance of the samplers that have one; null leaves it to the sampler."""
    options: dict[str, Any] = Field(default={})
    """Further options of the sampler."""
    workers: Literal["auto"] | Annotated[int, Field(ge=1, le=MOST_WORKERS)] = "auto"
    """Processes that solve cells, and bodies where there are several to solve; ``auto`` is one for each core; the
    result does not depend on it."""
    executor: ExecutorName = "auto"
    """Place where the cells are solved: this process, processes of this machine, or the workers of dask; ``auto`` is
    ``dask`` with a scheduler, ``serial`` for one worker without a time limit, else ``processes``; the result does not
    depend on it."""
    scheduler: Annotated[str, Field(min_length=1, max_length=300)] | None = None
    """Address of a dask scheduler, such as ``tcp://node:8786``; null: dask starts workers on this machine."""
    state_seconds: Annotated[Positive | None, Unit("s")] = None
    """Time limit for the solve of one state, after which its worker is ended; the state is tried once more, then
    recorded as ``lost``; null: none."""
    parameters: Literal["body", "ranges"] = "body"
    """Values of the parameters of a cell at which states are solved, held-out ones too: those that the ``body`` has
    somewhere at some time, or their whole ``ranges``, for sweeps and for a law that is asked at any of them."""
    test: HeldOutSettings = HeldOutSettings()
    """States apart from the training."""
    cells: dict[str, CellSampling] = Field(default={})
    """Inputs of some of the ``cells`` by name, where they differ from ``inputs``."""

    @model_validator(mode="after")
    def _executor_fits(self) -> SamplingSettings:
        if fault := contradiction(self.executor, self.scheduler, self.state_seconds):
            raise ValueError(fault)
        return self

    def input_space(
        self,
        parameters: Mapping[str, tuple[float, float]] | None = None,
        used: tuple[tuple[float, ...], ...] = (),
    ) -> InputSpace:
        """Return the inputs and their ranges, those of the cell's parameters last, and the values that are used."""
        return InputSpace.from_ranges(
            {name: swept.range for name, swept in self.inputs.items()}, parameters, used
        )

    def sampler_options(self) -> dict[str, Any]:
        """Return the keyword arguments of the sampler, as far as set: ``step`` by input, ``tolerance``, ``options``."""
        options: dict[str, Any] = {}
        steps = {name: swept.step for name, swept in self.inputs.items() if swept.step is not None}
        if steps:
            options["step"] = steps
        if self.tolerance is not None:
            options["tolerance"] = self.tolerance
        return options | self.options

    def worker_count(self) -> int:
        """Return the number of processes; 'auto' is one for each core that this process may use."""
        if self.workers != "auto":
            return self.workers
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    @property
    def workers_here(self) -> int:
        """Number of processes of this machine that solve cells; 0 with a scheduler."""
        if self.scheduler is not None:
            return 0
        return 1 if self.executor == "serial" else self.worker_count()

    @property
    def solves_itself(self) -> bool:
        """True if the process that runs the study solves the states, without workers beside it."""
        alone = self.executor == "auto" and self.state_seconds is None and self.workers_here == 1
        return self.scheduler is None and (self.executor == "serial" or alone)

    def pool_options(self) -> dict[str, Any]:
        """Return the keyword arguments of :class:`porocore.sampling.execution.CellPool`."""
        others = self.model_dump(include={"executor", "scheduler", "state_seconds"})
        return {"workers": self.worker_count(), **others}


class SurrogateSettings(StrictModel):
    """The surrogate's backend, its seed and its own options."""

    backend: str = "torch"
    """Name of the surrogate; ``porocore run --surrogate NAME`` overrides it."""
    model: Literal["auto", "mlp", "potential"] = "auto"
    """Model: ⟨∇u¹⟩ by the paper's network (``mlp``), or the potential W and all that follows from it
    (``potential``); ``auto`` is what the closure needs."""
    seed: Annotated[int, Field(ge=0, le=LARGEST_SEED)] = 0
    """Seed of the first weights and of the split into training and validation states."""
    tolerance: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Share of the range of what is learned; a state is flagged whose error is estimated to be larger."""
    options: dict[str, Any] = Field(default={})
    """Options of the surrogate."""


class MacroSettings(MacroSetup):
    """The macroscale set-up and the loads under which it is solved."""

    loads: Annotated[tuple[float, ...], Field(min_length=1, max_length=1000)]
    """Each, none of them 0, is solved with the cell's law and with linear poroelasticity; it multiplies every
    prescribed value."""
    backend: str | None = None
    """Backend of the macroscale; null: that of ``fem.backend``; ``porocore run --macro NAME`` overrides it."""
    options: dict[str, Any] = Field(default={})
    """Options of the backend's macro solver; they change how the equations are solved, not the solution."""

    @field_validator("loads")
    @classmethod
    def _useful(cls, loads: tuple[float, ...]) -> tuple[float, ...]:
        if 0.0 in loads:
            raise ValueError("a load of 0 moves nothing; remove it")
        if len(set(loads)) < len(loads):
            raise ValueError("a load is listed twice; keep one")
        return loads

    def specification(self) -> dict[str, Any]:
        """Return the settings that a solution depends on; a backend only if it is not the cell's."""
        said = super().specification()
        return {name: value for name, value in said.items() if name != "backend" or value is not None}

    def problem(self, load: float) -> MacroProblem:
        """Return the problem under one load, of the part of a symmetric body that is solved."""
        whole = MacroProblem(load=load, **{name: getattr(self, name) for name in MacroSetup.model_fields})
        return part_problem(whole)


#: Name of a cell, which is that of a folder too.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
#: Largest difference of two lengths of one cell, relative to them.
SAME_LENGTH = 1e-6
NO_REST = (
    "cell: missing; with 'cells:' the rest of the body needs a cell too: give one of the cells here, at the top level, "
    "and leave 'cell:' of its regions out"
)


def well_named(cells: dict[str, Cell]) -> dict[str, Cell]:
    """Return the cells after a check of their names.

    Raises
    ------
    ValueError
        A name is none of a folder, or the same as another but for capitals.
    """
    known: dict[str, str] = {}
    for name in cells:
        if not _NAME.fullmatch(name):
            raise ValueError(
                "expected names of up to 40 letters, digits, '-' and '_', which are folders of the run, got "
                + echo(name)
            )
        other = known.setdefault(name.lower(), name)
        if other != name:
            raise ValueError(f"the cells '{other}' and '{name}' differ by capitals alone; rename one")
    return cells


def cell_faults(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield the faults of cells and regions that name one another."""
    cells = config.cells
    if cells and "cell" not in config.model_fields_set:
        yield ("cell",), NO_REST
    named: list[tuple[Location, str]] = [
        (("macro", "regions", name, "cell"), region.cell)
        for name, region in config.macro.regions.items()
        if region.cell is not None
    ]
    used = {cell for _, cell in named}
    named += [(("sampling", "cells", name), name) for name in config.sampling.cells]
    for at, cell in named:
        if cell not in cells:
            known = suggestion(cell, cells, "the cells are", "there are none; add it under 'cells:'")
            yield at, f"{dotted(at)}: there is no cell {echo(cell)}; {known}"
    for name in cells if used <= cells.keys() else ():  # else one of them may be meant
        if name not in used:
            at = ("cells", name)
            yield (
                at,
                f"{dotted(at)}: no region has this cell; write 'cell: {name}' under a region of macro.regions, or "
                "remove it",
            )
    yield from other_lengths(config)


def other_lengths(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield one fault of all images whose edge is not that of the first cell, in multiples of which all lengths are."""
    first, edge = config.cell.geometry.length, config.cell_length
    others = {name: cell.geometry.length for name, cell in config.cells.items()}
    wrong = {
        name: own
        for name, own in others.items()
        if own is not None and edge is not None and not math.isclose(own, edge, rel_tol=SAME_LENGTH)
    }
    if wrong and edge is not None:
        at = ("cells", next(iter(wrong)), "geometry", "voxel_size")
        got = joined(f"{length_text(own)} of '{name}'" for name, own in wrong.items())
        source = "scales.pore" if first is None else "cell.geometry.voxel_size"
        yield (
            at,
            f"{dotted(at)}: expected a cell of {length_text(edge)}, as by {source}, got {got}; all cells of a study "
            "have one edge: voxel_size times the number of voxels, twice that with mirrors",
        )


def _known(fields: Mapping[str, Any], names: set[str]) -> dict[str, Any]:
    return {name: field for name, field in fields.items() if name in names}


def _ranges_of(cell: Cell) -> dict[str, tuple[float, float]]:
    """Return the ranges of the parameters of a cell by their names."""
    return {each.name: (each.lower, each.upper) for each in cell.parameters}


def _renamed(line: str, keys: Mapping[str, str]) -> str:
    for key, other in keys.items():
        if line.startswith(key):
            return other + line.removeprefix(key)
    return line


def lines_of_cell(name: str | None, lines: Iterable[str]) -> Iterator[str]:
    """Yield lines with the name of the cell that they are about, where it has one."""
    for line in lines:
        head = next(head for head in ("note: ", "  ", "") if line.startswith(head))
        yield line if name is None else f"{head}cell {name}: {line.removeprefix(head)}"


#: A parameter that varies is distinguished in so many steps of its range, so that another mesh gives the same values.
LATTICE = 40
#: Digits of a share of a range to which a value that is one everywhere is kept.
DIGITS = 9
#: Answers that are kept.
KEPT = 16
#: The last answers, by all that they depend on.
_known_parameters: OrderedDict[str, tuple[tuple[float, ...], ...]] = OrderedDict()


def _given_everywhere(macro: MacroSettings, cell: str | None, names: Mapping[str, object]) -> bool:
    """Return True if the body has a field of each parameter, or each region with the cell has."""
    own = [region for region in macro.regions.values() if region.cell == cell]
    return all(
        name in macro.fields or (own and all(name in region.fields for region in own)) for name in names
    )


def told_apart(
    values: Iterable[Array], ranges: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, ...], ...]:
    """Return the rows that differ by steps of the ``ranges`` among values (n, m) at one time after the other.

    Between two times values go on a line from one to the other.
    """
    low, high = np.array(list(ranges.values())).T
    rows, varies = np.zeros((0, len(low)), dtype=np.int64), np.zeros(len(low), dtype=bool)
    first: Array | None = None
    before: IntArray | None = None
    for each in values:
        if not len(each):
            continue
        # Round-off decides nothing, not even half-way between two steps.
        unit = np.clip((each - low) / (high - low), 0, 1).round(DIGITS)
        first = unit[0] if first is None else first
        varies |= (unit != first).any(axis=0)
        here = np.round(unit * LATTICE).astype(np.int64)
        more = here if before is None else _between(before, here)
        rows, before = _distinct(np.concatenate([rows, _distinct(more)])), here
    if first is None:
        return ()
    shares = np.where(varies, rows / LATTICE, first)
    shares = np.unique(shares, axis=0)
    if len(shares) > MOST:
        shares = shares[np.sort(farthest(shares, MOST))]
    found = np.clip(low + (high - low) * shares, low, high)
    return tuple(tuple(float(f"{value:.12g}") for value in row) for row in found.tolist())


def _between(before: IntArray, here: IntArray) -> IntArray:
    """Return the steps (k, m) from ``before`` (n, m) to ``here`` (n, m), both included."""
    m = before.shape[1]
    lines = _distinct(np.concatenate([before, here], axis=1))
    start, end = lines[:, :m], lines[:, m:]
    count = max(int(np.abs(end - start).max(initial=0)), 1)
    shares = np.arange(count + 1)[:, None, None] / count
    steps: IntArray = np.round(start + shares * (end - start)).astype(np.int64)
    return steps.reshape(-1, m)


def _distinct(rows: IntArray) -> IntArray:
    """Return the different rows (k, m) of numbers below 256, as np.unique but for large bodies."""
    packed = np.ascontiguousarray(rows.astype(np.uint8)).view(f"V{rows.shape[1]}").reshape(-1)
    found: IntArray = np.unique(packed).view(np.uint8).reshape(-1, rows.shape[1]).astype(np.int64)
    return found


def _printable(text: str) -> str:
    """Return a text that terminals, HTML and SVG can show; others are refused."""
    if not all(c.isprintable() or c in "\n\t" for c in text):
        raise ValueError(f"expected text without control characters, got {echo(text)}; leave them out")
    return text


@dataclass(frozen=True)
class StageIdentities:
    """Hash for each stage of all settings that its result depends on."""

    cell: str
    sampling: str
    test: str
    training: str
    macro: str


@dataclass(frozen=True)
class Reading:
    """Notes on the document of a configuration; configurations that differ by them alone are equal."""

    unit_notes: tuple[str, ...] = field(default=(), compare=False)


class RunConfig(StrictModel):
    """The settings of a whole study."""

    title: Annotated[str, AfterValidator(_printable)] = ""
    """Heading of the report."""
    cell: Cell = Cell()
    """The periodic cell: pores, solid, fluid and mesh."""
    cells: Annotated[dict[str, Cell], AfterValidator(well_named)] = Field(default={})
    """Further cells by name, which regions of the body have; the rest of the body has ``cell``."""
    fem: FemSettings = FemSettings()
    """Finite elements."""
    sampling: SamplingSettings
    """States of the cell that are solved to learn from, and their workers."""
    surrogate: SurrogateSettings = SurrogateSettings()
    """Model that learns from the states."""
    closure: Annotated[str, Field(validate_default=True, json_schema_extra={"enum": list(CLOSURES)})] = (
        "mean-gradient"
    )
    """Rule by which stress, storage and flux follow from the cell."""
    conductivity: ConductivityLaw = "piola"
    """``piola``: K of the undeformed cell, turned and carried along with the solid; ``piola-unrotated``: carried along
    without the turn, the paper's formula, the same where K is isotropic; ``deformed``: that of the flow through every
    deformed pore."""
    macro: MacroSettings
    """The body, its boundary conditions and its time steps."""
    scales: Scales | None = None
    """Scales that make values with units dimensionless; plain numbers are dimensionless."""
    output_units: OutputUnits | None = None
    """Units of the results, which need scales; SI units by default."""
    scenarios: dict[Name, Scales] = Field(default={})
    """Further scales by name; the report gives the main results in SI units for each."""
    #: Of the study of one of several cells: the whole study, and the name of the cell.
    _part_of: tuple[RunConfig, str | None] | None = PrivateAttr(default=None)
    _reading: Reading = PrivateAttr(default=Reading())
    #: Sections of commands, as they stand in the file but with absolute paths.
    _sections: dict[str, dict[str, Any]] = PrivateAttr(default={})

    @field_validator("output_units")
    @classmethod
    def _need_scales(cls, units: OutputUnits | None, info: ValidationInfo) -> OutputUnits | None:
        if units is not None and info.data.get("scales", units) is None:
            raise ValueError(
                "results get units only with 'scales:', which are missing; add them at the top level"
            )
        return units

    @field_validator("closure")
    @classmethod
    def _known_closure(cls, closure: str, info: ValidationInfo) -> str:
        cell, others = info.data.get("cell"), info.data.get("cells") or {}
        if fault := _unfit_closure(closure, *([] if cell is None else [cell]), *others.values()):
            raise ValueError(fault)
        return closure

    @property
    def sections(self) -> Mapping[str, dict[str, Any]]:
        """Sections of commands by their keys, which all other commands leave alone; paths in them are absolute."""
        return self._sections

    @property
    def result_units(self) -> ResultUnits:
        """Units of reported results; dimensionless without scales."""
        return ResultUnits(self.scales, self.output_units or OutputUnits())

    @property
    def cell_length(self) -> float | None:
        """Length of the cell [m]; None where it is not known."""
        return self.cell.geometry.length if self.scales is None else self.scales.pore

    @property
    def unit_notes(self) -> tuple[str, ...]:
        """Notes on numbers without a unit beside values with one; none where it was not read from a document."""
        return self._reading.unit_notes

    @property
    def surrogate_model(self) -> str:
        """Model that is learned, with ``auto`` resolved."""
        if self.surrogate.model != "auto":
            return self.surrogate.model
        return "potential" if "stress" in CLOSURES[self.closure].responses else "mlp"

    @property
    def learns_potential(self) -> bool:
        """True if the surrogate learns the potential W, which does not change when a state is turned."""
        return self.surrogate_model == "potential"

    def model_of(self, surrogate: type[Surrogate]) -> str:
        """Return the model that a surrogate with several learns: the one that the closure needs, or its only one."""
        if self.surrogate.model == "auto" and self.surrogate_model not in surrogate.models:
            return surrogate.models[0]
        return self.surrogate_model

    @property
    def macro_backend(self) -> str:
        """Name of the macro solver."""
        return self.macro.backend or self.fem.backend

    def with_backends(
        self, fem: str | None = None, surrogate: str | None = None, macro: str | None = None
    ) -> RunConfig:
        """Return the configuration with other backends, which do not take over the options of the old ones.

        ``fem`` names the backend of the cell, and of the macroscale too unless ``macro`` names another.
        """
        update: dict[str, Any] = {}
        if fem is not None and fem != self.fem.backend:
            update["fem"] = FemSettings(backend=fem)
        backend = macro or fem
        if backend is not None:
            options = self.macro.options if backend == self.macro_backend else {}
            own = None if backend == (fem or self.fem.backend) else backend
            update["macro"] = self.macro.model_copy(update={"backend": own, "options": options})
        if surrogate is not None and surrogate != self.surrogate.backend:
            update["surrogate"] = SurrogateSettings(
                backend=surrogate, seed=self.surrogate.seed, tolerance=self.surrogate.tolerance
            )
        return self.model_copy(update=update)

    def with_executor(self, executor: str | None = None, scheduler: str | None = None) -> RunConfig:
        """Return the configuration with other workers.

        A scheduler alone means dask; dask alone keeps the configured scheduler.

        Raises
        ------
        ConfigurationError
            Executor and scheduler contradict each other.
        """
        if executor is None and scheduler is None:
            return self
        if executor is None:
            executor = "dask"
        elif scheduler is None and executor in ("auto", "dask"):
            scheduler = self.sampling.scheduler
        if fault := contradiction(executor, scheduler, self.sampling.state_seconds):
            raise ConfigurationError(fault)
        update = {"executor": executor, "scheduler": scheduler}
        return self.model_copy(update={"sampling": self.sampling.model_copy(update=update)})

    def with_closure(self, closure: str | None = None) -> RunConfig:
        """Return the configuration with another closure and the same surrogate; see :func:`with_closure`.

        Raises
        ------
        ConfigurationError
            The closure is unknown, or does not suit the solid.
        """
        if closure is None or closure == self.closure:
            return self
        if fault := _unfit_closure(closure, self.cell, *self.cells.values()):
            raise ConfigurationError(fault)
        return self.model_copy(update={"closure": closure})

    @property
    def cell_names(self) -> tuple[str | None, ...]:
        """Names of the cells: None for that of the rest of the body, or the only one, then the others."""
        return (None, *self.cells)

    @property
    def all_cells(self) -> tuple[Cell, ...]:
        """All cells, in the order of their names."""
        return (self.cell, *self.cells.values())

    @property
    def own_cells(self) -> tuple[str | None, ...]:
        """Names of the cells that the configuration gives; None is ``cell``, the default where there is no other."""
        return self.cell_names if "cell" in self.model_fields_set or not self.cells else tuple(self.cells)

    def of_cell(self, name: str | None) -> RunConfig:
        """Return the study of a body of one cell, with its own inputs; None names the cell of the rest of the body."""
        if not self.cells:
            return self
        own = None if name is None else self.sampling.cells.get(name)
        sampling = {"cells": {}, "inputs": self.sampling.inputs | ({} if own is None else own.inputs)}
        macro = self.fields_of(name)
        regions = {
            region: settings.model_copy(update={"cell": None})
            for region, settings in macro.regions.items()
            if settings.cell == name
        }
        part = self.model_copy(
            update={
                "cell": self.cell_named(name),
                "cells": {},
                "sampling": self.sampling.model_copy(update=sampling),
                "macro": macro.model_copy(update={"regions": regions}),
            }
        )
        part._part_of = self, name
        return part

    def problem(self, load: float) -> MacroProblem:
        """Return the problem under one load whose fields have the numbers of its laws, too; that which is solved."""
        return self.macro.problem(load).with_law_numbers(self.relaxations)

    @property
    def relaxations(self) -> dict[str | None, Relaxation | None]:
        """Relaxations of the cells by name; None for an elastic solid."""
        return {name: self.cell_named(name).relaxation for name in self.cell_names}

    def cell_named(self, name: str | None) -> Cell:
        """Return the cell of this name; None names that of the rest of the body."""
        return self.cell if name is None else self.cells[name]

    @property
    def cell_ranges(self) -> CellRanges:
        """Ranges of the parameters of the cell of each region."""
        ranges = {name: _ranges_of(self.cell_named(name)) for name in self.cell_names}
        return CellRanges([ranges[None], *(ranges[region.cell] for region in self.macro.regions.values())])

    def fields_of(self, name: str | None) -> MacroSettings:
        """Return the body with fields and rates of the parameters of one cell alone, and with all material axes."""
        known = {AXES, *_ranges_of(self.cell_named(name))}
        regions = {
            region: settings.model_copy(
                update={"fields": _known(settings.fields, known if settings.cell == name else {AXES})}
            )
            for region, settings in self.macro.regions.items()
        }
        own = {
            "regions": regions,
            "fields": _known(self.macro.fields, known),
            "evolution": _known(self.macro.evolution, known),
        }
        return self.macro.model_copy(update=own)

    @contextmanager
    def keys_of(self, name: str | None) -> Iterator[None]:
        """Name the keys of a cell where the block complains about those of a study of this cell alone.

        ``name`` is that of the cell; None: the cell of the rest of the body.
        """
        try:
            yield
        except ConfigurationError as error:
            if name is None:
                raise
            keys = {"cell.": f"cells.{name}.", "cell:": f"cells.{name}:"}
            if name in self.sampling.cells:
                own = self.sampling.cells[name].inputs
                keys |= {f"sampling.inputs.{each}.": f"sampling.cells.{name}.inputs.{each}." for each in own}
                keys["sampling.inputs:"] = f"sampling.cells.{name}.inputs:"
            raise ConfigurationError(
                "\n".join(_renamed(line, keys) for line in str(error).splitlines())
            ) from None

    def values_in_body(self, cell: str | None, times: Sequence[float]) -> Iterator[Array]:
        """Yield the parameters (n, m) of a cell at the n points of the body that have it, at ``times`` from 0 on.

        Where no field changes they are yielded once. Parameters whose rate follows the state of the body stay those of
        the beginning. None names the cell of the rest of the body.

        Raises
        ------
        ConfigurationError
            Fields do not suit the body.
        """
        fields, ranges = (
            BodyFields(self.macro, body_mesh(self.macro), self.cell_ranges),
            _ranges_of(self.cell_named(cell)),
        )
        columns = [fields.names.index(name) for name in ranges]
        place = fields.at(0.0).place
        assert place is not None
        here = np.isin(place.region, regions_of_cell(self.macro.regions, cell))
        course = EvolutionCourse(self.macro.evolution, ranges, fields.points.places[here])
        evolves = course.evolves and course.is_known

        def given(time: float) -> Array:
            found = fields.at(time).parameters
            assert found is not None
            return np.asarray(found[here][:, columns])

        before, values = 0.0, given(0.0)
        for time in times if fields.varies or evolves else (0.0,):
            # Those that evolve begin at their fields.
            values = (
                course.after(values, before, given(time), time) if evolves and time > before else given(time)
            )
            before = time
            yield values

    def resolved_yaml(self) -> str:
        """Return every setting, defaults included; loading it gives an equal configuration."""
        said = self.model_dump(mode="json") | self._sections
        return yaml.safe_dump(said, sort_keys=False, allow_unicode=True)

    def input_space(self) -> InputSpace:
        """Return the sampled inputs: components of the state, then the parameters of a family of cells."""
        return self.sampling.input_space(_ranges_of(self.cell), self.used_parameters)

    @property
    def used_parameters(self) -> tuple[tuple[float, ...], ...]:
        """Values of the cell's parameters at which states are sampled; empty: their whole ranges.

        They are those near which the body has some cell, one row for each combination. A parameter that is one number
        everywhere keeps it; one that varies is distinguished in steps of its range. Of more than
        :data:`~porocore.core.inputs.MOST` the farthest are kept.

        Raises
        ------
        ConfigurationError
            Fields do not suit the body.
        """
        if not self.cell.is_family or self.sampling.parameters == "ranges":
            return ()
        whole, name = self._part_of or (self, None)
        ranges, macro = _ranges_of(whole.cell_named(name)), whole.macro
        if not _given_everywhere(macro, name, ranges):
            return ()  # a check of the fields names the one that is missing
        if not EvolutionCourse(macro.evolution, ranges, np.zeros((0, 3))).is_known:
            return ()  # it may evolve to any value of its range
        all_ranges = [sorted(each.items()) for each in whole.cell_ranges.by_region]
        grounds = json.dumps([macro.specification(), name, all_ranges], default=str, sort_keys=True)
        if grounds not in _known_parameters:
            times = field_times(macro, macro.time.end)
            _known_parameters[grounds] = told_apart(whole.values_in_body(name, times), ranges)
            while len(_known_parameters) > KEPT:
                _known_parameters.popitem(last=False)
        _known_parameters.move_to_end(grounds)
        return _known_parameters[grounds]

    # Not a cached property: model_copy would carry the cache over to a changed configuration.
    @property
    def stages(self) -> StageIdentities:
        """Identity of each stage, independent of title, scales, units, scenarios, workers and macro.options."""
        inputs = [(name, swept.model_dump()) for name, swept in self.sampling.inputs.items()]
        cell = cell_identity(self.cell, self.fem)
        how = self.sampling.model_dump(include={"sampler", "tolerance", "options"})
        # The samples hold more where the flow is solved as well.
        more: tuple[Any, ...] = (self.conductivity,) if self.conductivity == "deformed" else ()
        if used := self.used_parameters:
            more = (*more, used)
        sampling = _hash(cell, inputs, how, *more)
        ranges = [(name, swept.range) for name, swept in self.sampling.inputs.items()]
        # Without parameters it has no members, and a hash that is older than they are.
        held_out = self.sampling.test.model_dump(exclude={"states_per_member"})
        if self.cell.is_family:
            held_out["states_per_member"] = self.sampling.test.together
        test = _hash(cell, ranges, held_out, *more)
        training = _hash(sampling, self.surrogate.model_dump(), self.surrogate_model)
        others = [(name, self.of_cell(name).stages.training) for name in self.cells]
        relaxing = [None if each is None else each.model_dump() for each in self.relaxations.values()]
        # Without any it is a hash that is older than they are.
        memory = (relaxing,) if any(relaxing) else ()
        macro = _hash(training, self.closure, self.conductivity, self.macro.specification(), *others, *memory)
        return StageIdentities(cell, sampling, test, training, macro)

    @property
    def identity(self) -> str:
        """Hash of the whole run."""
        return _hash(asdict(self.stages))


def with_closure(config: RunConfig, closure: str | None) -> RunConfig:
    """Return the configuration with another closure, without the surrogate's options if it learns another model then.

    Raises
    ------
    ConfigurationError
        There is no such closure.
    """
    other = config.with_closure(closure)
    if other.surrogate_model == config.surrogate_model or not config.surrogate.options:
        return other
    try:
        implementation = registry().get("surrogate", config.surrogate.backend)
    except PluginError:  # a stage that needs the surrogate reports it
        return other
    if not implementation.models or other.model_of(implementation) == config.model_of(implementation):
        return other
    return other.model_copy(update={"surrogate": config.surrogate.model_copy(update={"options": {}})})


def cell_identity(cell: Cell, fem: FemSettings) -> str:
    """Return the hash of a cell and of how it is solved."""
    return _hash(cell.specification(), fem.model_dump())


def differences(one: RunConfig, other: RunConfig) -> list[str]:
    """Return the dotted keys in which two configurations differ, as ``key (a, not b)``, with units beside scales.

    Where the scales differ, numbers that are equal with their units are left out.
    """
    units = one.result_units.units
    first, second = _Told.of(one, units), _Told.of(other, units)
    found = (
        (at, first.text(a, at), second.text(b, at)) for at, a, b in _differences(first.data, second.data, ())
    )
    same = one.scales == other.scales
    return [f"{dotted(at)} ({cut(a, 40)}, not {cut(b, 40)})" for at, a, b in found if same or a != b]


def _differences(one: Any, other: Any, at: Location) -> Iterator[tuple[Location, Any, Any]]:
    """Yield where nested data differ, and both values; lists of numbers are one value."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in {**one, **other}:
            yield from _differences(one.get(key), other.get(key), (*at, str(key)))
    elif _are_nested(one) and _are_nested(other) and len(one) == len(other):
        for k, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(*pair, (*at, str(k)))
    elif one != other:
        yield at, one, other


def _are_nested(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(each, list | dict) for each in value)


@dataclass(frozen=True)
class _Told:
    """Data of a configuration, the quantities of its multiples of scales by place, and the units of its results."""

    data: dict[str, Any]
    quantities: Mapping[Location, str]
    units: ResultUnits

    @classmethod
    def of(cls, config: RunConfig, units: OutputUnits) -> _Told:
        data = config.model_dump(mode="json")
        found = ((place, of) for place, of in dimensions(type(config), data) if of is not None and not of.si)
        return cls(data, {place.path: of.quantity for place, of in found}, ResultUnits(config.scales, units))

    def text(self, value: Any, at: Location) -> str:
        """Return the value at a place, its numbers with their units."""
        if isinstance(value, list):
            return f"[{', '.join(self.text(each, (*at, str(k))) for k, each in enumerate(value))}]"
        if isinstance(value, float) and self.units.given and at in self.quantities:
            return self.units.text(value, self.quantities[at], TOLD_DIGITS)
        return json.dumps(value, ensure_ascii=False)


#: Digits of a number with a unit in a message on two that differ.
TOLD_DIGITS = 10


def _unfit_closure(closure: str, *cells: Cell) -> str:
    """Return why a closure cannot be used; empty if it can."""
    if closure in CLOSURES:
        return next((fault for cell in cells if (fault := CLOSURES[closure].unfit(cell))), "")
    return f"unknown closure {echo(closure)}; {suggestion(closure, CLOSURES, 'the closures are')}"


def _hash(*parts: Any) -> str:
    return json_hash(parts, sort_keys=True, default=str)
