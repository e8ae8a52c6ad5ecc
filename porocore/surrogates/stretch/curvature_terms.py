"""Second derivative of a function of ln C by C in the eigenbasis, from divided differences."""

from __future__ import annotations

import numpy as np

from porocore.states import Array
from porocore.surrogates.stretch.components import COMPONENT, PLACES

#: The component of the function's derivative, and the three eigenvalues of C between which ln is differenced.
Factors = tuple[int, tuple[int, int, int]]


def _terms() -> dict[tuple[int, int], dict[Factors, float]]:
    """Return the terms by two components α ≤ β of C, whose exchange changes nothing."""
    found: dict[tuple[int, int], dict[Factors, float]] = {}
    for alpha, (a, b) in enumerate(PLACES):
        for i in range(3):
            # ∂S_ab/∂C_ia and ∂S_ab/∂C_bi, each a half of a place above and one below the diagonal.
            low, middle, high = sorted((i, a, b))
            for beta, place, twice in (
                (COMPONENT[i, a], COMPONENT[i, b], i == a),
                (COMPONENT[b, i], COMPONENT[a, i], i == b),
            ):
                if alpha <= beta:
                    terms = found.setdefault((alpha, int(beta)), {})
                    key = int(place), (low, middle, high)
                    terms[key] = terms.get(key, 0.0) + (2.0 if twice else 1.0)
    return found


#: Terms of ∂S_α/∂C_β, with their numbers.
CURVATURE = _terms()


def second_derivative(T: Array, differences: dict[tuple[int, int, int], Array]) -> Array:
    """Return 2 ∂S/∂C (n, 6, 6) at fixed ∂W/∂L, from its nine places T (6, n); all in the eigenbasis.

    S = 2 ∂W/∂C has the second divided differences of ln:
    T:∂²ln C[A, B] = Σ T_ij ln[i, k, j] (A_ik B_kj + B_ik A_kj).
    """
    X = np.zeros((T.shape[1], 6, 6))
    for (alpha, beta), terms in CURVATURE.items():
        value = sum(factor * (T[place] * differences[points]) for (place, points), factor in terms.items())
        X[:, alpha, beta] = X[:, beta, alpha] = value
    return X
