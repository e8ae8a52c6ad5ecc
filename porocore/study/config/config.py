"""The configuration as a whole (RunConfig): identities of stages, copies with other backends, differences.

Every stage has an identity, a hash of what its result depends on, so that a change of the macroscale does not
invalidate the samples.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, field_validator

from porocore.cell.cell import Cell
from porocore.core.echo import cut, echo, suggestion
from porocore.core.files.plain_data import json_hash
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.inputs.input_space import InputSpace
from porocore.core.models.name import Name
from porocore.core.models.strict import StrictModel
from porocore.core.units.results import OutputUnits, ResultUnits
from porocore.core.units.scales import Scales
from porocore.errors import ConfigurationError
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.pull_back import ConductivityLaw
from porocore.sampling.execution.choice import contradiction
from porocore.study.config.body_parameters import used_parameters
from porocore.study.config.cells import of_one_cell, well_named
from porocore.study.config.sections import (
    FemSettings,
    MacroSettings,
    SamplingSettings,
    SurrogateSettings,
)


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
    calibration: dict[str, Any] | None = None
    """Unknowns and measured curves of ``porocore calibrate``; other commands leave them alone."""

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
    def result_units(self) -> ResultUnits:
        """Units of reported results; dimensionless without scales."""
        return ResultUnits(self.scales, self.output_units or OutputUnits())

    @property
    def surrogate_model(self) -> str:
        """Model that is learned, with ``auto`` resolved."""
        if self.surrogate.model != "auto":
            return self.surrogate.model
        return "potential" if "stress" in CLOSURES[self.closure].responses else "mlp"

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
        """Return the configuration with another closure and the same surrogate; see ``backends.with_closure``.

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
    def own_cells(self) -> tuple[str | None, ...]:
        """Names of the cells that the configuration gives; None is ``cell``, the default where there is no other."""
        return self.cell_names if "cell" in self.model_fields_set or not self.cells else tuple(self.cells)

    def of_cell(self, name: str | None) -> RunConfig:
        """Return the study of a body of one of the cells alone; None names the cell of the rest of the body."""
        return of_one_cell(self, name)

    def resolved_yaml(self) -> str:
        """Return every setting, defaults included; loading it gives an equal configuration."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)

    def input_space(self) -> InputSpace:
        """Return the sampled inputs: components of the state, then the parameters of a family of cells."""
        varied = self.cell.parameters if self.cell.is_family else ()
        ranges = {each.name: (each.lower, each.upper) for each in varied}
        return self.sampling.input_space(ranges, self.used_parameters)

    @property
    def used_parameters(self) -> tuple[tuple[float, ...], ...]:
        """Values of the cell's parameters at which states are sampled; empty: their whole ranges.

        Raises
        ------
        ConfigurationError
            Fields do not suit the body.
        """
        if not self.cell.is_family or self.sampling.parameters == "ranges":
            return ()
        return used_parameters(*(self._part_of or (self, None)))

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
        macro = _hash(training, self.closure, self.conductivity, self.macro.specification(), *others)
        return StageIdentities(cell, sampling, test, training, macro)

    @property
    def identity(self) -> str:
        """Hash of the whole run."""
        return _hash(asdict(self.stages))


def cell_identity(cell: Cell, fem: FemSettings) -> str:
    """Return the hash of a cell and of how it is solved."""
    return _hash(cell.specification(), fem.model_dump())


def differences(one: RunConfig, other: RunConfig) -> list[str]:
    """Return the dotted keys in which two configurations differ, as ``key (a, not b)``."""
    return list(_differences(one.model_dump(mode="json"), other.model_dump(mode="json"), ()))


def _differences(one: Any, other: Any, at: Location) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in {**one, **other}:
            yield from _differences(one.get(key), other.get(key), (*at, str(key)))
    elif one != other:
        yield f"{dotted(at)} ({_short(one)}, not {_short(other)})"


def _short(value: Any) -> str:
    return cut(json.dumps(value, ensure_ascii=False), 40)


def _unfit_closure(closure: str, *cells: Cell) -> str:
    """Return why a closure cannot be used; empty if it can."""
    if closure in CLOSURES:
        return next((fault for cell in cells if (fault := CLOSURES[closure].unfit(cell))), "")
    return f"unknown closure {echo(closure)}; {suggestion(closure, CLOSURES, 'the closures are')}"


def _hash(*parts: Any) -> str:
    return json_hash(parts, sort_keys=True, default=str)
