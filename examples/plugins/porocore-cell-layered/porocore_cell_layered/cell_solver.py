"""A cell solver for plane layers, in closed form: a reference that shares no discretisation with finite elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore import (
    Cell,
    CellExtrema,
    CellResponse,
    CellSolution,
    CellSolver,
    CellTangent,
    ConfigurationError,
    MacroState,
    Status,
    failed_response,
)
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore_cell_layered.laminate import Laminate
from porocore_cell_layered.layers import Layers, layers_of


@dataclass(frozen=True, eq=False)
class Prepared:
    """A cell that consists of layers."""

    cell: Cell
    layers: Layers
    laminate: Laminate


class LayeredCellSolver(CellSolver[Prepared]):
    """Layers of any materials, with or without fluid between them, at finite strain and with exact derivatives.

    The fluid flows along a layer of thickness h with the conductivity h³/(12 μ_f), and not across.

    Raises
    ------
    ConfigurationError
        It is given options.
    """

    def __init__(self, **unknown):
        if unknown:
            raise ConfigurationError(f"fem.options.{min(unknown)}: layered takes no options; remove it")

    def prepare(self, cell: Cell) -> Prepared:
        """Find the layers.

        Raises
        ------
        ConfigurationError
            The cell does not consist of plane layers.
        """
        layers = layers_of(cell)
        return Prepared(cell, layers, Laminate(layers.solids, layers.axis, bool(layers.channels)))

    def solve(self, prepared: Prepared, states: MacroState, *, start=None, tangent=True, fields=False):
        """See porocore.CellSolver; there are no fields, and a start makes no difference."""
        rows = [_row(prepared, H, float(p), tangent) for H, p in zip(states.grad_u, states.p, strict=True)]
        return CellSolution(
            CellResponse.concatenate(rows) if rows else failed_response(Status.lost, tangent=tangent)[:0]
        )

    def conductivity(self, prepared: Prepared):
        """See porocore.CellSolver."""
        along = np.eye(3)
        along[prepared.layers.axis] = 0.0
        return sum(h**3 for h in prepared.layers.channels) / (12 * prepared.cell.viscosity) * along


def _row(prepared: Prepared, H, p: float, tangent: bool) -> CellResponse:
    laminate, F = prepared.laminate, np.eye(3) + H
    status, a = laminate.solve(F, p)
    if a is None:
        return failed_response(status, tangent=tangent)
    c, axis = laminate.shares, laminate.axis
    gradients = laminate.gradients(F, a)
    pairs = list(zip((material for material, _ in laminate.solids), gradients, strict=True))
    energy = np.array([material.energy_density(f) for material, f in pairs])
    J, cof = determinant(gradients), cofactor(gradients)
    J0, cof0 = determinant(F[None])[0], cofactor(F[None])[0]
    local = np.array([material.stress(f) for material, f in pairs]) + p * cof
    mean_grad = np.zeros((3, 3))
    mean_grad[:, axis] = c @ a
    peak = np.zeros((3, 3))
    peak[:, axis] = np.abs(a).max(axis=0)
    return CellResponse(
        mean_grad=mean_grad[None],
        status=np.array([int(status)]),
        potential=np.array([c @ (energy + p * J) - p * J0]),
        stress=(np.einsum("k,kij->ij", c, local) - p * cof0)[None],
        fluid_volume=np.array([J0 - c @ J]),
        tangent=_tangent(laminate, F, p, a) if tangent else None,
        extrema=CellExtrema(
            grad=peak[None],
            energy=np.array([energy.max()]),
            energy_mean=np.array([c @ energy]),
            min_jacobian=np.array([J.min()]),
            min_gap=np.array([np.nan]),
            negative_pivots=np.array([float(laminate.negative(F, a))]),
            contact_share=np.zeros(1),
        ),
    )


def _tangent(laminate: Laminate, F, p: float, a) -> CellTangent:
    """By the chain rule through a_k(H, p)."""
    c, axis = laminate.shares, laminate.axis
    gradients = laminate.gradients(F, a)
    a_by = laminate.sensitivities(F, p, a)
    F_by = np.zeros((len(a), 3, 3, 10))
    F_by[:, :, :, :9] = np.eye(9).reshape(3, 3, 9)
    F_by[:, :, axis] += a_by
    cof, cof0 = cofactor(gradients), cofactor(F[None])[0]
    tangents = [material.tangent(f) for (material, _), f in zip(laminate.solids, gradients, strict=True)]
    local = np.array(tangents) + p * cofactor_tangent(gradients)
    stress = np.einsum("k,kijmn,kmnr->ijr", c, local, F_by)
    stress[:, :, :9] -= p * cofactor_tangent(F[None])[0].reshape(3, 3, 9)
    stress[:, :, 9] += np.einsum("k,kij->ij", c, cof) - cof0
    volume = -np.einsum("k,kij,kijr->r", c, cof, F_by)
    volume[:9] += cof0.ravel()
    mean_grad = np.zeros((3, 3, 10))
    mean_grad[:, axis] = np.einsum("k,kir->ir", c, a_by)
    return CellTangent(
        mean_grad_grad_u=mean_grad[None, :, :, :9].reshape(1, 3, 3, 3, 3),
        mean_grad_p=mean_grad[None, :, :, 9].copy(),
        stress_grad_u=stress[None, :, :, :9].reshape(1, 3, 3, 3, 3),
        stress_p=stress[None, :, :, 9].copy(),
        fluid_volume_grad_u=volume[None, :9].reshape(1, 3, 3),
        fluid_volume_p=volume[None, 9].copy(),
    )
