"""Checkpoint file of a macro solve: writing when due, reading, refusal of another problem or law.

Unknowns and quadrature points are in the mesh's order, so any backend, on any number of processes, can continue
what another one began: the equations are the same, and so is the solution up to the solver's tolerance.
"""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.hdf5 import atomic_hdf5, opened
from porocore.core.hdf5.contents import Contents, numbered
from porocore.errors import DataError
from porocore.interfaces.law import LawMemory, MacroLaw
from porocore.interfaces.solution import file_name, read_profile
from porocore.macro.composition.body_fields import EVERYWHERE_ALIKE, BodyFields, CellsAtPoints
from porocore.macro.integration.adaptive import ErrorControl
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.integration.predictor import Predictor
from porocore.macro.integration.recorder import PROFILE, HistoryRecorder
from porocore.macro.integration.stepping import Stepper
from porocore.states import Array, MacroState

FORMAT, VERSION = "porocore-macro-checkpoint", 6
#: What is kept of the time stepping.
STEPPER: dict[str, Any] = {"time": float, "halvings": int, "streak": int, "proposed": float}
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
        record = HistoryRecorder(d)
        whole, memories, rows, profiles, step, rate, before, (times, earlier) = d.communicator.on_root(
            partial(self._read, path, record.columns, len(control.scales))
        )
        control.length, control.scales = before
        control.rate = None if rate is None else rate[d.unknowns]
        x = whole[d.unknowns]
        predictor.times, predictor.states = times, [*(state[d.unknowns] for state in earlier), x]
        for name, value in step.items():
            setattr(stepper, name, value)
        known = {name: d.points_from_mesh(values) for name, values in memories.items()}
        memory = _filled(self._memory_of_a_point(), known, "memory")
        # Parameters and places follow from the time.
        memory = replace(memory, states=self._fields(stepper.time).given_to(memory.states))
        answer = law.respond(memory.states, np.zeros((d.n_points, 3)), memory, tangent=False).memory.mean_grad
        scale = max(float(np.abs(memories["memory/mean_grad"]).max()), 1.0)
        moved = float(np.abs(answer - memory.mean_grad).max(initial=0.0))
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
            memories = {
                name: file.array(name, mesh.weights.size, *value.shape[1:])
                for name, value in _arrays(self._memory_of_a_point(), "memory")
            }
            rows = file.array("history", "steps", len(columns))
            if not len(rows):
                raise ValueError("'history' is empty")
            rate = file.array("rate", mesh.size) if "rate" in file else None
            step = _read_stepping(file, float(rows[-1, columns.index("time")]))
            before = file.attribute("length", float), file.attribute("scales", float, scales)
            if min(before[0], *before[1]) < 0:
                raise ValueError("attributes 'length' and 'scales' are those of no step")
            profiles = [read_profile(file, name) for name in numbered(file, "profiles")]
            earlier = _read_earlier(file, step["time"], mesh.size)
            return whole, memories, rows, profiles, step, rate, before, earlier

    def save_if_due(
        self,
        stepper: Stepper,
        control: ErrorControl,
        predictor: Predictor,
        x: Array,
        memory: LawMemory,
        record: HistoryRecorder,
    ) -> None:
        """Write the state after an accepted step where it is due, atomically."""
        d, path = self._d, self._path
        # The clocks of two processes differ, so one of them decides.
        if path is None or not (d.communicator.on_root(self._is_late) or stepper.done):
            return
        arrays = {"x": d.gathered(x)}
        if control.rate is not None:
            arrays["rate"] = d.gathered(control.rate)
        arrays["times"] = np.array(predictor.times)
        arrays["earlier"] = np.array([d.gathered(state) for state in predictor.states[:-1]])
        kept = {name for name, _ in _arrays(self._memory_of_a_point(), "memory")}
        arrays |= {name: d.points_to_mesh(value) for name, value in _arrays(memory, "memory") if name in kept}

        def write() -> None:
            with atomic_hdf5(path) as file:
                file.attrs.update(format=FORMAT, version=VERSION, identity=self._owner)
                file.attrs.update({name: getattr(stepper, name) for name in STEPPER})
                file.attrs.update(length=control.length, scales=control.scales)
                for name, value in arrays.items():
                    file[name] = value
                file["history"] = np.array(record.rows)
                for i, profile in enumerate(record.profiles):
                    for name in PROFILE:
                        file[f"profiles/{i}/{file_name(name)}"] = getattr(profile, name)

        d.communicator.on_root(write)
        self._written = monotonic()

    def _fields(self, time: float) -> CellsAtPoints:
        return EVERYWHERE_ALIKE if self._body is None else self._body.at(time)

    def _memory_of_a_point(self) -> LawMemory:
        """Return a memory with the fields that are kept: all but parameters and places of the states."""
        points = MacroState.zeros(self._d.n_points)
        rest = self._law.initial_at(self._fields(0.0).given_to(points)[:1])
        return replace(rest, states=points[:1])

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


def _arrays(batch: Any, prefix: str) -> list[tuple[str, Any]]:
    """Return names and arrays of a nested dataclass of arrays; fields that are None are left out."""
    found: list[tuple[str, Any]] = []
    for f in fields(batch):
        value, name = getattr(batch, f.name), f"{prefix}/{f.name}"
        if is_dataclass(value):
            found += _arrays(value, name)
        elif value is not None:
            found.append((name, value))
    return found


def _filled(template: Any, arrays: dict[str, Any], prefix: str) -> Any:
    """Return a dataclass like ``template`` with other arrays."""
    values: dict[str, Any] = {}
    for f in fields(template):
        value, name = getattr(template, f.name), f"{prefix}/{f.name}"
        values[f.name] = _filled(value, arrays, name) if is_dataclass(value) else arrays.get(name)
    return type(template)(**values)
