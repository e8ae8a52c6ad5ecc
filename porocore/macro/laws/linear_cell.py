"""Cell law in the limit of small loads."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import CellLaw, fingerprint
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status


class LinearCellLaw(CellLaw):
    """<∇u¹>_s = M:H + Q p with the tangents of the undeformed cell; a cell law for small deformations.

    Parameters
    ----------
    reference
        Response at H = 0, p = 0 with its tangent (one row).
    """

    def __init__(self, reference: CellResponse) -> None:
        self.M, self.Q = reference_tangents(reference)
        self.identity = fingerprint("linear", self.M, self.Q)

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return ``mean_grad`` and its derivatives; no other response."""
        n = len(states)
        mean_grad = states.grad_u.reshape(n, 9) @ self.M.reshape(9, 9).T
        return CellResponse(
            mean_grad=mean_grad.reshape(n, 3, 3) + states.p[:, None, None] * self.Q,
            status=np.full(n, int(Status.converged)),
            outside_training_range=np.zeros(n, bool),
            tangent=CellTangent(
                mean_grad_grad_u=np.broadcast_to(self.M, (n, 3, 3, 3, 3)),
                mean_grad_p=np.broadcast_to(self.Q, (n, 3, 3)),
            )
            if tangent
            else None,
        )


def reference_tangents(reference: CellResponse) -> tuple[Array, Array]:
    """Return M (3, 3, 3, 3) and Q (3, 3) of the undeformed cell.

    Raises
    ------
    ValueError
        The response is not one solved row with its tangent.
    """
    tangent = reference.tangent
    if (
        len(reference) != 1
        or not reference.valid.all()
        or tangent is None
        or tangent.mean_grad_grad_u is None
        or tangent.mean_grad_p is None
    ):
        raise ValueError("expected the solved response of one undeformed cell, with its tangent")
    return tangent.mean_grad_grad_u[0].copy(), tangent.mean_grad_p[0].copy()
