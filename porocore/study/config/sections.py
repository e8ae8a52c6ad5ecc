"""Sections of the configuration: fem, sampling, held-out states, surrogate, macroscale."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from porocore.core.inputs.input_space import InputSpace
from porocore.core.models.bounds import LARGEST_NUMBER, LARGEST_SEED, MOST_STATES, MOST_WORKERS
from porocore.core.models.strict import StrictModel
from porocore.core.units.dimensions import ByKey, Carried, Dimension, Unit
from porocore.core.units.results import spoken
from porocore.macro.boundary.symmetry import part_problem
from porocore.macro.problem import MacroProblem, MacroSetup
from porocore.sampling.execution.choice import ExecutorName, contradiction

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
            ends = "" if spoken().given else f" [{low:g}, {high:g}]"
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
