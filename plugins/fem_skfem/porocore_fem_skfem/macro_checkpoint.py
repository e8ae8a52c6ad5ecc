"""The state of a running macro solve in one HDF5 file, so that it can be continued to the same solution."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from porocore.errors import DataError
from porocore.hdf5 import atomic_hdf5
from porocore.laws import LawMemory, MacroLaw
from porocore.problem import MacroProblem
from porocore.solution import Profile
from porocore.stepping import Stepper
from porocore_fem_skfem.macro_record import HISTORY, PROFILE, Record

FORMAT, VERSION = "porocore-skfem-macro-checkpoint", 1
#: A law whose answers moved by more than this is another one; machines differ by round-off only.
SAME_LAW = 1e-8


def identity(problem: MacroProblem, law: MacroLaw) -> str:
    """Hash of everything that determines the solution."""
    text = f"{problem.model_dump_json()}|{law.name}|{law.identity}"
    return hashlib.sha256(text.encode()).hexdigest()


def save(path: Path, owner: str, stepper: Stepper, x: Any, memory: LawMemory, record: Record) -> None:
    """Write the state after an accepted step, atomically; ``owner`` is :func:`identity`."""
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, identity=owner)
        file.attrs.update(time=stepper.time, halvings=stepper.halvings, streak=stepper.streak)
        file["x"] = x
        for name, value in _arrays(memory, "memory"):
            file[name] = value
        file["history"] = np.array(record.rows)
        for i, profile in enumerate(record.profiles):
            for name in PROFILE:
                file[f"profiles/{i}/{name}"] = getattr(profile, name)


def load(
    path: Path, owner: str, stepper: Stepper, x: Any, law: MacroLaw, points: int
) -> tuple[Any, LawMemory, Record]:
    """Read what :func:`save` wrote: unknowns, memory and record; sets ``stepper``.

    ``x`` (unknowns at rest) and ``points`` (of the quadrature) tell what shapes are expected.

    Raises
    ------
    DataError
        The file is truncated or foreign, or belongs to another problem or law.
    """
    again = "remove it to start anew"
    try:
        with h5py.File(path) as file:
            if file.attrs.get("format") != FORMAT or file.attrs.get("version") != VERSION:
                raise DataError(f"{path}: expected a macro checkpoint of version {VERSION}; {again}")
            if file.attrs["identity"] != owner:
                raise DataError(f"{path}: this checkpoint belongs to another macro problem or law; {again}")
            state = _read(file, "x", x.shape)
            memory = _filled(file, law.initial(points), "memory")
            rows = _read(file, "history", (None, len(HISTORY)))
            profiles = [_profile(group) for _, group in sorted(file.get("profiles", {}).items(), key=_number)]
            stepper.time = float(file.attrs["time"])
            stepper.halvings, stepper.streak = int(file.attrs["halvings"]), int(file.attrs["streak"])
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise DataError(f"{path}: not a complete macro checkpoint ({error}); {again}") from error
    answer = law.respond(memory.states, np.zeros((points, 3)), memory, tangent=False).memory.mean_grad
    scale = max(float(np.abs(memory.mean_grad).max()), 1.0)
    if not np.allclose(answer, memory.mean_grad, rtol=0, atol=SAME_LAW * scale):
        raise DataError(
            f"{path}: the law '{law.name}' answers differently from when this was written; {again}"
        )
    return state, memory, Record([tuple(map(float, row)) for row in rows], profiles)


def _number(item: tuple[str, Any]) -> int:
    return int(item[0])


def _profile(group: Any) -> Profile:
    values = {name: np.asarray(group[name]) for name in PROFILE}
    return Profile(**(values | {"time": float(values["time"])}))


def _read(file: Any, name: str, shape: tuple[int | None, ...]) -> Any:
    value = np.asarray(file[name])
    if value.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, value.shape, strict=True)
    ):
        raise ValueError(f"'{name}' has shape {value.shape}")
    return value


def _arrays(batch: Any, prefix: str) -> list[tuple[str, Any]]:
    """Names and arrays of a dataclass of arrays, nested ones included; fields that are None are left out."""
    found: list[tuple[str, Any]] = []
    for f in fields(batch):
        value, name = getattr(batch, f.name), f"{prefix}/{f.name}"
        if is_dataclass(value):
            found += _arrays(value, name)
        elif value is not None:
            found.append((name, value))
    return found


def _filled(file: Any, template: Any, prefix: str) -> Any:
    """A dataclass like ``template`` with the arrays of the file."""
    values: dict[str, Any] = {}
    for f in fields(template):
        value, name = getattr(template, f.name), f"{prefix}/{f.name}"
        if is_dataclass(value):
            values[f.name] = _filled(file, value, name)
        else:
            values[f.name] = None if value is None else _read(file, name, value.shape)
    return type(template)(**values)
