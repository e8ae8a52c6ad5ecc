"""Errors of a surrogate on held-out states, for each component of its outputs that varies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from porocore.core.inputs.sampled_range import SampledRange
from porocore.interfaces.surrogate import Surrogate
from porocore.plugins.border import prediction_of
from porocore.report.words.held_out import OutputCheck
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, MacroState
from porocore.study.preflight.symmetry_notes import LARGEST_DEFECT

#: An output whose values span less than this is zero up to the cell solver's tolerance and is not judged.
FLAT = 1e-9
#: A component that varies by less than this share of the largest of its tensor is zero up to the mesh, and not judged.
NOTHING = 1e-3
_SUBSCRIPTS = "₁₂₃"
#: Responses of a cell that have a unit.
_QUANTITIES = {"stress": "stress", "conductivity": "conductivity"}


def output_checks(
    dataset: Dataset, held_out: Dataset, surrogate: Surrogate, in_body: MacroState | None = None
) -> tuple[OutputCheck, ...]:
    """Compare the surrogate with the held-out states, for each predicted component that varies.

    ``in_body`` are the states of the body, which tell how much of a component's range the body uses.
    """
    used = None if in_body is None else prediction_of(surrogate, in_body, tangent=False)
    trained, tested = dataset.responses(), held_out.responses()
    training = trained.stable
    solved = np.flatnonzero(tested.stable)
    states = held_out.states()[solved]
    predicted = prediction_of(surrogate, states, tangent=False)
    outside = SampledRange.around(dataset.inputs, dataset.x()[training]).outside(states)
    checks = []
    for field, at, name, plain in _outputs():
        quantity = _QUANTITIES.get(field, "")
        every, exact, guess = (getattr(response, field) for response in (trained, tested, predicted))
        if every is None or exact is None or guess is None:
            continue
        # Some states have no conductivity of the deformed pore; its scale is that of the viscosity.
        taught, found = every[training][at], exact[solved][at]
        taught, known = taught[np.isfinite(taught)], np.isfinite(found)
        span = float(np.ptp(taught)) if len(taught) else 0.0
        flat = FLAT * (float(np.nanmax(np.abs(every[training]))) if field == "conductivity" else 1.0)
        if known.any() and span >= max(flat, _nothing(every[training], guess[at][known])):
            ends = None if used is None else _ends(getattr(used, field)[at])
            theta = None if states.parameters is None else states.parameters[known]
            shown = found[known], guess[at][known], span, outside[known]
            checks.append(OutputCheck(name, plain, *shown, quantity, ends, theta))
    return tuple(checks)


def _ends(values: Array) -> tuple[float, float] | None:
    """Return least and largest of the values that are finite."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else None


def _nothing(taught: Array, guess: Array) -> float:
    """Return the span up to which a component is zero by symmetry, given all of its tensor and its predictions.

    It varies by the error of the mesh, which is no error of the surrogate. A mesh that breaks the symmetry by more is
    warned of.
    """
    largest = float(np.nanmax(np.ptp(taught.reshape(len(taught), -1), axis=0), initial=0.0))
    return (LARGEST_DEFECT if np.ptp(guess) <= FLAT * largest else NOTHING) * largest


def _outputs() -> Iterator[tuple[str, Any, str, str]]:
    """Yield field of the response, index of a component, and its name in mathematics and in plain text."""
    for i, j in np.ndindex(3, 3):
        name, plain = (
            rf"$\langle\nabla_Y u^1\rangle_{{{i + 1}{j + 1}}}$",
            f"⟨∇u¹⟩{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}",
        )
        yield "mean_grad", (slice(None), i, j), name, plain
    for i, j in np.ndindex(3, 3):
        yield "stress", (slice(None), i, j), f"$P_{{E,{i + 1}{j + 1}}}$", f"P_E,{i + 1}{j + 1}"
    yield "fluid_volume", slice(None), r"$\varphi$", "fluid volume φ"
    for i, j in zip(*np.triu_indices(3), strict=True):
        plain = f"K{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}"
        yield "conductivity", (slice(None), i, j), f"$K_{{{i + 1}{j + 1}}}$", plain
