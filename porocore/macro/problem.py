"""Macro problem in the configuration: boundary conditions, load over time, initial state, probes, body mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.materials.prony import Relaxation
from porocore.core.formulas import TimeFunction, Value, require_later
from porocore.core.models.bounds import MOST_STEPS, MOST_TIMES
from porocore.core.models.name import Name
from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension, units_now
from porocore.interfaces.macro import Part
from porocore.interfaces.solution import pressure_name
from porocore.macro.body.kinds import AnyBody, Box, make_body
from porocore.macro.body.mesh import BodyMesh, Patch, called, with_patches
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.macro.composition.charges import Charges
from porocore.macro.composition.evolution import Evolution
from porocore.macro.composition.fields import Fields
from porocore.macro.composition.law_numbers import CHARGES, EVOLUTION, relaxation_numbers
from porocore.macro.composition.regions import AnyRegion, composition, field_corners, without_paths

Positive = Annotated[float, Field(gt=0)]
Time = Annotated[Positive, Dimension("time")]
Row = tuple[float, float, float]
NO_GRADIENT: tuple[Row, Row, Row] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _time(value: float) -> str:
    return units_now().text(value, "time", 6)


class Boundary(StrictModel):
    """Boundary conditions of one surface; without any it is free of traction and impermeable.

    A number is multiplied by the load and by the ramp of the time plan, a function of time
    (:class:`~porocore.core.formulas.TimeFunction`) by the load alone.
    """

    displacement: Annotated[tuple[Value | None, Value | None, Value | None], Dimension("displacement")] = (
        None,
        None,
        None,
    )
    """Components of u; null leaves a component free."""
    normal: Annotated[Value | None, Dimension("displacement")] = None
    """Displacement along the outward normal of a plane surface, which slides along itself; null leaves it free."""
    traction: Annotated[tuple[Value, Value, Value], Dimension("stress")] = (0.0, 0.0, 0.0)
    """Components of the dead traction t̄, per reference area."""
    follower: Annotated[Value, Dimension("pressure")] = 0.0
    """Pressure on the deformed surface, along its current inward normal."""
    plate: Annotated[Value | None, Dimension("force")] = None
    """Force along the surface's axis on a rigid frictionless plate, of the whole where the body has symmetry planes: it
    moves along that axis as one, as much as the force demands."""
    pressure: Annotated[Value | None, Dimension("pressure")] = None
    """Pore pressure; null makes the surface a flux boundary."""
    flux: Annotated[Value, Dimension("velocity")] = 0.0
    """Outward flux q̄ per reference area, where the pressure is free."""

    @model_validator(mode="after")
    def _one_kind_each(self) -> Boundary:
        for i, (u, t) in enumerate(zip(self.displacement, self.traction, strict=True)):
            if u is not None and t != 0:
                raise ValueError(f"component {i + 1} has both a displacement and a traction; keep one")
        if self.normal is not None and any(u is not None for u in self.displacement):
            raise ValueError("a surface has both a normal displacement and components of it; keep one")
        if self.plate is not None and self.normal is not None:
            raise ValueError(
                "a surface has both a plate, which is pushed, and a normal displacement; keep one"
            )
        if self.plate is not None and (self.follower != 0 or any(t != 0 for t in self.traction)):
            raise ValueError(
                "a surface has both a plate, which is pushed by a force alone, and a traction or a follower; keep one"
            )
        if self.pressure is not None and self.flux != 0:
            raise ValueError(
                "expected a pressure or a flux, got both 'pressure:' and a 'flux:' that is not 0; keep one, or set "
                "'pressure: null'"
            )
        return self

    @property
    def is_held(self) -> bool:
        """True if a displacement is prescribed, so that a run has a force on the surface; that on a plate is given."""
        return any(u is not None for u in (*self.displacement, self.normal))

    @property
    def is_moved(self) -> bool:
        """True if a displacement other than zero is prescribed."""
        return any(u is not None and u != 0 for u in (*self.displacement, self.normal))

    def without_values(self) -> Boundary:
        """Return conditions that prescribe the same and are all zero."""
        held = {
            name: None if getattr(self, name) is None else 0.0 for name in ("normal", "plate", "pressure")
        }
        return self.model_copy(
            update={
                **held,
                "displacement": tuple(None if u is None else 0.0 for u in self.displacement),
                "traction": (0.0, 0.0, 0.0),
                "follower": 0.0,
                "flux": 0.0,
            }
        )

    def supports_alone(self) -> Boundary:
        """Return conditions without values in which displacements that are moved are free."""
        held = self.without_values()
        free = tuple(None if u is None or u != 0 else 0.0 for u in self.displacement)
        normal = None if self.normal is None or self.normal != 0 else 0.0
        return held.model_copy(update={"displacement": free, "normal": normal})

    @property
    def time_functions(self) -> Iterator[TimeFunction]:
        """Time functions among its values."""
        forces = (*self.traction, self.follower, self.plate)
        values = (*self.displacement, self.normal, *forces, self.pressure, self.flux)
        return (value for value in values if isinstance(value, TimeFunction))


class TimePlan(StrictModel):
    """Backward Euler steps; the load is ramped up linearly in ``ramp_increments`` steps of ``ramp_step`` first."""

    end: Time = 100.0
    """End of the simulation."""
    step: Time = 0.5
    """Largest step after the ramp."""
    ramp_increments: Annotated[int, Field(ge=1, le=MOST_TIMES)] = 10
    """The load is brought up linearly in so many increments."""
    ramp_step: Time = 0.05
    """Length of each increment of the ramp."""
    smallest_step: Time = 1e-6
    """Shortest length to which a step that fails is halved."""
    tolerance: Positive | None = None
    """Permitted error of a time step, as a share of the largest displacement and of the largest pressure so far. The
    lengths of the steps follow from it, up to ``step``; null: all are ``step`` long. While a ramp still rises, when
    half of the load acts, the largest values so far count twice, and so on: as much as the whole load would give."""
    profiles: Annotated[tuple[Time, ...], Field(max_length=MOST_TIMES)] = (1.0, 10.0, 40.0)
    """Times at which the fields are kept, beside the end; of the default those that lie before it."""
    load_curve: Annotated[tuple[tuple[Time, float], ...], Field(max_length=MOST_TIMES)] = ()
    """[time, share of the load] at times that are hit exactly, linear in between from 0 at t = 0 and constant after the
    last; empty: up the ramp."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.end <= self.end_of_ramp:
            raise ValueError(
                f"end = {_time(self.end)} does not lie behind the ramp, which takes {_time(self.end_of_ramp)}"
            )
        if (steps := self.end / self.step) > MOST_STEPS:
            raise ValueError(
                f"step = {_time(self.step)} takes {steps:.3g} steps to end = {_time(self.end)}; at most {MOST_STEPS} "
                "are taken: "
                "give a longer step, or an earlier end"
            )
        if "profiles" not in self.model_fields_set:
            # The model is frozen for its users.
            object.__setattr__(self, "profiles", tuple(t for t in self.profiles if t <= self.end))
        for t in self.profiles:
            if t > self.end:
                raise ValueError(
                    f"the profile time {_time(t)} lies behind end = {_time(self.end)}; leave it out of profiles, or "
                    "give a later end"
                )
        times = [time for time, _ in self.load_curve]
        require_later(times, "load_curve")
        if times and times[-1] > self.end:
            raise ValueError(
                f"the last time of load_curve, {_time(times[-1])}, lies behind end = {_time(self.end)}; leave it out, "
                "or give a later end"
            )
        return self

    @property
    def end_of_ramp(self) -> float:
        """Time at which the common ramp has risen."""
        return self.ramp_increments * self.ramp_step

    @property
    def least_steps(self) -> int:
        """Number of steps, if none is shortened."""
        after = self.end - self.end_of_ramp
        return self.ramp_increments + int(after / self.step) + 1

    def share(self, time: float) -> float:
        """Return the share of the load that acts at ``time``."""
        ramp_end = self.end_of_ramp
        if not self.load_curve:
            return min(1.0, time / ramp_end)
        times, shares = zip((0.0, 0.0), *self.load_curve, strict=True)
        return float(np.interp(time, times, shares))


