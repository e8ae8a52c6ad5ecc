"""Averages over the cell at an equilibrium, and their exact derivatives from the factorised tangent.

With Π_θ the load derivative of the discrete energy and u_θ = −K⁻¹ R_θ,
W_θθ = Π_θθ + R_θᵀu_θ + u_θᵀR_θ + u_θᵀK u_θ, whose error is of second order in that of u_θ
and which is symmetric whatever that error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.cell.material import cofactor, cofactor_tangent, determinant
from porocore.states import CellPeaks, CellResponse, CellTangent, Status
from porocore_fem_skfem.linalg import conjugate_gradients, refine
from porocore_fem_skfem.newton import Equilibrium, gap
from porocore_fem_skfem.solid import SolidProblem

#: Of the ten columns of θ = (H row by row, p): parities that the mirror planes of the eighth sort them into.
PARITY = {"": (0, 4, 8, 9), "xy": (1, 3), "xz": (2, 6), "yz": (5, 7)}
SENSITIVITY_TOLERANCE = 1e-11


@dataclass
class _Averages:
    mean_grad: Any  # (3, 3)
    stress: Any  # <P + p cof F>_s − p cof F₀
    potential: float
    fluid_volume: float


def respond(problem: SolidProblem, here: Equilibrium, *, tangent: bool) -> CellResponse:
    """One row of responses; ``unstable`` where the tangent of any parity class is indefinite.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    averages = _average(problem, here)
    data = problem.tangent(here.at)
    mean_grad, second = np.zeros((3, 3, 10)), np.zeros((10, 10))
    counts = []
    classes = PARITY if problem.mesh.domain == "eighth" else {"": tuple(range(10))}
    for odd, columns in classes.items():
        constraints = problem.constraints(odd)
        entries = constraints.restrict(data)
        count = constraints.renew(entries)
        if tangent:
            indefinite = _differentiate(problem, here, entries, odd, columns, mean_grad, second)
            count = 1 if count < 0 and indefinite else count
        counts.append(count)
    # A solver that cannot count leaves the number unknown unless it met a negative direction.
    negative = sum(max(count, 0) for count in counts) or min(counts)
    return CellResponse(
        mean_grad=averages.mean_grad[None],
        status=np.array([Status.unstable if negative > 0 else Status.converged], dtype=np.int64),
        potential=np.array([averages.potential]),
        stress=averages.stress[None],
        fluid_volume=np.array([averages.fluid_volume]),
        tangent=_tangent(here, mean_grad, second) if tangent else None,
        peaks=_peaks(problem, here, negative),
    )


def failed(status: Status, *, tangent: bool) -> CellResponse:
    """The row of a state without values."""

    def nan(*shape: int) -> Any:
        return np.full((1, *shape), np.nan)

    return CellResponse(
        mean_grad=nan(3, 3),
        status=np.array([status], dtype=np.int64),
        potential=nan(),
        stress=nan(3, 3),
        fluid_volume=nan(),
        tangent=CellTangent(nan(3, 3, 3, 3), nan(3, 3), nan(3, 3, 3, 3), nan(3, 3), nan(3, 3), nan())
        if tangent
        else None,
        peaks=CellPeaks(nan(3, 3), nan(), nan(), nan(), nan(), nan()),
    )


def _even(problem: SolidProblem, tensor: Any) -> Any:
    """Averages over the cell of (3, 3) sums over the domain: on the eighth only the diagonal survives."""
    return problem.copies * (tensor * np.eye(3) if problem.mesh.domain == "eighth" else tensor)


def _average(problem: SolidProblem, here: Equilibrium) -> _Averages:
    at, w = here.at, problem.w
    F0 = np.eye(3) + here.H
    J0 = float(determinant(F0))
    solid = problem.copies * float(w @ at.J)
    return _Averages(
        mean_grad=_even(problem, (at.F - F0[:, :, None]) @ w),
        stress=_even(problem, problem.stress(at) @ w) - here.p * cofactor(F0),
        potential=problem.copies * problem.energy(at) - here.p * J0,
        fluid_volume=J0 - solid,
    )


