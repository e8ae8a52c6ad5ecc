"""An error estimate in the file of a surrogate."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.states import Array
from porocore.surrogates.error_estimate import ErrorEstimate
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.polynomial_file import pack_polynomial, unpack_polynomial
from porocore.surrogates.potential import PotentialModel
from porocore.surrogates.terms import VARIABLES

#: Polynomials and judged quantities at most, in a file that is worth reading.
MOST_MEMBERS = 1000


def pack(estimate: ErrorEstimate, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add an estimate to the header and the arrays of a file."""
    header["estimate"] = {
        "tolerance": estimate.tolerance,
        "nugget": estimate.nugget,
        "judged": estimate.judged,
        "members": len(estimate.polynomials.coefficients),
    }
    arrays |= {"estimate/spread": estimate.spread, "estimate/safe": estimate.safe}
    pack_polynomial(estimate.polynomials, "estimate/polynomials", arrays)
    if estimate.terms is not None:
        pack_polynomial(estimate.terms, "estimate/terms", arrays)


def unpack(
    header: dict[str, Any], arrays: dict[str, Array], model: AnchoredModel | PotentialModel
) -> ErrorEstimate:
    """Return the estimate of a file for its model.

    Raises
    ------
    KeyError, TypeError, ValueError
        Something is missing, or does not fit together.
    """
    said = header["estimate"]
    judged, members = tuple(int(a) for a in said["judged"]), int(said["members"])
    spread, tolerance, nugget = arrays["estimate/spread"], float(said["tolerance"]), float(said["nugget"])
    slopes = isinstance(model, PotentialModel)
    quantities = len(judged) if isinstance(model, PotentialModel) else len(model.components)
    variables = VARIABLES if slopes else len(model.sampled.inputs)
    if (
        any(a not in range(VARIABLES) for a in judged)
        or not quantities
        or spread.shape != (quantities,)
        or not (spread > 0).all()
        or not (0 < tolerance < np.inf and 0 <= nugget < np.inf)
        or members > MOST_MEMBERS
        or members % quantities * (not slopes)
        or members < 2
    ):
        raise ValueError(f"an estimate of {members} polynomials for {quantities} quantities")
    safe = arrays["estimate/safe"].reshape(2, variables)
    terms, inner = None, variables
    if slopes:
        inner = len(arrays["estimate/terms/coefficients"])
        terms = unpack_polynomial(arrays, "estimate/terms", VARIABLES, inner)
    polynomials = unpack_polynomial(arrays, "estimate/polynomials", inner, members)
    return ErrorEstimate(tolerance, polynomials, terms, judged, spread, nugget, safe)
