"""Checkpoint file of a macro solve, and the recorder of its history and profiles.

Unknowns and quadrature points are in the mesh's order, so any backend, on any number of processes, can continue
what another one began: the equations are the same, and so is the solution up to the solver's tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.hdf5 import Contents, atomic_hdf5, numbered, opened
from porocore.errors import DataError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.law import (
    Integrand,
    InternalVariable,
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    columns_of,
)
from porocore.interfaces.solution import CONTACT, History, MacroSolution, Profile, StepWork, read_profile
from porocore.macro.boundary.conditions import Loads
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.composition.regions import EVERYWHERE_ALIKE, BodyFields, CellsAtPoints, kept_cells
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.integration.newton import Predictor, Step
from porocore.macro.integration.stepping import ErrorControl, Stepper, TimeState
from porocore.states import Array, Doubt, MacroState

HISTORY = tuple(f.name for f in fields(History))
#: Column of a contact that is the rate of fluid through its surfaces.
OUTFLOW = [name for name, *_ in CONTACT].index("outflow")
WORK = tuple(f.name for f in fields(StepWork))


class HistoryRecorder:
    """Recorder of history and profiles, the same on every process.

    Parameters
    ----------
    d
        Discretisation.
    variables
        Internal variables of the law, of which the profiles have the means over the elements.

    Attributes
    ----------
    columns
        The fields of :class:`porocore.History`, then those of probes, reactions, inflows, contacts and linear solver,
        by name.
    rows
        Values in this order.
    profiles
        In the order of time.
    probe
        Sparse (4 probes, unknowns), from all unknowns to u_1, u_2, u_3 and p of each probe.
    """

    def __init__(self, d: Discretisation, variables: Sequence[InternalVariable] = ()) -> None:
        self.d, self._variables = d, tuple(variables)
        self.rows: list[tuple[float, ...]] = []
        self.profiles: list[Profile] = []
        self.probe = interpolation(d.mesh, d.problem.probes)
        self._groups = (
            *((f"probes/{name}", 4) for name in d.problem.probes),
            *((f"reactions/{name}", 3) for name in d.boundary.supports),
            *((f"inflow/{name}", 1) for name in d.boundary.drains),
            *((f"contact/{each.name}", len(CONTACT)) for each in d.boundary.contacts),
            *((f"work/{name}", 1) for name in WORK),
        )
        self.columns = (*HISTORY, *(f"{name}/{i}" for name, width in self._groups for i in range(width)))

    def column(self, name: str) -> Array:
        """Return one quantity against time, (steps,)."""
        return np.array([row[self.columns.index(name)] for row in self.rows])

    def add_start(self, x: Array, response: MacroResponse) -> None:
        """Add the initial state, t = 0."""
        d, whole = self.d, self.d.to_mesh(x)
        start = dict.fromkeys(HISTORY, 0.0)
        start |= {**_flagged(d, response), "stress_spread": _spread(d, response)}
        start |= self._extremes(whole)
        sums = [np.zeros(3 * len(d.boundary.supports) + len(d.boundary.drains))]
        loads = d.loads_at(0.0)
        if d.origin is not None:  # a state of equilibrium, with the forces that hold it
            still = replace(response, storage=0.0 * response.storage)
            sums = self.sums(d.residual(still, 1.0, loads, x).values, still, 1.0)
        touched = [state.measured() for state in d.contact_states(whole, loads)]
        extra = np.concatenate([self.probe @ whole, *sums, *touched, np.zeros(len(WORK))])
        self.rows.append((*(start[name] for name in HISTORY), *map(float, extra)))
        self.add_profile(x, response, 0.0, loads)

    def add_step(self, step: Step, time: float, dt: float, loads: Loads, work: StepWork) -> None:
        """Add an accepted step that ended at ``time``, and what the linear solver did for it."""
        d, response = self.d, step.response
        last = dict(zip(HISTORY, self.rows[-1], strict=False))
        squeezed = -float(d.communicator.sum(float(d.weights @ (response.storage / response.volume_ratio))))
        x = d.to_mesh(step.x)
        touched = [state.measured() for state in d.contact_states(x, loads)]
        seeped = dt * sum(float(each[OUTFLOW]) for each in touched)
        row = {
            "time": time,
            "ramp": d.problem.ramp(time),
            "drained_paper": last["drained_paper"] + squeezed,
            "drained": last["drained"] + self.outflow(step.residual.values, loads, dt) + seeped,
            **_flagged(d, response),
            "stress_spread": _spread(d, response),
            "iterations": float(step.iterations),
        }
        row |= self._extremes(x)
        sums = self.sums(step.residual.values, response, dt)
        extra = np.concatenate([self.probe @ x, *sums, *touched, [getattr(work, name) for name in WORK]])
        self.rows.append((*(row[name] for name in HISTORY), *map(float, extra)))

    def outflow(self, residual: Array, loads: Loads, dt: float) -> float:
        """Return the volume that has left through the boundary in a step, linear in residual and loads."""
        d = self.d
        # In the rows of prescribed pressure the residual is what has flowed in through the boundary.
        held = d.prescribed[~d.is_force[d.prescribed] & (d.prescribed < d.owned)]
        return dt * d.outflow(loads) - float(d.communicator.sum(float(residual[held].sum())))

    def sums(self, values: Array, response: Integrand, dt: float) -> list[Array]:
        """Return the forces (3,) on the surfaces that are held, then inflows (1,) through those with a pressure.

        They are linear in the residual's ``values`` and the response.
        """
        d = self.d
        residual = d.to_mesh(values)
        supports, drains = d.boundary.supports.values(), d.boundary.drains.values()
        stress = d.all_means(response.stress) if any(each.needs_field for each in supports) else None
        inward = -d.all_means(response.flux) if any(each.needs_field for each in drains) else None
        forces = [each.total(residual, stress) for each in supports]
        return forces + [each.total(residual / dt, inward) for each in drains]

    def _extremes(self, x: Array) -> dict[str, float]:
        n_u = self.d.mesh.n_u
        # No −0 at rest.
        found = {name: sign * float(x[i]) + 0.0 for name, (i, sign) in extremes(x, n_u).items()}
        return found | {"displacement": float(np.linalg.norm(x[:n_u].reshape(-1, 3), axis=1).max())}

    def add_profile(self, unknowns: Array, response: MacroResponse, time: float, loads: Loads) -> None:
        """Add the fields at ``time``: nodal values, and means over the elements."""
        d, x = self.d, self.d.to_mesh(unknowns)
        states, remembered = response.memory.states, response.memory.internal
        columns = columns_of(self._variables)
        pressed = np.zeros(len(d.mesh.points))
        for contact in d.contact_states(x, loads):
            pressed += contact.nodal_pressure()
        self.profiles.append(
            Profile(
                time=time,
                u=x[: d.mesh.n_u].reshape(-1, 3),
                p=d.mesh.pressure_everywhere(x[d.mesh.n_u :]),
                grad_u=d.all_means(states.grad_u),
                mean_grad=d.all_means(response.mean_grad),
                deformation=d.all_means(response.deformation),
                conductivity=d.all_means(response.transformed_conductivity),
                stress=d.all_means(response.stress),
                flux=d.all_means(response.flux),
                element_p=d.all_means(states.p),
                cell_p=d.all_means(response.cell_p),
                internal={
                    each.name: d.all_means(remembered[:, columns[each.name]].reshape(-1, *each.shape))
                    for each in self._variables
                },
                flagged=d.all_means(response.flagged.astype(float)),
                fluid_volume=d.all_means(response.memory.fluid_volume),
                contact_pressure=pressed,
            )
        )

    def solution(self, law: str, body: BodyFields) -> MacroSolution:
        """Return history and profiles with the mesh, and the cells of its elements by the fields of the ``body``."""
        mesh = self.d.mesh
        history = History(**{name: self.column(name) for name in HISTORY})
        series: dict[str, dict[str, Array]] = {"probes": {}, "reactions": {}, "inflow": {}}
        series |= {"contact": {}, "work": {}}
        for path, width in self._groups:
            kind, _, name = path.partition("/")
            series[kind][name] = np.stack([self.column(f"{path}/{i}") for i in range(width)], axis=1)
        return MacroSolution(
            law,
            self.d.problem.load,
            mesh.points,
            mesh.cells,
            history,
            tuple(self.profiles),
            probes=series["probes"],
            reactions=series["reactions"],
            inflow={name: values[:, 0] for name, values in series["inflow"].items()},
            contact=series["contact"],
            work={name: values[:, 0] for name, values in series["work"].items()},
            linear_solver=self.d.linear.choice,
            element_cells=self._cells(body),
            revolved=mesh.revolved,
            depth=mesh.depth,
            quantities={each.name: each.quantity for each in self._variables},
        )

    def _cells(self, body: BodyFields) -> ElementCells | None:
        """Return the cells of the elements: they follow from the times, but for parameters that evolve."""
        times, names = [each.time for each in self.profiles], tuple(self.d.problem.regions)
        found = kept_cells(body, names, times, self.d.all_means)
        if found is None:
            return None
        for name in (each.name for each in self._variables if each.name in found.parameters):
            found = found.evolved(name, np.stack([profile.internal[name] for profile in self.profiles]))
        return found


def extremes(x: Array, n_u: int) -> dict[str, tuple[int, float]]:
    """Return the unknown that each extreme of the history is, and its sign, by the extreme's name.

    Parameters
    ----------
    x : (unknowns,)
        A solution in the mesh's order.
    n_u
        Number of displacements, which come first.
    """
    u_y, p = x[1:n_u:3], x[n_u:]
    return {
        "settlement": (1 + 3 * int(u_y.argmin()), -1.0),
        "heave": (1 + 3 * int(u_y.argmax()), 1.0),
        "pressure_max": (n_u + int(p.argmax()), 1.0),
        "pressure_min": (n_u + int(p.argmin()), 1.0),
    }


def _flagged(d: Discretisation, response: MacroResponse) -> dict[str, float]:
    """Return the share of the body that is flagged, and that for each reason."""
    rows = {"flagged": response.flagged}
    rows |= {f"flagged_{each.name}": (response.doubt & each) != 0 for each in Doubt}
    volume, *parts = d.communicator.sum(
        np.array([d.weights.sum(), *(d.weights[flagged].sum() for flagged in rows.values())])
    )
    return {name: float(part / volume) for name, part in zip(rows, parts, strict=True)}


def _spread(d: Discretisation, response: MacroResponse) -> float:
    """Return the largest deviation of the element means of P_E,22 from the body's mean."""
    means, volumes = d.means(response.stress[:, 1, 1]), d.mesh.weights[d.elements].sum(axis=1)
    weighted, volume = d.communicator.sum(np.array([volumes @ means, volumes.sum()]))
    mean = weighted / volume
    return d.communicator.max(float(np.abs(means - mean).max(initial=0.0)))