def _peaks(problem: SolidProblem, here: Equilibrium, negative: int) -> CellPeaks:
    energy = problem.energy_density(here.at)
    grad = here.at.F - (np.eye(3) + here.H)[:, :, None]
    return CellPeaks(
        grad=np.abs(grad).max(axis=2)[None],
        energy=np.array([energy.max()]),
        energy_mean=np.array([problem.copies * float(problem.w @ energy)]),
        min_jacobian=np.array([here.at.J.min()]),
        min_gap=np.array([gap(problem, here)]),
        negative_pivots=np.array([float(negative)]),
    )


def _tangent(here: Equilibrium, mean_grad: Any, second: Any) -> CellTangent:
    """Named derivatives from the columns of θ; adds the fluid's share −p J₀ of W."""
    F0 = np.eye(3) + here.H
    second[:9, :9] -= here.p * cofactor_tangent(F0).reshape(9, 9)
    second[:9, 9] -= cofactor(F0).ravel()
    second[9, :9] -= cofactor(F0).ravel()
    return CellTangent(
        mean_grad_grad_u=mean_grad[:, :, :9].reshape(1, 3, 3, 3, 3),
        mean_grad_p=mean_grad[None, :, :, 9],
        stress_grad_u=second[:9, :9].reshape(1, 3, 3, 3, 3),
        stress_p=second[:9, 9].reshape(1, 3, 3),
        fluid_volume_grad_u=-second[9, :9].reshape(1, 3, 3),
        fluid_volume_p=-second[9:, 9],
    )


def _differentiate(
    problem: SolidProblem,
    here: Equilibrium,
    entries: Any,
    odd: str,
    columns: Any,
    mean_grad: Any,
    second: Any,
) -> bool:
    """Fill the columns of one parity class, whose perturbations meet no other class.

    They become NaN where the linear solver does not reach its tolerance. Returns whether a direction of
    negative curvature was met.
    """
    at, w = here.at, problem.w
    constraints = problem.constraints(odd)
    matrix = constraints.pattern.full(entries)
    loads = [_load_change(problem, at, column) for column in columns]  # ∂(P + p cof F)/∂θ at fixed u¹
    R = np.stack([problem.assemble(load).ravel()[constraints.free] for load in loads], axis=1)
    if constraints.counts:
        solved = refine(matrix, -R, constraints.precondition, tolerance=SENSITIVITY_TOLERANCE)
    else:
        solved = conjugate_gradients(
            matrix, -R, constraints.precondition, tolerance=SENSITIVITY_TOLERANCE, limit=200
        )
    U = solved.x if solved.converged else np.full_like(solved.x, np.nan)
    mixed = R.T @ U
    curvature = mixed + mixed.T + U.T @ (matrix @ U)
    mask = _visible(problem, odd)
    for a, column in enumerate(columns):
        field = np.zeros(3 * problem.n_nodes)
        field[constraints.free] = U[:, a]
        mean_grad[:, :, column] = problem.copies * mask * (problem.gradient(field.reshape(3, -1)) @ w)
        explicit = (loads[a] @ w).ravel()
        for b, other in enumerate(columns):
            # ∂²Π/∂θ∂θ' at fixed u¹; Π is linear in p.
            direct = (
                explicit[other]
                if other < 9
                else (float((w * at.cof[column // 3, column % 3]).sum()) if column < 9 else 0.0)
            )
            second[column, other] = problem.copies * (direct + curvature[a, b])
    return solved.indefinite


def _load_change(problem: SolidProblem, at: Any, column: int) -> Any:
    if column == 9:
        return at.cof
    dF = np.zeros((3, 3, 1))
    dF[column // 3, column % 3] = 1.0
    return problem.tangent_apply(at, dF)


def _visible(problem: SolidProblem, odd: str) -> Any:
    """Components of a mean gradient that do not cancel between the images of the eighth."""
    if problem.mesh.domain == "whole":
        return np.ones((3, 3))
    if not odd:
        return np.eye(3)
    i, j = ("xyz".index(axis) for axis in odd)
    mask = np.zeros((3, 3))
    mask[i, j] = mask[j, i] = 1.0
    return mask
