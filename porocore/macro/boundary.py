"""What is prescribed at which node of the box, and what loads and flows through its faces amount to there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.errors import ConfigurationError
from porocore.macro.mesh import BoxMesh
from porocore.problem import FACES, Boundary, Face
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class BoundaryData:
    """Under a load of 1, by the unknowns' numbers in the mesh.

    Attributes
    ----------
    prescribed, values : (k,)
        Unknowns that are prescribed, ascending, and their values.
    external : (unknowns,)
        −∫ t̄ N dS of the displacements, less the force on a plate in the first of its unknowns, and ∫ q̄ N dS of the
        pressures.
    plates
        Unknowns that are one, ascending, for each rigid plate.
    """

    prescribed: IntArray
    values: Array
    external: Array
    plates: tuple[IntArray, ...] = ()


def boundary_data(mesh: BoxMesh) -> BoundaryData:
    """From the problem's faces.

    Raises
    ------
    ConfigurationError
        Two faces prescribe different values on their common edge, one holds the edge of another's plate, or a
        translation is not held.
    """
    values = np.full(mesh.size, np.nan)
    external = np.zeros(mesh.size)
    plates: dict[Face, IntArray] = {}
    u, p = external[: mesh.n_u].reshape(-1, 3), external[mesh.n_u :]
    for face in FACES:
        boundary = mesh.problem.boundary.get(face, Boundary())
        on_face = _on_face(mesh, face)
        nodes, p_nodes = np.flatnonzero(on_face), np.flatnonzero(on_face[mesh.p_nodes])
        for i, value in enumerate(boundary.displacement):
            _prescribe(values, 3 * nodes + i, value, f"u_{i + 1}", face)
        _prescribe(values, mesh.n_u + p_nodes, boundary.pressure, "p", face)
        if any(boundary.traction):
            u[nodes] -= np.outer(_areas(mesh, face, nodes, (1 / 6, 4 / 6)), boundary.traction)
        if boundary.plate is not None:
            plates[face] = 3 * nodes + _axis(face)
            external[plates[face][0]] -= boundary.plate
        if boundary.flux:
            p[p_nodes] += boundary.flux * _areas(mesh, face, mesh.p_nodes[p_nodes], (1 / 2, 0))
    for i in range(3):
        if np.isnan(values[i : mesh.n_u : 3]).all():
            raise ConfigurationError(
                f"macro.boundary: nothing holds the body in direction {i + 1}; "
                f"prescribe u_{i + 1} on some face"
            )
    for face, unknowns in plates.items():
        if not np.isnan(values[unknowns]).all():
            raise ConfigurationError(
                f"macro.boundary.{face}: the plate moves as one, but a neighbouring face prescribes "
                f"u_{_axis(face) + 1} on their common edge; leave that component free there"
            )
    prescribed = np.flatnonzero(~np.isnan(values))
    return BoundaryData(prescribed, values[prescribed], external, tuple(plates.values()))


def _axis(face: Face) -> int:
    return "xyz".index(face[0])


def _on_face(mesh: BoxMesh, face: Face) -> Any:
    axis = _axis(face)
    side = mesh.problem.size[axis] if face[1] == "+" else 0.0
    return np.abs(mesh.points[:, axis] - side) < 1e-6 * mesh.edges[axis]


def _prescribe(values: Any, unknowns: Any, value: float | None, name: str, face: Face) -> None:
    if value is None:
        return
    before = values[unknowns]
    clash = before[~np.isnan(before) & (before != value)]
    if clash.size:
        raise ConfigurationError(
            f"macro.boundary.{face}: {name} = {value:g} contradicts {name} = {clash[0]:g} of a "
            "neighbouring face on their common edge; prescribe it on one of them only"
        )
    values[unknowns] = value


def _areas(mesh: BoxMesh, face: Face, nodes: Any, shares: tuple[float, float]) -> Any:
    """∫ N dS over the face for some of its nodes.

    Shape functions are products of those along the edges, whose integrals are ``shares`` (end, middle) of an
    edge's length: 1/6 and 4/6 for quadratic ones, 1/2 for linear ones, which have no middle node.
    """
    areas = np.ones(len(nodes))
    for axis in {0, 1, 2} - {_axis(face)}:
        halves = np.rint(2 * mesh.points[nodes, axis] / mesh.edges[axis]).astype(int)
        inner = (halves > 0) & (halves < 2 * mesh.problem.elements[axis])
        areas *= mesh.edges[axis] * np.where(halves % 2, shares[1], shares[0] * np.where(inner, 2, 1))
    return areas
