"""What a pore geometry says of itself, and the part of a cell that it draws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from porocore.states import Array

Unfolding = Literal["wedge", "eighth"]


@dataclass(frozen=True)
class DrawnPart:
    """Tags in a gmsh model.

    Attributes
    ----------
    solid, fluid
        Volumes; none where the phase is absent.
    fillets, channels
        Faces of the wall that the CAD kernel has only approximately.
    extruded
        The volumes are one layer of elements along an axis along which nothing changes.
    """

    solid: list[int]
    fluid: list[int]
    fillets: list[int] = field(default_factory=list)
    channels: list[int] = field(default_factory=list)
    extruded: bool = False


class PoreGeometry(BaseModel, ABC):
    """The shape of the pores in the unit cube [−½, ½]³, symmetric under the three mirrors through its middle.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.geometry.Geometry`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    @property
    @abstractmethod
    def porosity(self) -> float:
        """Exact volume share of the pores, φ_f; 0 for a cell without any."""

    @property
    @abstractmethod
    def unfolding(self) -> Unfolding:
        """The part that is drawn: the wedge 0 ≤ x ≤ y ≤ z ≤ ½ of a cubic cell, else the eighth [0, ½]³."""

    @property
    @abstractmethod
    def description(self) -> str:
        """A few words for a reader, such as ``spheres of radius 0.4 on a cubic lattice``."""

    @abstractmethod
    def draw(self, gmsh: Any) -> DrawnPart:
        """Add the part to the current gmsh model, and synchronise."""

    @property
    def loose(self) -> str:
        """Why the solid of neighbouring cells does not hang together, so that it has no stiffness; else empty."""
        return ""

    @property
    def narrowest(self) -> float:
        """A length that elements must not exceed by much, whatever the settings; infinite where there is none."""
        return float("inf")

    @property
    def finest_fillet(self) -> float:
        """Radius of the fillets of :attr:`DrawnPart.fillets`; 0 without any."""
        return 0.0

    def gap(self, x: float, y: float, z: float) -> float:
        """How wide the fluid is between walls beside a point of the part, as far as elements must follow it."""
        return float("inf")

    def onto_fillet(self, points: Array) -> Array:
        """Points (n, 3) of the drawn part near a fillet, moved onto it; as they are where there is none."""
        return points

    def onto_channel(self, points: Array) -> Array:
        """Points (n, 3) of the drawn part near a channel's wall, moved onto it; as they are where there is none."""
        return points
