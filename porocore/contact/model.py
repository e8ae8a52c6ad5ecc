"""What a solid problem asks of contact, and which kind serves which domain."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from porocore.cell.contact import ContactSettings
from porocore.cell.mesh import CellMesh
from porocore.contact.forces import Blocks, Forces
from porocore.contact.mirrors import MirrorContact
from porocore.contact.wall import wall_of
from porocore.contact.walls import WallContact
from porocore.states import Array


class Touching(Protocol):
    """Contact at one iterate."""

    @property
    def active(self) -> bool:
        """Whether anything touches."""

    @property
    def depth(self) -> float:
        """Of the deepest penetration."""

    @property
    def forces(self) -> Forces:
        """Energy and first derivatives."""

    def blocks(self, odd: str) -> Blocks:
        """Second derivatives for perturbations that are odd under the mirrors of the named axes."""


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

    def at(self, H: Array, u: Array, like: Touching | None = None) -> Touching:
        """At u (nodes, 3) under H.

        What touches what is taken over from ``like`` where it is given: between iterates with the same pairs the
        energy is continuously differentiable.
        """


def contact_of(mesh: CellMesh, settings: ContactSettings) -> ContactModel | None:
    """Of the wall of a mesh of the solid; None where the settings say so, or where there are no pores."""
    if settings.kind == "none" or not len(mesh.wall):
        return None
    h = facet_edge(mesh)
    stiffness = settings.stiffness / h
    if mesh.domain == "eighth":
        return MirrorContact(mesh, stiffness, DEEPEST * h)
    return WallContact(mesh, stiffness, DEEPEST * h)


#: In units of the mean edge of the wall's facets.
DEEPEST = 0.25


def facet_edge(mesh: CellMesh) -> float:
    """Mean edge h of the wall's facets, as if they were equilateral triangles."""
    wall = wall_of(mesh)
    return float(np.sqrt(4 / np.sqrt(3) * wall.area / len(wall.facets)))
