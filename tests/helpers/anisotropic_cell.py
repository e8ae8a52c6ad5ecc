"""Made-up cell with three symmetry planes, in closed form, whose fluid depends on how it stands in a body; its laws.

With G the Green strain, f the porosity, s the free strain by which the solid swells and p the pressure::

    W = (G − sI):C:(G − sI)/2 − p (f + f A:G − B s) − S p²/2,   <∇u¹>_s = M:H + Q p
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.states import CellResponse, CellSlopes, CellTangent, MacroState, Status

A, B, S = np.diag([1.5, 2.5, 1.9]), 0.8, 0.6
Q = -np.diag([0.10, 0.16, 0.13])
K = 0.02 * np.diag([1.0, 1.5, 2.0])
POROSITY, SWELLING = 0.25, 0.0
#: Kept times of :func:`block`.
TIMES = (0.1, 0.2, 0.7, 1.2, 1.7, 2.2)
PLAN = {"end": 2.2, "step": 0.5, "ramp_increments": 2, "ramp_step": 0.1, "profiles": TIMES}
ABOUT = np.array([0.3, 0.2, 1.0])
#: Axes and parameters that change in time and in place.
AXES = {"about": tuple(ABOUT), "angle": "50*t + 20*x"}
FIELDS = {
    "porosity": {
        "formula": "0.3 + 0.02*x",
        "initial": 0.22,
        "over": {"table": [[0, 0], [0.7, 0.2], [2.2, 1]]},
    },
    "swelling": "0.004*t*y",
}
NEWTON = {"tolerance": 1e-12}


def _orthotropic(normal: np.ndarray, shear: float) -> np.ndarray:
    eye = np.eye(3)
    tensor = shear * (np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye))
    for i in range(3):
        for j in range(3):
            tensor[i, i, j, j] = normal[i][j]
    return tensor


C = _orthotropic([[0.9, 0.2, 0.25], [0.2, 0.5, 0.15], [0.25, 0.15, 0.7]], 0.2)
M = _orthotropic([[-0.25, -0.08, -0.07], [-0.08, -0.15, -0.05], [-0.07, -0.05, -0.2]], -0.06)


def green(H: np.ndarray) -> np.ndarray:
    """G (n, 3, 3)."""
    return (H + H.swapaxes(1, 2) + H.swapaxes(1, 2) @ H) / 2


def fluid(H: np.ndarray, p: np.ndarray, f: np.ndarray, s: np.ndarray, *, linear: bool = False) -> np.ndarray:
    """φ (n,) in the axes of the cell, or its linear limit."""
    strain = H if linear else green(H)
    return f + f * np.einsum("ij,nij->n", A, strain) - B * s + S * p


def mean_grad(H: np.ndarray, p: np.ndarray) -> np.ndarray:
    """<∇u¹>_s (n, 3, 3) in the axes of the cell."""
    return np.einsum("ijkl,nkl->nij", M, H) + p[:, None, None] * Q


class AnisotropicCell(CellLaw):
    """The cell, with those of the parameters ``porosity``, ``swelling`` and ``mobility`` (of K) that are named."""

    identity = "anisotropic-cell"

    def __init__(self, *parameters: str) -> None:
        self.parameters = parameters

    def values(self, parameters: np.ndarray | None, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Porosity and swelling (n,)."""
        given = {} if parameters is None else dict(zip(self.parameters, parameters.T, strict=True))
        return given.get("porosity", np.full(n, POROSITY)), given.get("swelling", np.full(n, SWELLING))

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        n, H, p, eye = len(states), states.grad_u, states.p, np.eye(3)
        f, s = self.values(states.parameters, n)
        F, G = eye + H, green(H)
        free = G - s[:, None, None] * eye
        second = np.einsum("ijkl,nkl->nij", C, free) - (p * f)[:, None, None] * A
        by_G = np.einsum("nai,ijkl,nbk->najbl", F, C, F)
        return CellResponse(
            mean_grad=mean_grad(H, p),
            status=np.full(n, int(Status.converged)),
            potential=np.einsum("nij,ijkl,nkl->n", free, C, free) / 2
            - p * (f + f * np.einsum("ij,nij->n", A, G) - B * s)
            - S * p**2 / 2,
            stress=F @ second,
            fluid_volume=fluid(H, p, f, s),
            tangent=CellTangent(
                mean_grad_grad_u=np.broadcast_to(M, (n, 3, 3, 3, 3)),
                mean_grad_p=np.broadcast_to(Q, (n, 3, 3)),
                stress_grad_u=np.einsum("ab,njl->najbl", eye, second) + by_G,
                stress_p=-f[:, None, None] * (F @ A),
                fluid_volume_grad_u=f[:, None, None] * (F @ A),
                fluid_volume_p=np.full(n, S),
            )
            if tangent
            else None,
        )

    def undeformed(self, parameters: np.ndarray) -> UndeformedCells:
        f, _ = self.values(parameters, len(parameters))
        given = dict(zip(self.parameters, parameters.T, strict=True))
        return UndeformedCells(f, np.multiply.outer(given.get("mobility", np.ones(len(f))), K))

    def slopes(self, states: MacroState) -> CellSlopes:
        n, H, p = len(states), states.grad_u, states.p
        F, G = np.eye(3) + H, green(H)
        by = {
            "porosity": (-p[:, None, None] * (F @ A), 1 + np.einsum("ij,nij->n", A, G), np.ones(n)),
            "swelling": (
                np.broadcast_to(-F @ np.einsum("ijkk->ij", C), (n, 3, 3)),
                np.full(n, -B),
                np.zeros(n),
            ),
            "mobility": (np.zeros((n, 3, 3)), np.zeros(n), np.zeros(n)),
        }
        stress, volume, share = (
            np.stack(each, axis=-1) for each in zip(*(by[name] for name in self.parameters), strict=True)
        )
        still = np.zeros((n, 3, 3, len(self.parameters)))
        conductivity = still.copy()
        if "mobility" in self.parameters:
            conductivity[..., self.parameters.index("mobility")] = K
        return CellSlopes(
            stress=stress, fluid_volume=volume, porosity=share, mean_grad=still, conductivity=conductivity
        )


def anisotropic_law(*parameters: str, closure: str = "potential", cell: CellLaw | None = None) -> ClosedLaw:
    """The closed law of the cell."""
    constants = make_closure(closure, 1 - POROSITY, NeoHookean(), K)
    return ClosedLaw(cell or AnisotropicCell(*parameters), constants)


def linear_law(porosity: float = POROSITY) -> LinearPoroelasticity:
    """Its linear limit."""
    rest = AnisotropicCell("porosity").predict(MacroState.zeros(1).with_parameters([porosity]))
    found = LinearCoefficients.from_reference(rest, 1 - porosity, NeoHookean(), K)
    biot = porosity * A
    return LinearPoroelasticity(replace(found, stiffness=C, biot=biot, biot_of_stress=biot, storage=S))


def block(fields: dict[str, Any], traction: float = -0.03, **more: Any) -> MacroProblem:
    """A loaded block that drains to one side, whose load is done at t = 0.2 while the fields go on."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "elements": (2, 2, 1), "size": (0.8, 1.0, 0.5)},
            "boundary": {
                "x-": {"displacement": (0, None, None)},
                "y-": {"displacement": (None, 0, None)},
                "z-": {"displacement": (None, None, 0)},
                "x+": {"pressure": 0},
                "y+": {"traction": (0, traction, 0)},
            },
            "fields": fields,
            "time": PLAN,
            "newton": NEWTON,
        }
        | more
    )
