"""Interpolation of displacement and pressure at probes: the element that holds a point, and its weights."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from porocore.core.units import spoken
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.states import Array

#: How far outside its element a point may lie, in reference coordinates.
LEEWAY = 1e-6


def interpolation(mesh: BodyMesh, probes: Mapping[str, tuple[float, float, float]]) -> Any:
    """Return the sparse matrix (4 probes, unknowns) from all unknowns to u_1, u_2, u_3 and p of each probe.

    Raises
    ------
    ConfigurationError
        A probe lies outside the body.
    """
    element, rows = mesh.element, sparse.lil_matrix((4 * len(probes), mesh.size))
    for number, (name, place) in enumerate(probes.items()):
        cell, xi = _find(mesh, np.array(place), f"macro.probes.{name}")
        values, corner = element.values(xi[None])[0], element.corner_values(xi[None])[0]
        for i in range(3):
            rows[4 * number + i, 3 * mesh.cells[cell] + i] = values
        rows[4 * number + 3, mesh.n_u + mesh.p_cells[cell]] = corner
    return rows.tocsr()


def _find(mesh: BodyMesh, place: Array, key: str) -> tuple[int, Array]:
    """Return the element that holds a point, and its reference coordinates there."""
    nodes = mesh.points[mesh.cells]
    first, last = nodes.min(axis=1), nodes.max(axis=1)
    # A curved element may reach a little beyond the box of its nodes.
    margin = 0.1 * (last - first).max(axis=1, keepdims=True)
    near = ((place >= first - margin) & (place <= last + margin)).all(axis=1)
    for cell in np.flatnonzero(near):
        xi = _invert(mesh, nodes[cell], place)
        inside = xi is not None and xi.min() > -LEEWAY
        if xi is not None and inside:
            beyond = xi.max() - 1 if mesh.element.shape == "hexahedron" else xi.sum() - 1
            if beyond < LEEWAY:
                return int(cell), xi
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    said = partial(spoken().texts, quantity="displacement", digits=6)
    unit = (
        "multiples of scales.length where they have no unit" if spoken().given else "lengths as in macro.body"
    )
    raise ConfigurationError(
        f"{key}: the point {said(place)} lies outside the body, which extends from {said(low)} to {said(high)}; move "
        f"it inside (coordinates are {unit})"
    )


def _invert(mesh: BodyMesh, nodes: Array, place: Array) -> Array | None:
    """Return the reference coordinates of a place by Newton's method; None if it does not converge."""
    element = mesh.element
    xi, size = element.nodes[: element.corners].mean(axis=0), float(np.ptp(nodes, axis=0).max())
    for _ in range(30):
        error = element.values(xi[None])[0] @ nodes - place
        if np.abs(error).max() < 1e-12 * size:
            return np.asarray(xi)
        jacobian = nodes.T @ element.gradients(xi[None])[0]
        xi = xi - np.linalg.solve(jacobian, error)
        if np.abs(xi).max() > 5:
            return None
    return None
