"""A cell: the pore geometry, the solid's material, the fluid's viscosity, and how finely it is meshed."""

from __future__ import annotations

import hashlib
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from porocore.cell.contact import ContactSettings
from porocore.cell.geometry import Geometry, OrthogonalChannels
from porocore.cell.mesh import CellMesh, Domain, MeshSettings, Phase, make_mesh
from porocore.cell.supercell import block
from porocore.materials.neo_hookean import NeoHookean

Cells = Annotated[int, Field(ge=1, le=8)]


class Cell(BaseModel):
    """Everything that determines the cell problems, as it stands in the configuration."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    geometry: Geometry = OrthogonalChannels()
    material: NeoHookean = NeoHookean()
    viscosity: Annotated[float, Field(gt=0)] = 1e-3
    """μ_f; K is proportional to its inverse."""
    mesh: MeshSettings = MeshSettings()
    contact: ContactSettings = ContactSettings()
    symmetry: Literal["auto", "none"] = "auto"
    """auto: the eighth of the cell wherever pores and load are mirror-symmetric; none: always the whole cell."""
    supercell: tuple[Cells, Cells, Cells] = (1, 1, 1)
    """Whole cells along each axis that are solved as one; more than one leaves the mirror symmetry out."""

    @property
    def symmetric(self) -> bool:
        """Whether the pores have mirrors that may be made use of; the flow is then solved on the eighth."""
        return self.symmetry == "auto" and self.geometry.unfolding != "whole"

    @property
    def mirrored(self) -> bool:
        """Whether states without shear are solved on the eighth."""
        return self.symmetric and self.supercell == (1, 1, 1)

    @property
    def identity(self) -> str:
        """Hash of the specification."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def make_mesh(self, phase: Phase, domain: Domain) -> CellMesh:
        """Mesh of one phase on the eighth or on the whole cell, the same on every machine and for every backend.

        The whole solid is that of the supercell; the flow repeats itself in every cell.
        """
        mesh = make_mesh(self.geometry, self.mesh, phase, domain)
        if phase == "solid" and domain == "whole" and self.supercell != (1, 1, 1):
            return block(mesh, self.supercell)
        return mesh
