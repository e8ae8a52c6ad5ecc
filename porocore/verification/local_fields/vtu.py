"""Local fields of the solid as a .vtu file that ParaView opens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from porocore.core.units.results import ResultUnits, spoken
from porocore.report.vtk import write_vtu
from porocore.states import Array
from porocore.verification.local_fields.nodal import NodalFields


def write_fields(path: Path, nodal: NodalFields) -> Path:
    """Write one .vtu file of the solid of the whole cell, atomically; returns its path.

    Linear or quadratic tetrahedra (VTK types 10 and 24) on the undeformed cell. At the nodes: ``u1`` (u¹) and
    ``u1_magnitude`` [–]; ``displacement`` (H X + u¹), by which ParaView's filter Warp By Vector deforms the cell;
    ``grad_u1`` (∇u¹) and ``F``, ``P`` (first Piola–Kirchhoff) and ``cauchy`` [E], tensors of 9 components, row by row;
    ``J``, ``energy`` (Ψ) and ``von_mises`` [E]. In the elements: ``mean_energy``, ``mean_J`` and ``max_energy``, of the
    quadrature points, which no recovery has touched. In a study with scales what is in E has its unit of stress, with
    which its name ends, ``P [kPa]``; lengths stay in edges of the cell.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    points = nodal.points
    share = points.volume / points.volume.sum(axis=1, keepdims=True)
    units = spoken()
    at_nodes = {
        "u1": points.u,
        "u1_magnitude": np.linalg.norm(points.u, axis=1),
        "displacement": nodal.displacement,
        "grad_u1": nodal.grad,
        "F": nodal.F,
        "J": nodal.J,
        **_measured({"energy": nodal.energy}, "energy-density", units),
        **_measured(
            {"P": nodal.stress, "cauchy": nodal.cauchy, "von_mises": nodal.von_mises}, "stress", units
        ),
    }
    energies = {"mean_energy": (share * points.energy).sum(axis=1), "max_energy": points.energy.max(axis=1)}
    in_elements = {
        "mean_J": (share * points.J).sum(axis=1),
        **_measured(energies, "energy-density", units),
    }
    return write_vtu(path, points.mesh.points, points.mesh.cells, at_nodes, in_elements)


def _measured(fields: Mapping[str, Array], quantity: str, units: ResultUnits) -> dict[str, Array]:
    return {units.titled(name, quantity): units.factor(quantity) * values for name, values in fields.items()}