FORMAT, VERSION = "porocore-macro-checkpoint", 10
#: What is kept of the time stepping.
STEPPER: dict[str, Any] = {"time": float, "halvings": int, "streak": int, "proposed": float}
#: What is kept of a response, with the shape of a point: the memory but for internal variables, parameters and places
#: of its states; and an answer of the law, by which it is known again.
RESPONSE = {
    "memory/states/grad_u": (3, 3),
    "memory/states/p": (),
    "memory/fluid_volume": (),
    "mean_grad": (3, 3),
}
#: No step is halved more often: 2 to this power is still a number.
MOST_HALVINGS = 1000
#: A law whose answers moved by more than this is another one; machines differ by round-off only.
SAME_LAW = 1e-8
#: What makes a checkpoint anew, and the advice on one of something else.
AGAIN = "start anew"
OTHER = "move it elsewhere to start anew"


class CheckpointFile:
    """Checkpoint of one solve, written every ``seconds`` of wall time and at the end; without a path there is none."""

    def __init__(
        self,
        path: Path | None,
        d: Discretisation,
        law: MacroLaw,
        seconds: float,
        body: BodyFields | None = None,
    ) -> None:
        self._path, self._d, self._law, self._seconds, self._body = path, d, law, seconds, body
        # Everything that determines the solution.
        text = f"{json.dumps(d.problem.specification())}|{law.name}|{law.identity}"
        self._owner, self._written = stable_hash(text), monotonic()

    def load(
        self, stepper: Stepper, control: ErrorControl, predictor: Predictor
    ) -> tuple[Array, LawMemory, HistoryRecorder] | None:
        """Return unknowns, memory and record, and set ``stepper``, ``control`` and ``predictor``; None without a file.

        Raises
        ------
        DataError
            The file is truncated or foreign, or belongs to another problem or law.
        """
        d, law, path = self._d, self._law, self._path
        if path is None or not d.communicator.on_root(path.exists):
            return None
        record = HistoryRecorder(d, law.internal)
        whole, known, rows, profiles, step, rate, before, (times, earlier), origin = d.communicator.on_root(
            partial(self._read, path, record.columns, len(control.scales))
        )
        control.length, control.scales = before
        if rate is not None:
            control.rate = TimeState(rate.x[d.unknowns], d.points_from_mesh(rate.internal))
        x = whole[d.unknowns]
        d.origin = None if origin is None else origin[d.unknowns]
        predictor.times, predictor.states = times, [*(state[d.unknowns] for state in earlier), x]
        for name, value in step.items():
            setattr(stepper, name, value)
        grad_u, p, fluid_volume, answer, internal = map(d.points_from_mesh, known)
        # Parameters and places follow from the time.
        states = self._fields(stepper.time).given_to(MacroState(grad_u, p))
        memory, at_once = LawMemory(states, fluid_volume, internal), Interval(stepper.time, stepper.time)
        again = law.respond(states, np.zeros((d.n_points, 3)), memory, step=at_once, tangent=False).mean_grad
        scale = max(d.communicator.max(float(np.abs(answer).max(initial=0.0))), 1.0)
        moved = float(np.abs(again - answer).max(initial=0.0))
        if not d.communicator.max(np.inf if np.isnan(moved) else moved) <= SAME_LAW * scale:
            raise DataError(
                f"{path}: the law '{law.name}' answers differently from when this was written; {OTHER}"
            )
        record.rows, record.profiles = [tuple(map(float, row)) for row in rows], profiles
        self._written = monotonic()
        return x, memory, record

    def _read(self, path: Path, columns: tuple[str, ...], scales: int) -> tuple[Any, ...]:
        mesh = self._d.mesh
        with opened(path, "macro checkpoint", AGAIN) as file:
            if not file.is_of(FORMAT, VERSION):
                raise DataError(f"{path}: expected a macro checkpoint of version {VERSION}; {OTHER}")
            if file.attribute("identity", str) != self._owner:
                raise DataError(f"{path}: this checkpoint belongs to another macro problem or law; {OTHER}")
            whole = file.array("x", mesh.size)
            points, v = mesh.weights.size, self._law.memory_size
            known = [file.array(name, points, *shape) for name, shape in RESPONSE.items()]
            known.append(file.array("memory/internal", points, v))
            rows = file.array("history", "steps", len(columns))
            if not len(rows):
                raise ValueError("'history' is empty")
            rate = None
            if "rate" in file:
                rate = TimeState(file.array("rate/x", mesh.size), file.array("rate/internal", points, v))
            step = _read_stepping(file, float(rows[-1, columns.index("time")]))
            before = file.attribute("length", float), file.attribute("scales", float, scales)
            if min(before[0], *before[1]) < 0:
                raise ValueError("attributes 'length' and 'scales' are those of no step")
            profiles = [read_profile(file, name) for name in numbered(file, "profiles")]
            shapes = {each.name: each.shape for each in self._law.internal}
            if any({k: v.shape[1:] for k, v in each.internal.items()} != shapes for each in profiles):
                raise ValueError("'profiles' have not the internal variables of the law")
            earlier = _read_earlier(file, step["time"], mesh.size)
            origin = file.array("origin", mesh.size) if "origin" in file else None
            return whole, known, rows, profiles, step, rate, before, earlier, origin

    def save_if_due(
        self,
        stepper: Stepper,
        control: ErrorControl,
        predictor: Predictor,
        x: Array,
        response: MacroResponse,
        record: HistoryRecorder,
    ) -> None:
        """Write the state after an accepted step where it is due, atomically."""
        d, path = self._d, self._path
        # The clocks of two processes differ, so one of them decides.
        if path is None or not (d.communicator.on_root(self._is_late) or stepper.done):
            return
        arrays = {"x": d.gathered(x)}
        if d.origin is not None:
            arrays["origin"] = d.gathered(d.origin)
        if control.rate is not None:
            arrays["rate/x"] = d.gathered(control.rate.x)
            arrays["rate/internal"] = d.points_to_mesh(control.rate.internal)
        arrays["times"] = np.array(predictor.times)
        arrays["earlier"] = np.array([d.gathered(state) for state in predictor.states[:-1]])
        for name in (*RESPONSE, "memory/internal"):
            arrays[name] = d.points_to_mesh(attrgetter(name.replace("/", "."))(response))

        def write() -> None:
            with atomic_hdf5(path) as file:
                file.attrs.update(format=FORMAT, version=VERSION, identity=self._owner)
                file.attrs.update({name: getattr(stepper, name) for name in STEPPER})
                file.attrs.update(length=control.length, scales=control.scales)
                for name, value in arrays.items():
                    file[name] = value
                file["history"] = np.array(record.rows)
                for i, profile in enumerate(record.profiles):
                    profile.write(file, f"profiles/{i}")

        d.communicator.on_root(write)
        self._written = monotonic()

    def _fields(self, time: float) -> CellsAtPoints:
        return EVERYWHERE_ALIKE if self._body is None else self._body.at(time)

    def _is_late(self) -> bool:
        return monotonic() >= self._written + self._seconds


def _read_stepping(file: Contents, last: float) -> dict[str, Any]:
    """Return the time stepping after a step that ended at ``last``; ValueError where it would end early or never."""
    found = {name: file.attribute(name, kind, finite=name != "proposed") for name, kind in STEPPER.items()}
    if found["time"] != last:
        raise ValueError(f"attribute 'time' is {found['time']:g}, but the last step ended at {last:g}")
    if not 0 <= found["halvings"] <= MOST_HALVINGS or found["streak"] < 0 or found["proposed"] <= 0:
        raise ValueError("attributes 'halvings', 'streak' and 'proposed' are those of no step")
    return found


def _read_earlier(file: Contents, time: float, size: int) -> tuple[list[float], Array]:
    """Return the times of the predictor's states, of which ``time`` is the last, and all states but that."""
    times = [float(value) for value in file.array("times", "states")]
    if not times or times[-1] != time or (np.diff(times) <= 0).any():
        raise ValueError("'times' are no times of states up to the last step")
    count = len(times) - 1
    return times, file.array("earlier", count, size) if count else np.empty((0, size))