class NewtonSettings(StrictModel):
    """Newton's iteration, which ends at ``tolerance`` times the force and volume scale of the step."""

    tolerance: Positive = 1e-9
    """Residual, relative to the forces and volumes of the step, that ends the iteration."""
    iterations: Annotated[int, Field(ge=1, le=1000)] = 25
    """Iterations at most, before a step is halved."""


class InitialState(StrictModel):
    """Initial state of the body, from which storage and time are counted; it need not be in equilibrium."""

    pressure: Annotated[float, Dimension("pressure")] = 0.0
    """Pore pressure with which the body begins, everywhere."""
    gradient: tuple[Row, Row, Row] = NO_GRADIENT
    """Displacement gradient H with which the body begins, everywhere: u = H X."""


class MacroSetup(StrictModel):
    """A body, its supports and its drains, for any load."""

    body: AnyBody = Box()
    """Shape of the body."""
    surfaces: dict[Name, Patch] = Field(default={})
    """Parts of a surface by names of their own, which no longer belong to that surface."""
    fields: Fields = Field(default={})
    """Values of the cell's parameters by name, as a number, a formula of x, y, z and t or a section; and ``axes``."""
    regions: dict[Name, AnyRegion] = Field(default={})
    """Parts of the body by name, each with parameters and material axes of its own; elsewhere those of the body."""
    charges: Charges | None = None
    """Charges fixed to the solid, in equilibrium with a bath; prescribed pressures of the fluid are then those over the
    osmotic one. null: none."""
    evolution: dict[str, Evolution] = Field(default={})
    """Rates of parameters of the cell that change in the course of a run, by name; ``fields`` have the first values."""
    boundary: dict[Name, Boundary]
    """What is prescribed on each surface; one that is not listed is free of traction and impermeable."""
    contact: dict[Name, RigidIndenter] = Field(default={})
    """Rigid bodies without friction by name, each with a motion or a force and the surfaces that it may touch."""
    body_force: Annotated[tuple[Value, Value, Value], Dimension("body-force")] = (0.0, 0.0, 0.0)
    """Components of the body force, per reference volume of the mixture."""
    initial: InitialState = InitialState()
    """What the body begins with; it need not be in equilibrium."""
    probes: dict[Name, Annotated[tuple[float, float, float], Dimension("displacement")]] = Field(default={})
    """Material points [x, y, z] by name, whose displacement and pressure are recorded."""
    time: TimePlan = TimePlan()
    """Time steps, the ramp of the load, and when fields are kept."""
    newton: NewtonSettings = NewtonSettings()
    """When Newton's iteration of a step ends."""

    @model_validator(mode="after")
    def _plates_are_free_to_move(self) -> MacroSetup:
        for name, boundary in self.boundary.items():
            axis = "xyz".find(name[0]) if name[1:] in ("-", "+") else -1
            if axis >= 0 and boundary.plate is not None and boundary.displacement[axis] is not None:
                raise ValueError(
                    f"the face {name} has both a plate, which is pushed by a force, and a displacement "
                    f"u_{axis + 1}, which moves it as one already; keep one"
                )
        return self

    @property
    def parts(self) -> frozenset[Part]:
        """Those of :data:`PARTS` that are there."""
        faces, none = self.boundary.values(), InitialState()
        there: dict[Part, bool] = {
            "follower": any(face.follower != 0 for face in faces),
            "plate": any(face.plate is not None for face in faces),
            "contact": bool(self.contact),
            "flux": any(face.flux != 0 for face in faces),
            "body_force": any(value != 0 for value in self.body_force),
            "initial": self.initial != none,
            "probes": bool(self.probes),
            "surfaces": bool(self.surfaces),
            "regions": bool(self.regions),
            "fields": bool(self.fields),
            "tolerance": self.time.tolerance is not None,
            "load_curve": bool(self.time.load_curve),
        }
        return frozenset(part for part, is_there in there.items() if is_there)

    @property
    def pressure(self) -> str:
        """Name of the unknown p in words."""
        return pressure_name(self.charges is not None)

    @property
    def is_column(self) -> bool:
        """True for a box whose four sides move along y alone, loaded along y: a problem of one dimension."""
        if self.body.kind != "box" or self.surfaces or self.contact:
            return False
        if self.body_force[0] != 0 or self.body_force[2] != 0:
            return False
        gradient = [row[:i] + row[i + 1 :] for i, row in enumerate(self.initial.gradient)]
        if any(map(any, gradient)) or self.initial.gradient[0][0] or self.initial.gradient[2][2]:
            return False
        for name, face in self.boundary.items():
            along, across = face.displacement[1], (face.displacement[0], face.displacement[2])
            if any(u not in (None, 0) for u in across) or face.traction[0] != 0 or face.traction[2] != 0:
                return False
            if name[0] != "y" and (along is not None or face.traction[1] != 0 or face.follower != 0):
                return False
            if name[0] != "y" and (face.pressure is not None or face.flux != 0 or face.plate is not None):
                return False
        free = Boundary()
        sides = ((name, self.boundary.get(name, free)) for name in ("x-", "x+", "z-", "z+"))
        return all(face.normal == 0 or face.displacement["xyz".index(name[0])] == 0 for name, face in sides)

    @property
    def time_functions(self) -> tuple[TimeFunction, ...]:
        """Time functions among the prescribed values."""
        functions = [function for boundary in self.boundary.values() for function in boundary.time_functions]
        others = (*(indenter.motion for indenter in self.contact.values()), *self.body_force)
        return (*functions, *(value for value in others if isinstance(value, TimeFunction)))

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which a prescribed value or a field has a kink."""
        times = {t for function in self.time_functions for t in function.corners}
        times |= {t for t, _ in self.time.load_curve} | set(field_corners(self))
        if self.charges is not None:
            times |= set(self.charges.corners)
        return tuple(sorted(t for t in times if 0 < t <= self.time.end))

    def specification(self) -> dict[str, Any]:
        """Return the settings that determine the solution; a file counts by its content, not by its path."""
        said = self.model_dump(exclude={"options": True, "body": {"path"}, "regions": True, "fields": True})
        if said["body"]["symmetry"] is None:
            # So it was before there was the key.
            del said["body"]["symmetry"]
        if said["body"].get("flat", "") is None:
            del said["body"]["flat"], said["body"]["depth"]
        if not self.contact:
            del said["contact"]
        said["charges"] = without_paths(said["charges"])
        for name in ("charges", "evolution"):
            if not said[name]:
                del said[name]
        for indenter in said.get("contact", {}).values():
            indenter["shape"].pop("path", None)
        return said | composition(self)

    def with_law_numbers(self, relaxations: Mapping[str | None, Relaxation | None]) -> Self:
        """Return the set-up whose fields have the numbers of its laws, too; those that stand among them already stay.

        Parameters
        ----------
        relaxations
            Those of the cells by name; None names the cell of the rest of the body.
        """
        fields: dict[str, Any] = relaxation_numbers(relaxations[None])
        if self.charges is not None:
            fields[f"{CHARGES}.density"] = self.charges.density
            fields[f"{CHARGES}.bath"] = self.charges.bath_field
        for parameter, evolution in self.evolution.items():
            fields |= {
                f"{EVOLUTION}.{parameter}.{name}": value for name, value in evolution.constants.items()
            }
        own = {
            name: relaxation_numbers(relaxations[region.cell])
            for name, region in self.regions.items()
            if region.cell is not None
        }
        if not fields and not any(own.values()):
            return self
        regions = {
            name: region.model_copy(update={"fields": {**own.get(name, {}), **region.fields}})
            for name, region in self.regions.items()
        }
        return self.model_copy(update={"fields": {**fields, **self.fields}, "regions": regions})

    def ramp(self, time: float) -> float:
        """Return the share of the load that acts at ``time``."""
        return self.time.share(time)

    def factor(self, value: Value, time: float) -> float:
        """Return the factor of a prescribed value at ``time``, without the load: the ramp, or the time function."""
        return value.at(time) if isinstance(value, TimeFunction) else self.ramp(time)


class MacroProblem(MacroSetup):
    """A set-up under one load."""

    load: float = 1.0
    """Factor of every prescribed value."""


def body_mesh(problem: MacroSetup) -> BodyMesh:
    """Return the mesh of the body of ``problem``, with the named parts of its surface.

    Raises
    ------
    ConfigurationError
        The body cannot be meshed, a patch of its surface is of no surface, or a surface is called by its name and its
        number.
    """
    patches = problem.surfaces
    names = {*problem.boundary, *problem.body.symmetry_planes, *(patch.of for patch in patches.values())}
    names |= {name for indenter in problem.contact.values() for name in indenter.surfaces}
    return with_patches(called(make_body(problem.body), names - patches.keys()), patches)
