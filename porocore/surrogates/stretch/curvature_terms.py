"""Second divided differences in the second derivative of a function of ln C, in the eigenbasis."""

from __future__ import annotations

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


#: What ∂S_α/∂C_β is made of, and how often; see :meth:`porocore.surrogates.stretch.log_stretch.LogStretch.tangent`.
CURVATURE = _terms()
