"""The configuration of a study: YAML in, validated and typed settings out.

Every stage has an identity, a hash of what its result depends on, so that a change of the macroscale does not
invalidate the samples.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import Field, ValidationError, ValidationInfo, field_validator

from porocore.cell.cell import Cell
from porocore.core.echo import cut, echo
from porocore.core.files.yaml_document import Location, YamlDocument, dotted
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.core.units.results import OutputUnits, ResultUnits
from porocore.core.units.scales import Scales
from porocore.core.units.texts import resolved
from porocore.errors import ConfigurationError
from porocore.macro.laws import CLOSURES, MeanGradientClosure
from porocore.macro.laws.pull_back import ConductivityLaw
from porocore.macro.problem import MacroSetup
from porocore.sampling.execution.choice import contradiction
from porocore.study.config.errors import faults, unexpected
from porocore.study.config.sections import (
    FemSettings,
    MacroSettings,
    SamplingSettings,
    Section,
    SurrogateSettings,
)


class _OnlyScales(Section):
    scales: Scales


class _OnlyCell(Section):
    cell: Cell = Cell()


@dataclass(frozen=True)
class StageIdentities:
    """Hash of everything that the result of each stage depends on, as far as the configuration goes."""

    cell: str
    sampling: str
    test: str
    training: str
    macro: str


class RunConfig(Section):
    """A whole study."""

    title: str = ""
    """Heading of the report."""
    cell: Cell = Cell()
    """The periodic cell: pores, solid, fluid and mesh."""
    fem: FemSettings = FemSettings()
    """Finite elements."""
    sampling: SamplingSettings
    """Which states of the cell are solved to learn from, and by whom."""
    surrogate: SurrogateSettings = SurrogateSettings()
    """What is learned from the states, and how."""
    closure: Annotated[str, Field(validate_default=True, json_schema_extra={"enum": list(CLOSURES)})] = (
        "mean-gradient"
    )
    """How stress, storage and flux follow from the cell."""
    conductivity: ConductivityLaw = "piola"
    """``piola``: K of the undeformed cell, turned and carried along with the solid; ``piola-unrotated``: carried along
    without the turn, the paper's formula, the same where K is isotropic; ``deformed``: that of the flow through every
    deformed pore."""
    macro: MacroSettings
    """The body, what is done to it, and when."""
    scales: Scales | None = None
    """By which values with a unit are made dimensionless, and results get theirs; plain numbers are dimensionless."""
    output_units: OutputUnits | None = None
    """Of the results, which need scales; SI units where there are scales and nothing is said."""
    scenarios: dict[str, Scales] = Field(default={})
    """Scales by names of their own, for each of which the report gives the main results in SI units."""

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
        if fault := _unfit_closure(closure, info.data.get("cell")):
            raise ValueError(fault)
        return closure

    @property
    def result_units(self) -> ResultUnits:
        """Of what is reported; dimensionless without scales."""
        return ResultUnits(self.scales, self.output_units or OutputUnits())

    @property
    def surrogate_model(self) -> str:
        """The model that is learned, ``auto`` resolved."""
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
        """With another backend; options that were written for the old one do not go over to the new one.

        ``fem`` is that of the cell, and of the macroscale too unless ``macro`` names another.
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
        """With other workers; a scheduler alone means dask, an executor alone leaves the configured scheduler to dask.

        Raises
        ------
        ConfigurationError
            They do not go together.
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
        """With another closure, and the options of the surrogate as they are; see ``backends.with_closure``.

        Raises
        ------
        ConfigurationError
            There is no such closure, or it does not suit the solid.
        """
        if closure is None or closure == self.closure:
            return self
        if fault := _unfit_closure(closure, self.cell):
            raise ConfigurationError(fault)
        return self.model_copy(update={"closure": closure})

    def resolved_yaml(self) -> str:
        """Every setting, defaults included; loading it gives an equal configuration."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)

    # Not a cached property: model_copy would carry the cache over to a changed configuration.
    @property
    def stages(self) -> StageIdentities:
        """Identity of each stage; of title, scales, units, scenarios, workers and macro.options none depends."""
        inputs = [(name, swept.model_dump()) for name, swept in self.sampling.inputs.items()]
        cell = _hash(self.cell.specification(), self.fem.model_dump())
        how = self.sampling.model_dump(include={"sampler", "tolerance", "options"})
        # The samples hold more where the flow is solved as well.
        more = (self.conductivity,) if self.conductivity == "deformed" else ()
        sampling = _hash(cell, inputs, how, *more)
        ranges = [(name, swept.range) for name, swept in self.sampling.inputs.items()]
        test = _hash(cell, ranges, self.sampling.test.model_dump(), *more)
        training = _hash(sampling, self.surrogate.model_dump(), self.surrogate_model)
        macro = _hash(training, self.closure, self.conductivity, self.macro.specification())
        return StageIdentities(cell, sampling, test, training, macro)

    @property
    def identity(self) -> str:
        """Hash of the whole run."""
        return _hash(asdict(self.stages))


def load_config(path: Path | str) -> RunConfig:
    """Read and validate a configuration.

    Raises
    ------
    ConfigurationError
        Lists every fault in one message, one line each: file, line, dotted key, what was expected, what
        came and what to do.
    """
    return validated(YamlDocument.read(Path(path)))


