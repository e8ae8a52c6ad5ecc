"""Estimated error of a surrogate by the spread of polynomials (ErrorEstimate); what drives a state out.

The polynomials have a higher degree than a surrogate and a prior where the states do not determine them. The distance
of the surrogate from their mean is its bias; their scatter is the variance that the states leave.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import NAMES, Coordinates, InputSpace, components, value_text
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Estimated error of a surrogate as a share of the range of what it predicts.

    Attributes
    ----------
    tolerance
        Errors beyond it are flagged.
    polynomials
        The mean and the draws, one after the other, each with the same outputs, in some terms.
    terms
        Polynomial of the terms in the variables; None where the terms are the variables.
    judged
        Variables whose derivatives are judged; empty if values are judged.
    spread : (c,)
        Ranges of the c quantities that are judged, by which errors are divided.
    nugget
        Standard deviation of the noise, as a share.
    safe : (2, v)
        Box of the variables in which no estimate comes near the tolerance, so that none has to be made there.
    coordinates
        Number of variables, the last, that are coordinates of parameters, which many states share.
    """

    tolerance: float
    polynomials: Polynomial
    terms: Polynomial | None
    judged: tuple[int, ...]
    spread: Array
    nugget: float
    safe: Array
    coordinates: int = 0

    def flagged(
        self, variables: Array, found: Array, members: BoundPolynomial | None = None
    ) -> npt.NDArray[np.bool_]:
        """Return which of n states have an estimated error beyond the tolerance, or none that is finite, (n,).

        Parameters
        ----------
        variables : (v, n)
            Variables of the states.
        found : (c, n)
            The surrogate's judged quantities there.
        members
            The polynomials at the states' coordinates where they are known, by :meth:`at`.
        """
        there = self.beyond_safe(variables)
        flagged = np.zeros(variables.shape[1], dtype=bool)
        if len(there):
            known = None if members is None else members.take(there)
            # NaN compares as false, and is flagged.
            flagged[there] = ~(self.error(variables[:, there], found[:, there], known) <= self.tolerance)
        return flagged

    def beyond_safe(self, variables: Array) -> IntArray:
        """Return which of n states (v, n) lie outside the box in which no estimate has to be made."""
        low, high = self.safe[:, :, None]
        return np.flatnonzero(~((variables >= low) & (variables <= high)).all(axis=0))

    def error(self, variables: Array, found: Array, members: BoundPolynomial | None = None) -> Array:
        """Return the estimate (n,), that of the worst quantity; parameters as in :meth:`flagged`."""
        answers = self._answers(variables, members)
        mean = answers[0]
        scatter = answers[1:] - mean
        squares = (mean - found) ** 2 + np.einsum("dcn,dcn->cn", scatter, scatter) / len(scatter)
        shares = squares / self.spread[:, None] ** 2 + self.nugget**2
        worst: Array = np.sqrt(shares.max(axis=0))
        return worst

    def at(self, coordinates: Coordinates) -> BoundPolynomial:
        """Return the polynomials, of the terms alone, at coordinates of parameters."""
        return self._varying.at(coordinates)

    def _answers(self, variables: Array, members: BoundPolynomial | None) -> Array:
        """Return the judged quantities of the mean and the draws, (1 + draws, c, n)."""
        c, n = len(self.spread), variables.shape[1]
        if self.terms is None:
            inner = len(variables) - self.coordinates
            found = (
                self.polynomials.evaluate(variables)
                if members is None
                else members.evaluate(variables[:inner])
            )
            return found.reshape(-1, c, n)
        t, by_variables, _ = self.terms.entries(variables, second=False)
        inner = len(t) - self.coordinates
        if members is None:
            members = self.at(Coordinates(t[inner:]))
        rows: dict[int, list[tuple[int, Array]]] = {}
        place = {variable: k for k, variable in enumerate(self.judged)}
        for (term, variable), row in by_variables:
            if variable in place:
                rows.setdefault(term, []).append((place[variable], row))
        answers = np.zeros((len(self.polynomials.coefficients), c, n))
        for (member, term), gradient in members.gradients(t[:inner]):
            for k, row in rows.get(term, ()):
                answers[member, k] += gradient * row
        return answers

    @cached_property
    def _varying(self) -> VaryingPolynomial:
        return VaryingPolynomial(self.polynomials, self.polynomials.variables - self.coordinates)


#: Share of its range by which a component is moved inwards to see whether it drives the error.
WITHIN = 0.25
#: The last words of a reason with an estimated error.
ERROR_END = "of the range"
MINUS = str.maketrans("-", "−")


def reasons(
    inputs: InputSpace, states: MacroState, estimate: Callable[[MacroState], Array] | None
) -> list[str]:
    """Return for each of n flagged states which component drives it out, with its value.

    A component that was not sampled comes first, then the one that lies farthest beyond its range; within all ranges
    it is the one without which the estimated error would be smallest, moved to the inner half of its range.

    Parameters
    ----------
    inputs
        The sampled inputs.
    states
        The flagged states, without rotation if the surrogate is objective.
    estimate
        Error of states as a share of the range of what is learned, (n,); None where there is no estimate.
    """
    rows = components(states)
    others = [column for column in range(10) if column not in inputs.columns]
    beyond = np.abs(rows[others])
    unit = inputs.to_unit(inputs.gather(states))
    excess = np.maximum(unit - 1, -unit)
    within = _smallest(inputs, states, unit, estimate)
    found = []
    for n in range(len(states)):
        if others and not beyond[:, n].max() <= inputs.negligible:
            column = others[int(np.nanargmax(beyond[:, n]))]
            found.append(f"{_value(NAMES[column], rows[column, n])}, which was not sampled")
            continue
        k = int(np.argmax(excess[n])) if estimate is None or excess[n].max() > 1e-9 else within[0][n]
        said = _value(inputs.names[k], rows[inputs.columns[k], n])
        ends = inputs.range_text(inputs.names[k]).translate(MINUS)
        said += f", beyond {ends}" if excess[n, k] > 1e-9 else f" in {ends}"
        if estimate is not None and np.isfinite(within[1][n]):
            said += f", where the estimated error is {100 * within[1][n]:.2g} % {ERROR_END}"
        found.append(said)
    return found


def _smallest(
    inputs: InputSpace, states: MacroState, unit: Array, estimate: Callable[[MacroState], Array] | None
) -> tuple[list[int], Array]:
    """Return the input of each state without which the error would be smallest, and the error as it is."""
    if estimate is None:
        return [], np.full(len(states), np.nan)
    low, span = np.array(inputs.lower), np.array(inputs.upper) - np.array(inputs.lower)
    errors = []
    for k in range(len(inputs)):
        moved = unit.copy()
        moved[:, k] = np.clip(moved[:, k], WITHIN, 1 - WITHIN)
        errors.append(estimate(inputs.scatter(low + span * moved)))
    return [int(k) for k in np.argmin(np.nan_to_num(errors, nan=np.inf), axis=0)], estimate(states)


def _value(name: str, value: float) -> str:
    return f"{name} = {value_text(name, value, 3)}".translate(MINUS)
