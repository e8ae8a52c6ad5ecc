"""Made-up cells in closed form, with parameters (ParametricCell) or without: responses, training set.

Nothing of it comes from a finite element solve. <∇u¹>_s has the size and the bend of that of the paper's cell;
stress and fluid volume derive from one potential.

W(H, p; r, e) = e W₁(H, p/e) − (φ_f(r) − φ_f) p J, where W₁ and φ_f are those of :mod:`.potential_cell`: e scales the
modulus, r changes the pores.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.response import cubic_reference

#: Confined compression: the range of the two inputs that a synthetic training set samples.
INPUTS = InputSpace(("H22", "p"), (-0.20, -0.02), (0.04, 0.24))
IDENTITY = "synthetic-cell-1"
SOLID_FRACTION = 0.5877
#: How <∇u¹> bends: G = (M:H + Q p)/(1 + A tr H + B p) + C H·H + D p H.
A, B, C, D = 0.8, -0.5, -0.06, 0.4
#: Curvature of the potential in p.
STORAGE = 0.25


def respond(states: MacroState) -> CellResponse:
    """All responses of n states with their derivatives.

    G = <∇u¹>_s as above with the cubic M and Q of :func:`cubic_reference`; W = φ_s Ψ(F) − φ_f p J − ``STORAGE`` p²/2
    with F = I + H, so P_E = φ_s ∂Ψ/∂F − φ_f p cof F and φ = φ_f J + ``STORAGE`` p.
    """
    H, p = states.grad_u, states.p
    n = len(p)
    G, G_H, G_p = _mean_grad(H, p)
    material, F = NeoHookean(), np.eye(3) + H
    solid, fluid = SOLID_FRACTION, 1 - SOLID_FRACTION
    J, cof = determinant(F), cofactor(F)
    fluid_p = fluid * p
    tangent = CellTangent(
        mean_grad_grad_u=G_H,
        mean_grad_p=G_p,
        stress_grad_u=solid * material.tangent(F) - fluid_p[:, None, None, None, None] * cofactor_tangent(F),
        stress_p=-fluid * cof,
        fluid_volume_grad_u=fluid * cof,
        fluid_volume_p=np.full(n, STORAGE),
    )
    return CellResponse(
        mean_grad=G,
        status=np.full(n, int(Status.converged), dtype=np.int64),
        potential=solid * material.energy_density(F) - fluid_p * J - STORAGE / 2 * p**2,
        stress=solid * material.stress(F) - fluid_p[:, None, None] * cof,
        fluid_volume=fluid * J + STORAGE * p,
        tangent=tangent,
    )


def synthetic_training_set(n: int = 240, seed: int = 0) -> TrainingSet:
    """``n`` ≥ 4 states: the corners of :data:`INPUTS`, the rest uniform at random by ``seed``."""
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    unit = np.concatenate([corners, np.random.default_rng(seed).random((n - len(corners), 2))])
    states = INPUTS.scatter(low + (high - low) * unit)
    provenance = {"origin": "synthetic cell", "states": f"{n}, seed {seed}"}
    return TrainingSet(states, respond(states), INPUTS, respond(MacroState.zeros(1)), IDENTITY, provenance)


def _mean_grad(H: Array, p: Array) -> tuple[Array, Array, Array]:
    """G (n, 3, 3), ∂G/∂H (n, 3, 3, 3, 3), ∂G/∂p (n, 3, 3)."""
    linear = cubic_reference().tangent
    assert linear is not None
    assert linear.mean_grad_grad_u is not None
    assert linear.mean_grad_p is not None
    M, Q, eye = linear.mean_grad_grad_u[0], linear.mean_grad_p[0], np.eye(3)
    r = 1 / (1 + A * np.trace(H, axis1=1, axis2=2) + B * p)
    L = np.einsum("ijkl,nkl->nij", M, H) + Q * p[:, None, None]
    r1, r4, p1, p4 = (
        r[:, None, None],
        r[:, None, None, None, None],
        p[:, None, None],
        p[:, None, None, None, None],
    )
    G = L * r1 + C * H @ H + D * p1 * H
    G_H = (
        M * r4
        - A * r4**2 * np.einsum("nij,kl->nijkl", L, eye)
        + C * (np.einsum("ik,nlj->nijkl", eye, H) + np.einsum("nik,jl->nijkl", H, eye))
        + D * p4 * np.einsum("ik,jl->ijkl", eye, eye)
    )
    G_p = Q * r1 - B * r1**2 * L + D * H
    return G, G_H, G_p


#: K of the cell with r = 1, another one along each axis.
CONDUCTIVITY: Array = 500.0 * np.diag([1.0, 1.5, 2.0])


class ParametricCell(CellLaw):
    """Cell with the parameters ``radius`` (of three channels) and ``stiffness``."""

    identity = "parametric-cell-1"
    parameters = ("radius", "stiffness")

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives.

        Raises
        ------
        ValueError
            The states have no parameters.
        """
        if states.parameters is None:
            raise ValueError("expected states with parameters")
        r, e = states.parameters.T
        e2, e4 = e[:, None, None], e[:, None, None, None, None]
        first = potential_cell.respond(MacroState(states.grad_u, states.p / e))
        assert first.potential is not None
        assert first.stress is not None
        assert first.fluid_volume is not None
        F = np.eye(3) + states.grad_u
        J, cof = determinant(F), cofactor(F)
        more = porosity(r) - (1 - potential_cell.SOLID_FRACTION)
        p = more * states.p
        return CellResponse(
            mean_grad=first.mean_grad,
            status=first.status,
            potential=e * first.potential - p * J,
            stress=e2 * first.stress - p[:, None, None] * cof,
            fluid_volume=first.fluid_volume + more * J,
            tangent=_tangent(first.tangent, e, e4, more, p, F) if tangent else None,
        )

    def undeformed(self, parameters: Array) -> UndeformedCells:
        """Return φ_f(r) and K r⁴."""
        r = parameters[:, 0]
        return UndeformedCells(porosity(r), CONDUCTIVITY * (r**4)[:, None, None])


