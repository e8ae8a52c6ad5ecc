"""What a pore geometry says of itself, and the part of a cell that it contributes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Literal

from porocore.cell.meshing.estimate import PER_CUBE
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.core.models.strict import StrictModel
from porocore.core.tensors.point_group import CUBIC, MIRRORS, TRIVIAL, PointGroup
from porocore.states import IntArray

Unfolding = Literal["wedge", "eighth", "whole"]


class PoreGeometry(StrictModel, ABC):
    """The shape of the pores in the unit cube [−½, ½]³, which repeats itself periodically.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.geometry.kinds.Geometry`. Most derive :class:`porocore.cell.geometry.cad.DrawnGeometry` or
    :class:`porocore.cell.level_sets.level_set.LevelSetGeometry`, which make the mesh.
    """

    @property
    @abstractmethod
    def porosity(self) -> float:
        """Volume share of the pores, φ_f, as exactly as the geometry is known; 0 for a cell without any."""

    @property
    @abstractmethod
    def unfolding(self) -> Unfolding:
        """The part that is meshed and unfolded by mirrors.

        The wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cubic cell, or the eighth [0, ½]³ of a cell that is symmetric under the three
        mirrors through its middle; else the whole, a cell without such mirrors.
        """

    @property
    @abstractmethod
    def description(self) -> str:
        """A few words for a reader, such as ``spheres of radius 0.4 on a cubic lattice``."""

    @property
    def point_group(self) -> PointGroup:
        """The operations of the cube that leave the pores as they are, together with some shift of the periodic cell.

        Here: those that unfold the part. A kind that has more says so. To leave out some costs accuracy, to claim too
        many makes laws wrong. Parts of the solid that differ in material may change places, see :meth:`regions_after`.
        """
        return {"wedge": CUBIC, "eighth": MIRRORS, "whole": TRIVIAL}[self.unfolding]

    def regions_after(self, Q: IntArray) -> Mapping[str, str] | None:
        """Return to which region of the solid an operation Q (3, 3) of the point group takes each, by name.

        A region that is not named stays where it is; None: regions are not taken to regions.
        """
        return {}

    @property
    def disconnected(self) -> str | None:
        """Why the solid does not hang together from cell to cell; empty if it does, None where only a mesh can tell."""
        return None

    def elements(self, size: float) -> float:
        """Return about how many tetrahedra of the given size fill the whole cell, without meshing it."""
        return PER_CUBE / size**3

    @abstractmethod
    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        """Mesh the part, both phases with the same nodes on the wall.

        Nodes on the planes of the part lie there to 1e-9; those of a whole cell lie there exactly, and opposite faces
        have the same nodes to the last bit.

        Parameters
        ----------
        size
            Of the elements, in lengths of the cell.

        Raises
        ------
        PorocoreError
            The geometry cannot be meshed.
        """
