"""Error estimates in the file of a surrogate: packed and unpacked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from porocore.states import Array
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.file.parts import pack_polynomial, unpack_polynomial
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial

#: Polynomials and judged quantities at most, in a file that is worth reading.
MOST_MEMBERS = 1000


def pack(
    estimate: ErrorEstimate, header: dict[str, Any], arrays: dict[str, Array], name: str = "estimate"
) -> None:
    """Add an estimate to the arrays of a file, under a name, and to the header or a part of it."""
    header["estimate"] = {
        "tolerance": estimate.tolerance,
        "nugget": estimate.nugget,
        "judged": estimate.judged,
        "members": len(estimate.polynomials.coefficients),
    }
    arrays |= {f"{name}/spread": estimate.spread, f"{name}/safe": estimate.safe}
    pack_polynomial(estimate.polynomials, f"{name}/polynomials", arrays)
    if estimate.terms is not None:
        pack_polynomial(estimate.terms, f"{name}/terms", arrays)


def unpack(
    header: dict[str, Any], arrays: dict[str, Array], model: AnchoredModel | PotentialModel
) -> ErrorEstimate:
    """Return the estimate of a file for its model."""
    if isinstance(model, AnchoredModel):
        return unpack_values(header, arrays, "estimate", len(model.sampled.inputs), len(model.components))
    learned = model.rest.learned
    judged, variables = _judged(header), VARIABLES + learned
    if not judged or any(a not in range(VARIABLES) for a in judged):
        raise ValueError(f"an estimate of the gradients by {judged}")
    inner = len(arrays["estimate/terms/coefficients"])
    terms = unpack_polynomial(arrays, "estimate/terms", variables, inner)
    found = _unpack(header, arrays, "estimate", (variables, inner, 1), (judged, terms))
    return replace(found, coordinates=learned)


def unpack_values(
    header: dict[str, Any], arrays: dict[str, Array], name: str, variables: int, quantities: int
) -> ErrorEstimate:
    """Return an estimate of values, not of gradients, that a file holds under a name."""
    if not quantities or _judged(header):
        raise ValueError(f"an estimate of {quantities} values")
    return _unpack(header, arrays, name, (variables, variables, quantities), ((), None))


def _judged(header: dict[str, Any]) -> tuple[int, ...]:
    return tuple(int(a) for a in header["estimate"]["judged"])


def _unpack(
    header: dict[str, Any],
    arrays: dict[str, Array],
    name: str,
    sizes: tuple[int, int, int],
    gradients: tuple[tuple[int, ...], Polynomial | None],
) -> ErrorEstimate:
    """Return an estimate from the numbers of variables, of the polynomials' variables and of outputs a member has."""
    said, (variables, inner, outputs), (judged, terms) = header["estimate"], sizes, gradients
    members, spread = int(said["members"]), arrays[f"{name}/spread"]
    tolerance, nugget = float(said["tolerance"]), float(said["nugget"])
    if (
        spread.shape != (len(judged) or outputs,)
        or not (spread > 0).all()
        or not (0 < tolerance < np.inf and 0 <= nugget < np.inf)
        or not 2 <= members <= MOST_MEMBERS
        or members % outputs
    ):
        raise ValueError(f"an estimate of {members} polynomials for {spread.shape} quantities")
    safe = arrays[f"{name}/safe"].reshape(2, variables)
    polynomials = unpack_polynomial(arrays, f"{name}/polynomials", inner, members)
    return ErrorEstimate(tolerance, polynomials, terms, judged, spread, nugget, safe)
