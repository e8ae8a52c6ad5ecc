"""Estimated error of a surrogate at a state, by the spread of polynomials (ErrorEstimate).

The polynomials have a higher degree than a surrogate and a prior where the states do not determine them. The distance
of the surrogate from their mean is its bias; their scatter is the variance that the states leave.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.point_coordinates import Coordinates
from porocore.states import Array, IntArray
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
            return self.polynomials.evaluate(variables).reshape(-1, c, n)
        t, by_variables, _ = self.terms.entries(variables, second=False)
        inner = len(t) - self.coordinates
        if members is None:
            members = self.at(Coordinates(t[inner:])) if self.coordinates else self._without_coordinates
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
    def _without_coordinates(self) -> BoundPolynomial:
        return self.at(Coordinates(np.zeros((0, 1))))

    @cached_property
    def _varying(self) -> VaryingPolynomial:
        return VaryingPolynomial(self.polynomials, self.polynomials.variables - self.coordinates)
