"""Isotropic linear poroelastic coefficients, and the relative L² norm of a difference."""

from __future__ import annotations

import numpy as np

from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array


def isotropic_coefficients(
    lame: float, shear: float, biot: float, storage: float, conductivity: float
) -> LinearCoefficients:
    """Coefficients from λ and μ of the drained frame, α, 1/M_B and k/μ_f, in units that fit together."""
    one = np.eye(3)
    stiffness = lame * np.einsum("ij,kl->ijkl", one, one)
    stiffness += shear * (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one))
    return LinearCoefficients(
        stiffness=stiffness,
        biot=biot * one,
        biot_of_stress=biot * one,
        storage=storage,
        conductivity=conductivity * one,
        mean_grad_grad_u=np.zeros((3, 3, 3, 3)),
        mean_grad_p=np.zeros((3, 3)),
    )


def relative_l2(found: Array, exact: Array) -> float:
    """Discrete norm of the difference over that of the exact field, for values in cells of equal volume."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
