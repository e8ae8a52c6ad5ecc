"""Slopes of the contact energy by a motion of the undeformed wall and by the penalty (contact_slopes).

The energy depends on the undeformed wall by the positions x = F₀ X + u, by the areas of its points, and by the penalty
ε/h, since the mean edge h of the wall's facets is proportional to the root of its area. The contact pairs are kept, as
they are for the derivatives by u and H: the slopes are exact as long as no point changes its triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.cell.contact.forces import scatter
from porocore.cell.contact.model import ContactModel, ContactState
from porocore.cell.contact.pore_surface import DEGREE, PoreSurface
from porocore.cell.meshing.quadrature import triangle_rule
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class ContactSlopes:
    """Slopes of the contact energy E and of its derivatives by one parameter, at fixed u and H.

    Attributes
    ----------
    energy : float
        Slope of E.
    by_load : (3, 3)
        Slope of ∂E/∂H.
    by_displacement : (nodes, 3)
        Slope of ∂E/∂u.
    """

    energy: float
    by_load: Array
    by_displacement: Array


def contact_slopes(
    contact: ContactModel,
    touching: ContactState,
    F0: Array,
    points: Array,
    velocity: Array,
    log_penalty: float,
) -> ContactSlopes:
    """Return the slopes of the contact energy of one state.

    Parameters
    ----------
    contact
        Contact of the pore wall.
    touching
        Its state.
    F0 : (3, 3)
        I + H.
    points : (nodes, 3)
        Undeformed nodes of the solid.
    velocity : (nodes, 3)
        Slope of their positions, which keeps periodicity and mirrors.
    log_penalty : float
        Slope of the logarithm of ε at fixed h.
    """
    surface, forces, blocks = contact.surface, touching.forces, touching.blocks("")
    areas = area_slopes(surface, points, velocity)
    log_penalty = log_penalty - float(areas.sum()) / surface.area / 2
    reweighted = touching.weighted(areas + log_penalty * surface.weights)

    def moved(nodes: IntArray) -> Array:
        """Return V at nodes (m, k), 0 at the places without a node, which lie on mirror planes."""
        return np.where(nodes[:, :, None] >= 0, velocity[nodes], 0.0)

    shifted = moved(blocks.nodes) @ F0.T
    m, k = blocks.nodes.shape
    change = (blocks.matrices @ shifted.reshape(m, 3 * k, 1)).reshape(m, k, 3)
    by_load = np.einsum("mki,mkj->ij", change, blocks.places)
    by_load += np.einsum("mki,mkj->ij", forces.gradient, moved(forces.nodes))
    n = len(points)
    return ContactSlopes(
        energy=float((forces.gradient * (moved(forces.nodes) @ F0.T)).sum()) + reweighted.energy,
        by_load=by_load + reweighted.by_load,
        by_displacement=scatter(n, blocks.nodes, change) + reweighted.by_displacement(n),
    )


def area_slopes(surface: PoreSurface, points: Array, velocity: Array) -> Array:
    """Return the slopes (F, q) of the undeformed areas of the wall's points, for nodes that move with ``velocity``."""
    _, weights = triangle_rule(DEGREE)
    first, second = np.moveaxis(np.einsum("qas,fai->fqsi", surface.dN, points[surface.facets]), 2, 0)
    first_slope, second_slope = np.moveaxis(
        np.einsum("qas,fai->fqsi", surface.dN, velocity[surface.facets]), 2, 0
    )
    normal = np.cross(first, second)
    slope = np.cross(first_slope, second) + np.cross(first, second_slope)
    return np.asarray((normal * slope).sum(axis=2) / np.linalg.norm(normal, axis=2) * weights)