class BoundCell(CellLaw):
    """The same cell with its parameters bound to constants (m,)."""

    def __init__(self, constants: Array) -> None:
        self.constants, self.identity = np.asarray(constants, float), f"bound {constants}"

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives."""
        theta = np.broadcast_to(self.constants, (len(states), len(self.constants)))
        return ParametricCell().predict(replace(states, parameters=theta), tangent=tangent)


def parametric_law(cell: CellLaw | None = None, radius: float = 0.2, closure: str = "potential") -> ClosedLaw:
    """Return the closed law of ``cell``, by default of the one with parameters; ``radius`` gives the constants."""
    solid = 1 - float(porosity(np.array(radius)))
    constants = make_closure(closure, solid, NeoHookean(), CONDUCTIVITY * radius**4)
    return ClosedLaw(ParametricCell() if cell is None else cell, constants)


def porosity(r: Array) -> Array:
    """Return φ_f = 3π r² − 8√2 r³ of three crossing channels with the radii r (n,)."""
    return np.asarray(3 * np.pi * r**2 - 8 * np.sqrt(2) * r**3)


def _tangent(first: CellTangent | None, e: Array, e4: Array, more: Array, p: Array, F: Array) -> CellTangent:
    assert first is not None
    assert first.mean_grad_p is not None
    assert first.stress_grad_u is not None
    assert first.stress_p is not None
    assert first.fluid_volume_p is not None
    stress_p = first.stress_p - more[:, None, None] * cofactor(F)
    return CellTangent(
        mean_grad_grad_u=first.mean_grad_grad_u,
        mean_grad_p=first.mean_grad_p / e[:, None, None],
        stress_grad_u=e4 * first.stress_grad_u - p[:, None, None, None, None] * cofactor_tangent(F),
        stress_p=stress_p,
        fluid_volume_grad_u=-stress_p,
        fluid_volume_p=first.fluid_volume_p / e,
    )
