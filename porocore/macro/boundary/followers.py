"""Pressure on the deformed surface: nodal forces and their tangent."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from porocore.macro.body.mesh import Facets
from porocore.states import Array


def forces(facets: Facets, u: Array, pressure: float) -> Array:
    """Return the nodal forces (nodes, 3) ∫ p n N da, with the current outward normal n and area a.

    n da = (∂x/∂ξ × ∂x/∂η) dξ dη, so that no deformation gradient is needed. Positive pressure pushes inward; in the
    residual ∫ P:∇N − ∫ t·N it stands with this sign.

    Parameters
    ----------
    facets
        On which it acts.
    u : (nodes, 3)
        Displacement of the whole body.
    pressure
        [E].
    """
    reference = facets.mesh.element.facet
    t = facets.tangents_of(facets.mesh.points + u)
    area = np.cross(t[..., 0], t[..., 1]) * reference.weights[:, None]
    local = pressure * np.einsum("fqi,qa->fai", area, reference.values)
    total = np.zeros_like(u)
    np.add.at(total, facets.nodes, local)
    return total


def tangent(facets: Facets, u: Array, pressure: float) -> Any:
    """Return the derivative of :func:`forces` by u, sparse (3 nodes, 3 nodes); symmetric but for the edge."""
    reference = facets.mesh.element.facet
    t = facets.tangents_of(facets.mesh.points + u)
    # δ(t1 × t2)_i = ε_ijk (t2_k δt1_j − t1_k δt2_j)
    slopes = [sign * np.einsum("ijk,fqk->fqij", _EPSILON, t[..., other]) for sign, other in ((1, 1), (-1, 0))]
    w, N, dN = reference.weights, reference.values, reference.gradients
    first, second = (
        np.einsum("q,qa,qb,fqij->faibj", w, N, dN[..., k], slopes[k], optimize=True) for k in (0, 1)
    )
    blocks = first + second
    dofs = (3 * facets.nodes[:, :, None] + np.arange(3)).reshape(len(facets.nodes), -1)
    m = dofs.shape[1]
    rows, columns = np.repeat(dofs, m, axis=1).ravel(), np.tile(dofs, (1, m)).ravel()
    n = u.size
    return sparse.csr_matrix((pressure * blocks.ravel(), (rows, columns)), shape=(n, n))


_EPSILON = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPSILON[_i, _j, _k], _EPSILON[_i, _k, _j] = 1.0, -1.0
