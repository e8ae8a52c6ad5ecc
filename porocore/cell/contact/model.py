"""What a solid problem asks of contact, and which kind serves which domain."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from porocore.cell.contact.contact_state import ContactState
from porocore.cell.contact.mirrors import MirrorContact
from porocore.cell.contact.pore_surface import pore_surface
from porocore.cell.contact.settings import ContactSettings
from porocore.cell.contact.wall_contact import WallContact
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array, IntArray


class ContactModel(Protocol):
    """Contact of one mesh.

    Attributes
    ----------
    deepest
        A penetration beyond this is no contact any more.
    pairs_move
        Whether what touches what depends on the iterate.
    """

    deepest: float
    pairs_move: bool

    def at(self, H: Array, u: Array, like: ContactState | None = None) -> ContactState:
        """At u (nodes, 3) under H.

        What touches what is taken over from ``like`` where it is given: between iterates with the same pairs the
        energy is continuously differentiable.
        """


def make_contact_model(
    mesh: CellMesh, settings: ContactSettings, material: StrainEnergy | None = None
) -> ContactModel | None:
    """Of the wall of a mesh of the solid; None where the settings say so, or where there are no pores.

    The penalty is in units of the material's Young's modulus at small strains, averaged over directions and over the
    elements at the wall; of 1 without a material.
    """
    if settings.kind == "none" or not len(mesh.wall):
        return None
    h = facet_edge(mesh)
    young = material.mean_moduli(_at_wall(mesh))[0] if material is not None else 1.0
    stiffness = settings.stiffness * young / h
    if mesh.domain == "eighth":
        return MirrorContact(mesh, stiffness, DEEPEST * h)
    return WallContact(mesh, stiffness, DEEPEST * h)


def _at_wall(mesh: CellMesh) -> IntArray:
    """Elements with a facet on the wall."""
    on_wall = np.zeros(len(mesh.points), dtype=bool)
    on_wall[mesh.wall] = True
    return np.flatnonzero(on_wall[mesh.cells[:, :4]].sum(axis=1) >= 3)


#: In units of the mean edge of the wall's facets.
DEEPEST = 0.25


def facet_edge(mesh: CellMesh) -> float:
    """Mean edge h of the wall's facets, as if they were equilateral triangles."""
    wall = pore_surface(mesh)
    return float(np.sqrt(4 / np.sqrt(3) * wall.area / len(wall.facets)))
