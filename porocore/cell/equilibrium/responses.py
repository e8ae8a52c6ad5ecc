"""Responses at an equilibrium: averages, their derivatives by H and p, status by unstable modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorisedTangent, Iterate
from porocore.cell.equilibrium.integrals import Sensitivities
from porocore.cell.equilibrium.path import gap
from porocore.cell.equilibrium.solid_slopes import ExplicitDependence, SolidSlopes, solid_slopes
from porocore.cell.symmetry.exchange import axis_order, images
from porocore.cell.symmetry.parity import UNIT_LOADS, classes, visible
from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.states import Array, CellExtrema, CellResponse, CellTangent, Status


def respond(problem: DiscreteSolid, iterate: Iterate, *, tangent: bool) -> CellResponse:
    """Return one row of responses; ``unstable`` where the tangent of any parity class is indefinite.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    return respond_with_slopes(problem, iterate, (), tangent=tangent)[0]


def respond_with_slopes(
    problem: DiscreteSolid, iterate: Iterate, dependences: Sequence[ExplicitDependence], *, tangent: bool
) -> tuple[CellResponse, SolidSlopes | None]:
    """Return one row of responses, and its slopes by parameters; None without derivatives or parameters.

    Parameters
    ----------
    problem
        Solid.
    iterate
        Equilibrium.
    dependences
        Explicit dependence of the solid on each parameter.
    tangent
        Whether derivatives are wanted.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    slopes = None
    mean_grad, second = np.zeros((3, 3, 10)), np.zeros((10, 10))
    counts = []
    swaps = problem.exchanged_axes(iterate)
    of_images: dict[str, int] = {}
    for parity, columns in classes(problem.mesh).items():
        first = min(images(parity, swaps))
        derived = tangent and bool(columns)
        if first in of_images and (not derived or iterate.touching is None):
            if derived:
                _exchange_axes(mean_grad, second, axis_order(first, parity, swaps), columns)
            counts.append(of_images[first])
            continue
        factor = problem.factor(iterate, parity)
        answer = None
        if derived:
            answer = problem.sensitivities(factor, columns)
            grad = problem.copies * visible(problem.mesh, parity) * answer.grad
            mean_grad[:, :, columns] = np.moveaxis(grad, 0, -1)
            second[np.ix_(columns, columns)] = problem.copies * (
                answer.second + _direct(iterate, parity, columns)
            )
            if not parity and dependences:
                slopes = solid_slopes(problem, factor, answer, dependences)
        of_images[first] = _unstable_modes(problem, factor, answer)
        counts.append(of_images[first])
    # Where one class is unknown, the number is so too unless another one has unstable modes.
    negative = sum(max(count, 0) for count in counts) or min(counts)
    row = _row(problem, iterate, negative, _tangent(iterate, mean_grad, second) if tangent else None)
    return row, slopes


def _exchange_axes(mean_grad: Array, second: Array, order: Sequence[int], columns: Sequence[int]) -> None:
    """Fill in the derivatives by the loads of a class from those of the class that an exchange of axes maps onto it."""
    sources = [3 * order[column // 3] + order[column % 3] for column in columns]
    mean_grad[:, :, columns] = mean_grad[np.ix_(order, order, sources)]
    second[np.ix_(columns, columns)] = second[np.ix_(sources, sources)]


def _unstable_modes(problem: DiscreteSolid, factor: FactorisedTangent, answer: Sensitivities | None) -> int:
    """Return the number of negative eigenvalues; -1 where neither the factor nor the answer tells it."""
    if factor.negative >= 0 or answer is None:
        return problem.negative_eigenvalues(factor)
    return answer.negative


def _direct(iterate: Iterate, parity: str, columns: Sequence[int]) -> Array:
    """Return ∂²E/∂θ∂θ' of the energy E of contact at fixed u¹."""
    if iterate.touching is None:
        return np.zeros((len(columns), len(columns)))
    blocks = iterate.touching.blocks(parity)
    return np.array([[blocks.second(UNIT_LOADS[i], UNIT_LOADS[j]) for j in columns] for i in columns])


def _row(
    problem: DiscreteSolid, iterate: Iterate, negative: int, tangent: CellTangent | None
) -> CellResponse:
    integrals, copies = problem.integrals(iterate), problem.copies
    seen = visible(problem.mesh)
    F0 = np.eye(3) + iterate.H
    J0 = float(determinant(F0))
    contact = iterate.touching.forces if iterate.touching is not None else None
    energy = integrals.energy + (contact.energy if contact else 0.0)
    stress = integrals.stress + (contact.by_load if contact else 0.0)
    stable = Status.converged if contact is None else Status.contact
    return CellResponse(
        mean_grad=(copies * seen * integrals.grad)[None],
        status=np.array([Status.unstable if negative > 0 else stable], dtype=np.int64),
        potential=np.array([copies * (energy + iterate.p * integrals.volume) - iterate.p * J0]),
        stress=(copies * seen * stress - iterate.p * cofactor(F0))[None],
        fluid_volume=np.array([J0 - copies * integrals.volume]),
        tangent=tangent,
        extrema=CellExtrema(
            grad=integrals.largest_grad[None],
            energy=np.array([integrals.largest_energy]),
            energy_mean=np.array([copies * integrals.energy]),
            min_jacobian=np.array([iterate.min_jacobian]),
            min_gap=np.array([gap(problem, iterate)]),
            negative_pivots=np.array([float(negative)]),
            contact_share=np.array([contact.share if contact else 0.0]),
        ),
    )


def _tangent(iterate: Iterate, mean_grad: Any, second: Any) -> CellTangent:
    """Return the derivatives by name from the columns of θ, with the fluid's share −p J₀ of W."""
    F0 = np.eye(3) + iterate.H
    second[:9, :9] -= iterate.p * cofactor_tangent(F0).reshape(9, 9)
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
