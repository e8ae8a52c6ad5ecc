"""Drainage of a body: whether its fluid can leave, and how long that takes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh

from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.problem import MacroSetup, body_mesh
from porocore.states import Array

#: A conductivity below this share of the largest is none: what the cell solver leaves where no pore runs through.
CLOSED = 1e-6


def undrained(macro: MacroSetup, conductivity: Array) -> list[str]:
    """Return why the body, or a surface with a prescribed pressure, cannot drain; empty where all can.

    Parameters
    ----------
    macro
        With the surfaces on which the pressure is prescribed; the direction is known of those across x, y or z.
    conductivity : (3, 3)
        K of the undeformed cell.
    """
    faces = macro.boundary.items()
    if not any(boundary.pressure is not None or boundary.flux != 0 for _, boundary in faces):
        return [
            "no surface has a prescribed pressure, so no fluid can leave and nothing consolidates; "
            "give one under macro.boundary"
        ]
    K, found = np.diag(conductivity), []
    if K.max() <= 0:
        return [
            "the cell conducts no fluid in any direction, so none leaves through the surfaces whose pressure or flux "
            "is prescribed and nothing consolidates; its pores must run through, see cell.geometry"
        ]
    for name, boundary in faces:
        face = macro.surfaces[name].of if name in macro.surfaces else name
        if face not in Box.surfaces:
            continue
        i = "xyz".index(face[0])
        if boundary.pressure is not None and K[i] <= CLOSED * K.max():
            kind = "face" if name == face else "surface"
            found.append(
                f"the cell conducts no fluid along {face[0]} (K_{i + 1}{i + 1} = {K[i]:.2g}), so none leaves "
                f"through the {kind} {name}, whose pressure is prescribed; see cell.geometry"
            )
    return found


def drainage_time(macro: MacroSetup, coefficients: LinearCoefficients, share: float = 0.95) -> float | None:
    """Return the time in which so large a share of what a sudden load drives out has left; None: nothing can leave.

    It is that of the slowest decaying pore pressure ∂p/∂t = ∇·(c ∇p), zero at surfaces with a prescribed pressure,
    1 − share = 8/π² exp(−λt). So it is exact for a column (Terzaghi), and a scale for other bodies. c_ij is
    K_ij/√(S_i S_j), where K_ii/S_i is the consolidation coefficient of confined compression along an axis.
    """
    mesh = body_mesh(macro)
    drained = [mesh.surface(name, name) for name, b in macro.boundary.items() if b.pressure is not None]
    facets = [nodes.ravel() for nodes in drained if len(nodes)]
    c = coefficients
    if not facets or np.diag(c.conductivity).max() <= 0:
        return None
    moduli, alpha = np.einsum("iiii->i", c.stiffness), np.diag(c.biot)
    root = np.sqrt(c.storage + alpha**2 / moduli)
    diffusivity = c.conductivity / np.outer(root, root)
    largest = float(np.diag(diffusivity).max())
    flow, volume = _diffusion(mesh, diffusivity + CLOSED * largest * np.eye(3))
    free = np.setdiff1d(np.arange(len(mesh.points)), np.concatenate(facets))
    # A start vector makes the result the same every time.
    (rate,) = eigsh(
        flow[free][:, free],
        1,
        volume[free][:, free],
        sigma=0,
        v0=np.ones(len(free)),
        return_eigenvectors=False,
    )
    if rate * np.ptp(mesh.points, axis=0).max() ** 2 <= 100 * CLOSED * largest:
        return None
    return float(np.log(8 / np.pi**2 / (1 - share)) / rate)


def _diffusion(mesh: BodyMesh, diffusivity: Array) -> tuple[Any, Any]:
    """Return the sparse matrices (nodes, nodes) of ∫∇q·c∇p and ∫qp with quadratic functions."""
    element = mesh.element
    values, reference = element.values(element.points), element.gradients(element.points)
    gradients = np.einsum("qak,eqkj->eqaj", reference, np.linalg.inv(mesh.jacobians), optimize=True)
    flow = np.einsum("eq,eqai,ij,eqbj->eab", mesh.weights, gradients, diffusivity, gradients, optimize=True)
    volume = np.einsum("eq,qa,qb->eab", mesh.weights, values, values, optimize=True)
    rows = np.repeat(mesh.cells, mesh.cells.shape[1], axis=1).ravel()
    columns = np.tile(mesh.cells, mesh.cells.shape[1]).ravel()
    shape = (len(mesh.points), len(mesh.points))
    matrices = (csc_array((local.ravel(), (rows, columns)), shape=shape) for local in (flow, volume))
    one, other = matrices
    return one, other
