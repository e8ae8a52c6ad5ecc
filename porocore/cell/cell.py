"""A cell: the pore geometry, the solid's material, the fluid's viscosity, and how finely it is meshed."""

from __future__ import annotations

import hashlib
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from porocore.cell.contact import ContactSettings
from porocore.cell.geometry import OrthogonalChannels
from porocore.cell.material import NeoHookean
from porocore.cell.mesh import CellMesh, Domain, MeshSettings, Phase, make_mesh


class Cell(BaseModel):
    """Everything that determines the cell problems, as it stands in the configuration."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    geometry: OrthogonalChannels = OrthogonalChannels()
    material: NeoHookean = NeoHookean()
    viscosity: Annotated[float, Field(gt=0)] = 1e-3
    """μ_f; K is proportional to its inverse."""
    mesh: MeshSettings = MeshSettings()
    contact: ContactSettings = ContactSettings()
    symmetry: Literal["auto", "none"] = "auto"
    """auto: the eighth of the cell wherever geometry and load are mirror-symmetric; none: always the whole cell."""

    @property
    def identity(self) -> str:
        """Hash of the specification."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def make_mesh(self, phase: Phase, domain: Domain) -> CellMesh:
        """Mesh of one phase on the eighth or on the whole cell, the same on every machine and for every backend."""
        return make_mesh(self.geometry, self.mesh, phase, domain)
