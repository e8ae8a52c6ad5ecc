"""Error estimate of the conductivity model, from the states that it was learned from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.states import Array, IntArray
from porocore.surrogates.conductivity.model import ConductivityModel
from porocore.surrogates.error_estimate.fit import Equations, draw, estimate, monomials
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.symmetry import Equivariance

#: A component whose range is smaller than this share of the tolerance cannot miss it.
SMALL = 0.1


def with_conductivity_error(
    model: ConductivityModel, t: Array, S: Array, tied: Equivariance, tolerance: float
) -> ConductivityModel:
    """Return the model with an estimate of the errors of ln K_ref.

    The polynomials of the estimate have the symmetry of the cell, as the model has it, so that each state counts for
    all its images. Errors are shares of the range of the component of ln K_ref that varies most.

    Parameters
    ----------
    model
        Without an estimate.
    t : (d, n)
        Active variables of the states that have a conductivity.
    S : (6, n)
        Upper triangle of ln K_ref less its value at rest there.
    tied
        The symmetry of S(t).
    tolerance
        Errors beyond it are flagged.
    """
    d, n = t.shape
    ranges = np.ptp(S, axis=1)
    spread = float(ranges.max()) or 1.0
    varies = ranges > SMALL * tolerance * spread
    # The symmetry ties other components to those that vary.
    learned = sorted(row for together in tied.outputs.orbits() if varies[together].any() for row in together)
    if not learned:
        return model
    ways = Equivariance(tied.variables, tied.outputs.on(learned))
    exponents = monomials(n * len(learned), (1,) * d, 1, count=lambda found: ways.ties(found).count)
    rows, degrees = _rows(exponents, ways, t)
    right = S[None, learned] / spread
    draws, nugget = draw(Equations(rows, right, degrees, np.ones(len(learned), dtype=bool)))
    coefficients = np.zeros((len(draws), 6, len(exponents)))
    ties = ways.ties(exponents)
    coefficients[:, learned] = [spread * ties.coefficients(free) for free in draws[:, 0]]
    members = Polynomial(exponents, coefficients.reshape(-1, len(exponents)))
    found = estimate(members, nugget, tolerance, np.full(6, spread), t, model.beyond_rest)
    return replace(model, estimate=found)


def _rows(exponents: IntArray, ways: Equivariance, t: Array) -> tuple[Array, IntArray]:
    """Return what each free coefficient brings to the components at t (d, n), (F, c, n), and its degree (F,)."""
    ties = ways.ties(exponents)
    values = Polynomial.monomials(exponents).evaluate(t)
    rows = np.zeros((ties.count, len(ties.number), t.shape[1]))
    degrees = np.zeros(ties.count, dtype=np.int64)
    for component, (numbers, signs) in enumerate(zip(ties.number, ties.sign, strict=True)):
        free = numbers >= 0
        np.add.at(rows[:, component], numbers[free], signs[free, None] * values[free])
        degrees[numbers[free]] = exponents[free].sum(axis=1)
    return rows, degrees
