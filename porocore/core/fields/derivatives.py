"""Derivatives of the responses of a cell: by (H, p) (CellTangent) and by its parameters (CellSlopes)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from porocore.core.fields.batch import Batch
from porocore.core.fields.declaration import documented, row

if TYPE_CHECKING:
    from porocore.states import Array

_slope = partial(row, flag="tangent")
_by_parameter = partial(row, flag="slopes")


@documented
@dataclass(frozen=True, eq=False)
class CellTangent(Batch):
    """First derivatives of the responses with respect to (H, p); response indices first.

    A surrogate that does not provide a response leaves its derivatives None.
    """

    mean_grad_grad_u: Array | None = field(
        default=None, metadata=_slope("-", "M_ijkl = ∂<∂u¹_i/∂Y_j>_s / ∂H_kl", 3, 3, 3, 3)
    )
    mean_grad_p: Array | None = field(
        default=None, metadata=_slope("1/E", "Q_ij = ∂<∂u¹_i/∂Y_j>_s / ∂p", 3, 3)
    )
    stress_grad_u: Array | None = field(default=None, metadata=_slope("E", "∂P_E,ij / ∂H_kl", 3, 3, 3, 3))
    stress_p: Array | None = field(default=None, metadata=_slope("-", "∂P_E,ij / ∂p", 3, 3))
    fluid_volume_grad_u: Array | None = field(default=None, metadata=_slope("-", "∂φ / ∂H_kl", 3, 3))
    fluid_volume_p: Array | None = field(default=None, metadata=_slope("1/E", "∂φ / ∂p"))
    conductivity_grad_u: Array | None = field(
        default=None, metadata=row("d²/μ", "∂K_ref,ij / ∂H_kl", 3, 3, 3, 3, flag="surrogate")
    )
    conductivity_p: Array | None = field(
        default=None, metadata=row("d²/(μ E)", "∂K_ref,ij / ∂p", 3, 3, flag="surrogate")
    )

    @property
    def hessian(self) -> Array | None:
        """(n, 10, 10) second derivatives of W by H, row by row, and p [E]; None without those of P_E and φ."""
        C, b, storage = self.stress_grad_u, self.stress_p, self.fluid_volume_p
        if C is None or b is None or storage is None:
            return None
        n = len(storage)
        found = np.empty((n, 10, 10))
        found[:, :9, :9] = C.reshape(n, 9, 9)
        found[:, :9, 9] = found[:, 9, :9] = b.reshape(n, 9)
        found[:, 9, 9] = -storage
        return found


@documented
@dataclass(frozen=True, eq=False)
class CellSlopes(Batch):
    """First derivatives of the responses with respect to the m parameters θ of the cell, in the order of its own.

    They are taken at fixed (H, p). A solver or surrogate that does not provide one leaves it None.
    """

    potential: Array | None = field(default=None, metadata=_by_parameter("E", "∂W / ∂θ_k", "m"))
    stress: Array | None = field(default=None, metadata=_by_parameter("E", "∂P_E,ij / ∂θ_k", 3, 3, "m"))
    fluid_volume: Array | None = field(default=None, metadata=_by_parameter("-", "∂φ / ∂θ_k", "m"))
    porosity: Array | None = field(
        default=None,
        metadata=_by_parameter("-", "∂φ_f / ∂θ_k, φ_f the porosity of the undeformed cell.", "m"),
    )
    mean_grad: Array | None = field(
        default=None, metadata=_by_parameter("-", "∂<∂u¹_i/∂Y_j>_s / ∂θ_k", 3, 3, "m")
    )
    conductivity: Array | None = field(
        default=None,
        metadata=_by_parameter(
            "d²/μ",
            "∂K_ref,ij / ∂θ_k where the response has K_ref, else ∂K_ij / ∂θ_k of the undeformed cell. NaN where K_ref "
            "is.",
            3,
            3,
            "m",
            gaps=True,
        ),
    )
    hessian: Array | None = field(
        default=None,
        metadata=row(
            "E",
            "∂³W / ∂(H, p)_k ∂(H, p)_l ∂θ_m of the undeformed cell, with H row by row and p in k and l. NaN where it "
            "has a stress.",
            10,
            10,
            "m",
            flag="undeformed",
            gaps=True,
        ),
    )
