"""States (H, p) at the quadrature points of a body's elements."""

from __future__ import annotations

import numpy as np

from porocore.macro.body.mesh import BodyMesh
from porocore.states import Array, IntArray, MacroState


def point_states(mesh: BodyMesh, u: Array, p: Array, elements: IntArray | None = None) -> MacroState:
    """Return H and p at all quadrature points of some elements, or of all, element by element.

    Parameters
    ----------
    mesh
        Of the body.
    u, p : (nodes, 3), (nodes,)
        Displacement and pressure at all nodes.
    elements
        Numbers of the elements; None: all.
    """
    element, cells = mesh.element, mesh.cells if elements is None else mesh.cells[elements]
    slopes = element.gradients(element.points)
    u_by_xi, X_by_xi = (
        np.einsum("eai,qaj->eqij", values[cells], slopes, optimize=True) for values in (u, mesh.points)
    )
    at_points = p[cells[:, : element.corners]] @ element.corner_values(element.points).T
    return MacroState((u_by_xi @ np.linalg.inv(X_by_xi)).reshape(-1, 3, 3), at_points.ravel())
