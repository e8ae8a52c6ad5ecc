"""A made-up cell and the confined column, for tests that need a law and a problem but no cell solve."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.problem import Boundary, MacroProblem
from porocore.states import Array, CellResponse, CellTangent, Status


def cubic_reference(
    poisson_ratio: float = 0.35, normal: float = -0.2297, lateral: float = -0.0754, shear: float = -0.11
) -> CellResponse:
    """Response of an undeformed cell with cubic symmetry (one row, with tangent).

    M_iiii, M_iijj and M_ijij = M_ijji are ``normal``, ``lateral`` and ``shear``; Q follows from the identity
    Q_ii = (1 − 2ν)(M_iiii + 2 M_iijj) that holds for pores of any shape in a homogeneous isotropic solid.
    """
    i = np.eye(3)
    one = np.einsum("ia,ja,ka,la->ijkl", i, i, i, i)
    volume = np.einsum("ij,kl->ijkl", i, i)
    mixed = np.einsum("ik,jl->ijkl", i, i) + np.einsum("il,jk->ijkl", i, i)
    M: Array = (normal - lateral - 2 * shear) * one + lateral * volume + shear * mixed
    Q: Array = (1 - 2 * poisson_ratio) * np.einsum("ijkk->ij", M)
    return CellResponse(
        mean_grad=np.zeros((1, 3, 3)),
        status=np.array([int(Status.converged)]),
        tangent=CellTangent(mean_grad_grad_u=M[None], mean_grad_p=Q[None]),
    )


def confined_column(elements: int, load: float = -1e-3, **settings: Any) -> MacroProblem:
    """A column of 0.1 × 7.5 × 0.1, loaded and drained on top, no lateral displacement, bottom fixed.

    ``settings`` go to :class:`porocore.problem.MacroProblem`; ``load`` < 0 compresses.
    """
    side = Boundary(displacement=(0, None, 0))
    faces = {face: side for face in ("x-", "x+", "z-", "z+")}
    bottom, top = Boundary(displacement=(0, 0, 0)), Boundary(traction=(0, 1, 0), pressure=0)
    data = {"elements": (1, elements, 1), "boundary": {**faces, "y-": bottom, "y+": top}, "load": load}
    return MacroProblem.model_validate(data | settings)
