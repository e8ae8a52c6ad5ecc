"""Errors of a surrogate on held-out states, as a share of the range of its training or of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.states import Array

#: A body that uses less than this share of the range of an output does not use it.
TRACE = 1e-3


@dataclass(frozen=True, eq=False)
class OutputCheck:
    r"""One output of the surrogate on the held-out states.

    Attributes
    ----------
    name
        Label in matplotlib's mathematics, such as ``r"$\langle\nabla_Y u^1\rangle_{22}$"``.
    plain
        The same in plain text, such as ``"⟨∇u¹⟩₂₂"``.
    solved, predicted : (m,)
        Values of the cell solver and of the surrogate.
    span
        Range of the output over the training states, to which errors are referred.
    flagged : (m,) bool
        Held-out states beyond the sampled range; shown, but not counted in the error unless all of them are.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    in_body
        Least and largest value in the body at its kept times, by the surrogate; None: not known.
    parameters : (m, k)
        Parameters of the cell of each held-out state; None for a cell without.
    """

    name: str
    plain: str
    solved: Array
    predicted: Array
    span: float
    flagged: npt.NDArray[np.bool_]
    quantity: str = ""
    in_body: tuple[float, float] | None = None
    parameters: Array | None = None

    @property
    def span_in_body(self) -> float | None:
        """Range that the body uses; None where it is not known or no more than a trace of the span."""
        if self.in_body is None or self.in_body[1] - self.in_body[0] <= TRACE * self.span:
            return None
        return self.in_body[1] - self.in_body[0]

    @property
    def counted_in_body(self) -> int | None:
        """Counted held-out states whose value lies in the range that the body uses; None where it is not known."""
        if self.in_body is None:
            return None
        solved = self.solved[self.counted]
        return int(((solved >= self.in_body[0]) & (solved <= self.in_body[1])).sum())

    @property
    def all_outside(self) -> bool:
        """True if there are held-out states and all lie beyond the sampled range."""
        return len(self.flagged) > 0 and bool(self.flagged.all())

    @property
    def counted(self) -> npt.NDArray[np.bool_]:
        """(m,) Held-out states that the error is over: those within the sampled range, or all where none is."""
        return self.flagged if self.all_outside else ~self.flagged


def rms_percent(check: OutputCheck) -> float | None:
    """Return the RMS error on the counted held-out states, in per cent of the output's span; None without."""
    return _percent(_rms(check), check.span)


def worst_percent(check: OutputCheck) -> float | None:
    """Return the largest error on the counted held-out states, in per cent of the span; None without."""
    return _percent(_largest(check), check.span)


def rms_percent_in_body(check: OutputCheck) -> float | None:
    """Return the same as :func:`rms_percent` in per cent of the range that the body uses; None where it uses none."""
    return _percent(_rms(check), check.span_in_body)


def worst_percent_in_body(check: OutputCheck) -> float | None:
    """Return the same as :func:`worst_percent` in per cent of the range that the body uses; None where it uses none."""
    return _percent(_largest(check), check.span_in_body)


def few_in_body(checks: Sequence[OutputCheck]) -> str:
    """Return a sentence where an output has less than half of its held-out states in the range that the body uses."""
    counts = {
        check.plain: (check.counted_in_body, int(check.counted.sum()))
        for check in checks
        if check.span_in_body
    }
    few = [name for name, (near, all_) in counts.items() if near is not None and 2 * near < all_]
    if not few:
        return ""
    return (
        f"For {', '.join(few)}, most held-out states lie outside the range of values in the body. Therefore the error "
        "in the body is known from few states only. Choose ranges under sampling.inputs that fit the body."
    )


def _errors(check: OutputCheck) -> Array:
    return (check.predicted - check.solved)[check.counted]


def _rms(check: OutputCheck) -> float | None:
    error = _errors(check)
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def _largest(check: OutputCheck) -> float | None:
    error = _errors(check)
    return float(np.abs(error).max()) if len(error) else None


def _percent(error: float | None, span: float | None) -> float | None:
    return None if error is None or span is None else 100 * error / span
