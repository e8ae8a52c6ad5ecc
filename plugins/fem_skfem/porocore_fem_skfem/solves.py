"""Linear solves with the tangent: conjugate gradients around a factor that is kept as long as it serves."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError, FactorisedTangent, LoadStepFailed
from porocore.states import Array, Status
from porocore_fem_skfem.constraints import Constraints
from porocore_fem_skfem.linalg import conjugate_gradients, refine

#: More iterations than this cost more than a new factor.
PATIENCE = 18
SENSITIVITY_TOLERANCE = 1e-11
#: Shifts of an indefinite tangent, relative to the mean of its diagonal.
SMALLEST_SHIFT, LARGEST_SHIFT = 1e-5, 10.0


def direction(constraints: Constraints, entries: Array, rhs: Array, accuracy: float) -> Array:
    """Return K⁻¹ rhs; with an indefinite K that of the least shifted K that is definite.

    Raises
    ------
    LoadStepFailed
        No shift makes K definite, or the factorisation broke down.
    """
    matrix = constraints.pattern.full(entries)
    try:
        solved = conjugate_gradients(
            matrix, rhs, constraints.precondition, tolerance=accuracy, limit=PATIENCE
        )
        if not solved.converged and constraints.factorise(entries) <= 0:
            solved = conjugate_gradients(matrix, rhs, constraints.precondition, tolerance=accuracy)
        return solved.x if solved.converged else _shifted(constraints, entries, rhs)
    except FactorError as error:
        raise LoadStepFailed(Status.not_converged) from error


def _shifted(constraints: Constraints, entries: Array, rhs: Array) -> Array:
    diagonal = constraints.pattern.diagonal
    size = float(np.abs(entries[diagonal]).mean())
    # Neighbouring iterates need about the same shift, and less of it brings them on faster.
    shift = max(constraints.shift / 4, SMALLEST_SHIFT)
    while shift < LARGEST_SHIFT:
        moved = entries.copy()
        moved[diagonal] += shift * size
        if constraints.factorise(moved) <= 0:
            x = constraints.precondition(rhs)
            if x @ rhs > 0:
                constraints.shift = shift
                return x
        shift *= 4
    raise LoadStepFailed(Status.not_converged)


def sensitivities(
    matrix: sparse.csr_matrix, factor: FactorisedTangent, R: Array
) -> tuple[Array, Array, bool]:
    """Return U = −K⁻¹ R (n, k), RᵀU + UᵀR + UᵀKU (k, k), and whether K proved indefinite.

    The second is the part of the second derivatives that is due to U. It equals RᵀU, but its error is of second order
    in that of U, and it is symmetric. U is NaN where the linear solver does not reach its tolerance.

    Raises
    ------
    FactorError
        The factor cannot be applied.
    """
    if factor.negative >= 0:  # a direct one, which serves indefinite matrices
        solved = refine(matrix, -R, factor.solve, tolerance=SENSITIVITY_TOLERANCE)
    else:
        solved = conjugate_gradients(matrix, -R, factor.solve, tolerance=SENSITIVITY_TOLERANCE, limit=200)
    U = solved.x if solved.converged else np.full_like(solved.x, np.nan)
    mixed = R.T @ U
    return U, mixed + mixed.T + U.T @ (matrix @ U), solved.indefinite