def config_from(settings: Mapping[str, Any], folder: Path | str = ".") -> RunConfig:
    """Validate settings that are nested as in a file; relative paths in them start at ``folder``.

    Raises
    ------
    ConfigurationError
        As :func:`load_config`, with dotted keys and without lines.
    """
    return validated(YamlDocument.of(settings, Path(folder)))


def cell_from(settings: Mapping[str, Any], folder: Path | str = ".") -> Cell:
    """Validate the settings of a cell alone; see :func:`config_from`.

    Raises
    ------
    ConfigurationError
        As there.
    """
    document = YamlDocument.of({"cell": settings}, Path(folder))
    try:
        return _OnlyCell.model_validate(document.data, context={"folder": document.folder}).cell
    except ValidationError as error:
        found = faults(document, error.errors(), _OnlyCell)
        raise ConfigurationError("\n".join(f"{document.at_line(0)}: {text}" for _, text in found)) from error


def validated(document: YamlDocument) -> RunConfig:
    """The configuration that a document holds; see :func:`load_config`."""
    scales = _scales(document)
    data, found = resolved(RunConfig, document.data, scales)
    unread = {at for at, _ in found}
    config: RunConfig | None = None
    try:
        config = RunConfig.model_validate(data, context={"folder": document.folder})
    except ValidationError as error:
        found += [fault for fault in faults(document, error.errors(), RunConfig) if fault[0] not in unread]
    else:
        found += [
            (
                at,
                unexpected(
                    at,
                    f"a number up to {LARGEST_NUMBER:g}" if math.isfinite(value) else "a finite number",
                    value,
                ),
            )
            for at, value in _leaves(config.model_dump())
            if isinstance(value, float) and not abs(value) <= LARGEST_NUMBER
        ]
        found += _unknown_surfaces(config.macro)
    # No setting of porocore is true or false, but pydantic would take 'yes' for 1.
    found += [
        (at, f"{dotted(at)}: expected a number or text, got {echo(value)}; put text in quotes")
        for at, value in _leaves(document.data)
        if isinstance(value, bool) and "options" not in at and at not in dict(found)
    ]
    if found or config is None:
        told = dict.fromkeys((document.line(at), text) for at, text in found)
        lines = sorted(told, key=lambda fault: fault[0])
        raise ConfigurationError("\n".join(f"{document.at_line(line)}: {text}" for line, text in lines))
    return config


def _scales(document: YamlDocument) -> Scales | None:
    """By which everything else is read, so that their faults come alone."""
    section = document.data.get("scales")
    if section is None:
        return None
    data, found = resolved(_OnlyScales, {"scales": section}, None)
    if not found:
        try:
            return _OnlyScales.model_validate(data).scales
        except ValidationError as error:
            found += faults(document, error.errors(), RunConfig)
    lines = sorted((document.line(at), text) for at, text in found)
    raise ConfigurationError("\n".join(f"{document.at_line(line)}: {text}" for line, text in lines))


def _unknown_surfaces(macro: MacroSetup) -> Iterator[tuple[Location, str]]:
    """Of bodies whose kind alone decides the names; those of a file are known when it is read."""
    known = [*macro.body.surfaces, *macro.surfaces]
    named: list[tuple[Location, str]] = [(("macro", "boundary", name), name) for name in macro.boundary]
    named += [(("macro", "surfaces", name, "of"), patch.of) for name, patch in macro.surfaces.items()]
    for at, name in named if macro.body.surfaces else ():
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            question = f"did you mean '{close[0]}'? " if close else ""
            yield at, f"{dotted(at)}: no such surface; {question}the surfaces are {', '.join(known)}"


def differences(one: RunConfig, other: RunConfig) -> list[str]:
    """Dotted keys in which two configurations differ, ``key (a, not b)``."""
    return list(_differences(one.model_dump(mode="json"), other.model_dump(mode="json"), ()))


def _differences(one: Any, other: Any, at: Location) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in {**one, **other}:
            yield from _differences(one.get(key), other.get(key), (*at, str(key)))
    elif one != other:
        yield f"{dotted(at)} ({_short(one)}, not {_short(other)})"


def _short(value: Any) -> str:
    return cut(json.dumps(value, ensure_ascii=False), 40)


def _leaves(data: Any, at: Location = ()) -> Iterator[tuple[Location, Any]]:
    """Everything in nested mappings and lists that is neither, with its location."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _leaves(value, (*at, str(key)))
    elif isinstance(data, list | tuple):
        for i, value in enumerate(data):
            yield from _leaves(value, (*at, str(i)))
    else:
        yield at, data


def _unfit_closure(closure: str, cell: Cell | None) -> str:
    """Why a closure cannot be used; empty if it can."""
    if closure in CLOSURES:
        several = cell is not None and cell.materials is not None
        return MeanGradientClosure.needs_one_energy if several and closure == MeanGradientClosure.name else ""
    close = difflib.get_close_matches(closure, CLOSURES, n=1)
    question = f"did you mean '{close[0]}'? " if close else ""
    return f"unknown closure {echo(closure)}; {question}the closures are {', '.join(CLOSURES)}"


def _hash(*parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]
