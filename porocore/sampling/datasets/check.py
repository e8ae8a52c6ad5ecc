"""Checks of a dataset: file, arrays, and laws of every cell such as reciprocity and symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from porocore.core.fields.check import known_statuses, rows_as_declared
from porocore.errors import DataError
from porocore.interfaces.records import flatten_response
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.datasets.layout import read_fields
from porocore.sampling.warm_starts import OF_SAMPLES
from porocore.states import CELL_FIELDS, Array, CellResponse, MacroState, Status

#: Largest misfit of a law, relative to the largest entry of what is compared.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class DatasetCheck:
    """Result of one check: its name, whether it holds, and what was found."""

    name: str
    holds: bool
    detail: str


def check_file(path: Path, tolerance: float = TOLERANCE, *, named: bool = False) -> list[DatasetCheck]:
    """Check every array of the dataset at ``path``; a file that cannot be read fails one check.

    ``named`` is that of :meth:`Dataset.open`.
    """
    try:
        dataset = Dataset.open(path, sound=False, named=named)
        fields = list(read_fields(dataset.rows()))
    except DataError as error:
        return [DatasetCheck("readable", False, str(error))]
    n = len(dataset)
    findings = [DatasetCheck("readable", True, f"{n} states, {sum(f is not None for f in fields)} with u¹")]
    findings.append(DatasetCheck("keys unique", True, f"{n} keys"))  # otherwise it could not be read
    if not n:
        return findings
    response, states = dataset.responses(), dataset.states()
    keys = np.array(dataset.keys)
    valid = response.valid
    known = known_statuses(response.status)
    findings.append(_all("statuses known", known, keys, "a status that this version does not know"))
    findings.append(
        _all("finite", _finite(response), keys, "values where none belong, or none where they do")
    )
    findings += _places(dataset, states, keys)
    kept = np.array([f is None or _at(f.grad_u, f.p, states, i) for i, f in enumerate(fields)])
    findings.append(_all("fields of their states", kept, keys, "u¹ of another state"))
    held = {key for key, f in zip(dataset.keys, fields, strict=True) if f is not None}
    started = np.array(
        [start is None or start in held or start.startswith(OF_SAMPLES) for start in dataset.starts()]
    )
    findings.append(_all("starts kept", started, keys, "a start whose u¹ is not in the file"))
    if response.extrema is not None:
        upright = ~valid | (response.extrema.min_jacobian > 0)
        findings.append(_all("J > 0", upright, keys, "a smallest J that is not positive"))
    if response.conductivity is not None:
        K = np.where(np.isfinite(response.conductivity), response.conductivity, np.eye(3))
        same = np.abs(K - K.transpose(0, 2, 1)).max(axis=(1, 2)) <= tolerance * np.abs(K).max(axis=(1, 2))
        # A pore that is closed in some direction has an eigenvalue of zero.
        positive = np.linalg.eigvalsh((K + K.transpose(0, 2, 1)) / 2)
        same &= positive[:, 0] >= -tolerance * positive[:, 2]
        findings.append(_all("K positive", same, keys, "a conductivity that is not symmetric and positive"))
    return findings + _laws(response, keys, tolerance)


def _places(dataset: Dataset, states: MacroState, keys: Array) -> list[DatasetCheck]:
    x, inputs = dataset.x(), dataset.inputs
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    slack = 1e-12 * (high - low)
    inside = ((x >= low - slack) & (x <= high + slack)).all(axis=1)
    same = np.ones(len(x), dtype=bool)
    for i, row in enumerate(x):
        expected = inputs.scatter(tuple(map(float, row)))
        same[i] = all(map(np.array_equal, expected.arrays(), states[i : i + 1].arrays()))
    return [
        _all("within the ranges", inside, keys, "inputs outside the ranges of the file"),
        _all("states of their inputs", same, keys, "H, p or parameters that its inputs do not give"),
    ]


def _laws(response: CellResponse, keys: Array, tolerance: float) -> list[DatasetCheck]:
    """Check ∂P_E/∂p = −∂φ/∂H and ∂P_E/∂H = (∂P_E/∂H)ᵀ: both are second derivatives of W(H, p)."""
    tangent, rows = response.tangent, np.flatnonzero(response.valid)
    if tangent is None or not len(rows):
        return []
    findings = []
    if tangent.stress_p is not None and tangent.fluid_volume_grad_u is not None:
        ours, theirs = tangent.stress_p[rows], -tangent.fluid_volume_grad_u[rows]
        findings.append(_law("∂P_E/∂p = −∂φ/∂H", ours, theirs, keys[rows], tolerance))
    if tangent.stress_grad_u is not None:
        A = tangent.stress_grad_u[rows].reshape(-1, 9, 9)
        findings.append(_law("∂P_E/∂H symmetric", A, A.transpose(0, 2, 1), keys[rows], tolerance))
    return findings


def _law(name: str, ours: Array, theirs: Array, keys: Array, tolerance: float) -> DatasetCheck:
    n = len(ours)
    scale = np.abs(theirs.reshape(n, -1)).max(axis=1)
    misfit = np.abs(ours - theirs).reshape(n, -1).max(axis=1) / np.where(scale > 0, scale, 1.0)
    # A misfit that is no number fails too.
    worst = int(np.argmax(np.where(np.isnan(misfit), np.inf, misfit)))
    holds = bool((misfit <= tolerance).all())
    return DatasetCheck(
        name, holds, f"largest misfit {misfit[worst]:.1e} (state '{keys[worst]}', allowed {tolerance:.0e})"
    )


def _finite(response: CellResponse) -> npt.NDArray[np.bool_]:
    valid, unstable = response.valid, response.status == Status.unstable
    good = np.ones(len(response), dtype=bool)
    for name, array in flatten_response(response).items():
        good &= rows_as_declared(CELL_FIELDS[name], array, valid, unstable)
    return good


def _at(grad_u: Array, p: float, states: MacroState, row: int) -> bool:
    return bool(np.array_equal(grad_u, states.grad_u[row])) and p == float(states.p[row])


def _all(name: str, good: npt.NDArray[np.bool_], keys: Array, what: str) -> DatasetCheck:
    wrong = keys[~good]
    if not len(wrong):
        return DatasetCheck(name, True, f"all {len(keys)}")
    return DatasetCheck(name, False, f"{len(wrong)} of {len(keys)} states have {what}, such as '{wrong[0]}'")
