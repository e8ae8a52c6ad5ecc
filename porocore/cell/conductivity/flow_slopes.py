"""Slopes of the mean flow by a motion of the fluid's nodes (flow_slopes), without an adjoint problem.

The Stokes problem is self-adjoint: ∫ w^j_i dx is the stationary value of ∫ L_ij dx with::

    L_ij = w^i_j + w^j_i − ∇w^i:∇w^j + s^i div w^j + s^j div w^i

for the flows w^i under the unit forces and their pressures s^i. So only the explicit dependence on the nodes counts.
"""

from __future__ import annotations

import numpy as np

from porocore.cell.conductivity.fluid import FlowFields
from porocore.cell.equilibrium.element_gradients import ElementGradients
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.states import Array


def flow_slopes(mesh: CellMesh, points: Array, flow: FlowFields, velocities: Array, degree: int) -> Array:
    """Return the slopes (3, 3, m) of ∫ w^j_i dx.

    Parameters
    ----------
    mesh
        Quadratic mesh of the fluid.
    points : (nodes, 3)
        Positions of its nodes, which may be deformed.
    flow
        Flows on that mesh.
    velocities : (m, nodes, 3)
        Slopes of the positions by m parameters.
    degree
        Degree of the quadrature of the flow.
    """
    gradients = ElementGradients(mesh, degree, points)
    at = tetrahedron_rule(degree)[0]
    N, corner_N = (shape_functions(at, nodes)[0] for nodes in (mesh.cells.shape[1], 4))
    grad = np.stack([gradients.gradient(flow.velocity[:, :, j]) for j in range(3)], axis=2)
    flat = grad.reshape(*grad.shape[:3], 9)
    w = np.einsum("qa,eaij->eqij", N, flow.velocity[mesh.cells], optimize=True)
    s = np.einsum("qa,eaj->eqj", corner_N, flow.pressure[mesh.cells[:, :4]], optimize=True)
    div = np.trace(grad, axis1=3, axis2=4)
    half = w - flat @ flat.swapaxes(2, 3) / 2 + s[..., :, None] * div[..., None, :]
    found = []
    for velocity in velocities:
        grad_V = gradients.gradient(velocity)
        turned = grad @ grad_V[:, :, None]
        change = turned.reshape(flat.shape) @ flat.swapaxes(2, 3)
        change -= s[..., :, None] * np.trace(turned, axis1=3, axis2=4)[..., None, :]
        div_V = np.trace(grad_V, axis1=2, axis2=3)
        slope = gradients.integral(half * div_V[..., None, None] + change)
        found.append(slope + slope.T)
    return np.moveaxis(np.reshape(found, (-1, 3, 3)), 0, -1)
