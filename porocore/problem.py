"""The macroscale problem: a box of poroelastic material, what is done to its faces, and when."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

Face = Literal["x-", "x+", "y-", "y+", "z-", "z+"]
FACES: tuple[Face, ...] = ("x-", "x+", "y-", "y+", "z-", "z+")
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Boundary(_Strict):
    """What is prescribed on one face; what is left out is free of traction and impermeable.

    Non-zero values are multiplied by the load and by the ramp of the time plan.
    """

    displacement: tuple[float | None, float | None, float | None] = (None, None, None)
    """Components of u; None leaves a component free."""
    traction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Dead traction t̄ per reference area [E]."""
    plate: float | None = None
    """Force along the face's axis on a rigid frictionless plate: the face moves along that axis as one [E L²]."""
    pressure: float | None = None
    """Pore pressure; None makes the face a flux boundary."""
    flux: float = 0.0
    """Outward flux q̄ per reference area where the pressure is free."""

    @model_validator(mode="after")
    def _one_kind_each(self) -> Boundary:
        for i, (u, t) in enumerate(zip(self.displacement, self.traction, strict=True)):
            if u is not None and t != 0:
                raise ValueError(f"component {i + 1} has both a displacement and a traction; keep one")
        if self.pressure is not None and self.flux != 0:
            raise ValueError("a face has both a pressure and a flux; keep one")
        return self


class TimePlan(_Strict):
    """Backward Euler steps; the load is ramped up linearly in ``ramp_increments`` steps of ``ramp_step`` first."""

    end: Positive = 100.0
    step: Positive = 0.5
    ramp_increments: Count = 10
    ramp_step: Positive = 0.05
    smallest_step: Positive = 1e-6
    """Step halving stops here."""
    profiles: tuple[Positive, ...] = (1.0, 10.0, 40.0)
    """Times at which the fields are kept."""
    load_curve: tuple[tuple[Positive, float], ...] = ()
    """(time, share of the load), linear in between from nothing at 0 and constant at the end; empty: the ramp."""

    @model_validator(mode="after")
    def _in_order(self) -> TimePlan:
        if self.end <= self.ramp_increments * self.ramp_step:
            raise ValueError(
                f"end = {self.end:g} does not lie behind the ramp, "
                f"which takes {self.ramp_increments * self.ramp_step:g}"
            )
        if any(t > self.end for t in self.profiles):
            raise ValueError(f"a profile time lies behind end = {self.end:g}")
        times = [time for time, _ in self.load_curve]
        if sorted(set(times)) != times:
            raise ValueError("the times of load_curve do not ascend")
        if times and times[-1] > self.end:
            raise ValueError(f"a time of load_curve lies behind end = {self.end:g}")
        return self

    def share(self, time: float) -> float:
        """Of the load, that acts at ``time``."""
        ramp_end = self.ramp_increments * self.ramp_step
        if not self.load_curve:
            return min(1.0, time / ramp_end)
        times, shares = zip((0.0, 0.0), *self.load_curve, strict=True)
        return float(np.interp(time, times, shares))


class NewtonSettings(_Strict):
    """Stops when the residual has fallen to ``tolerance`` times the force and volume scale of the step."""

    tolerance: Positive = 1e-9
    iterations: Count = 25


class MacroSetup(_Strict):
    """Confined compression and its relatives on a box [0, a] × [0, b] × [0, c] of hexahedra, for any load."""

    size: tuple[Positive, Positive, Positive] = (0.1, 7.5, 0.1)
    elements: tuple[Count, Count, Count] = (1, 106, 1)
    boundary: dict[Face, Boundary]
    time: TimePlan = TimePlan()
    newton: NewtonSettings = NewtonSettings()

    @model_validator(mode="after")
    def _plates_are_free_to_move(self) -> MacroSetup:
        for face, boundary in self.boundary.items():
            i = "xyz".index(face[0])
            if boundary.plate is not None and boundary.displacement[i] is not None:
                raise ValueError(
                    f"the face {face} has both a plate, which is pushed by a force, and a displacement u_{i + 1}, "
                    "which moves it as one already; keep one"
                )
        return self

    def ramp(self, time: float) -> float:
        """Share of the load that acts at ``time``."""
        return self.time.share(time)


class MacroProblem(MacroSetup):
    """A set-up under one load."""

    load: float = 1.0
    """Factor of every prescribed value."""
