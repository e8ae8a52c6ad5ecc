"""Interface of a contact model and its state; choice of the model of a mesh, its penalty by element edges."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from porocore.cell.contact.forces import Blocks, Forces
from porocore.cell.contact.mirrors import MirrorContact
from porocore.cell.contact.pairs import ContactPairs
from porocore.cell.contact.pore_surface import PoreSurface, pore_surface
from porocore.cell.contact.settings import ContactSettings
from porocore.cell.contact.wall_contact import WallContact
from porocore.cell.materials.energy import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array, IntArray

#: Largest accepted penetration, in mean edges of the wall's facets.
DEEPEST = 0.25


class ContactState(Protocol):
    """Contact at one iterate.

    Attributes
    ----------
    pairs
        Contact pairs; None where they do not depend on the iterate.
    """

    pairs: ContactPairs | None

    @property
    def active(self) -> bool:
        """True where any point of the wall is in contact."""

    @property
    def depth(self) -> float:
        """Largest penetration of the wall."""

    @property
    def forces(self) -> Forces:
        """Energy and first derivatives."""

    def weighted(self, weights: Array) -> Forces:
        """Return energy and first derivatives with other areas (F, q) of the points of the wall; they are linear."""

    def blocks(self, parity: str) -> Blocks:
        """Return the second derivatives for the perturbations of a parity class."""


class ContactModel(Protocol):
    """Contact of the pore wall of one mesh.

    Attributes
    ----------
    deepest
        Largest accepted penetration.
    pairs_move
        True where the contact pairs depend on the iterate.
    surface
        Wall of the undeformed solid with its quadrature points.
    """

    deepest: float
    pairs_move: bool
    surface: PoreSurface

    def at(self, H: Array, u: Array, pairs: ContactPairs | None = None) -> ContactState:
        """Return the contact state of u (nodes, 3) under H, with the given contact pairs or with new ones.

        The energy is continuously differentiable as long as the pairs are the same.
        """


def make_contact_model(
    mesh: CellMesh, settings: ContactSettings, material: StrainEnergy | None = None
) -> ContactModel | None:
    """Return the contact model of a mesh of the solid; None without pores or where the settings switch contact off.

    The penalty stiffness is in units of Young's modulus at small strains, averaged over directions and over the
    elements at the wall, or 1 without a material.
    """
    if settings.kind == "none" or not len(mesh.wall):
        return None
    h = facet_edge(mesh)
    young = material.mean_moduli(elements_at_wall(mesh))[0] if material is not None else 1.0
    model = MirrorContact if mesh.domain == "eighth" else WallContact
    return model(mesh, settings.stiffness * young / h, DEEPEST * h)


def elements_at_wall(mesh: CellMesh) -> IntArray:
    """Return the elements with a facet on the wall."""
    on_wall = np.zeros(len(mesh.points), dtype=bool)
    on_wall[mesh.wall] = True
    return np.flatnonzero(on_wall[mesh.cells[:, :4]].sum(axis=1) >= 3)


def facet_edge(mesh: CellMesh) -> float:
    """Return the mean edge h of the wall's facets, taken as equilateral triangles."""
    surface = pore_surface(mesh)
    return float(np.sqrt(4 / np.sqrt(3) * surface.area / len(surface.facets)))
