"""List of the pore geometries by ``kind``, and the default one.

A geometry meshes its smallest part that mirrors unfold into the whole cell; :mod:`porocore.cell.meshing.mesh` unfolds
the mesh.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Tag

from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.obstacles import CylinderArray, NoPores, SphereArray
from porocore.cell.geometry.pore_geometry import PoreGeometry
from porocore.cell.geometry.spheres import SpherePores
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh_file import MeshFile
from porocore.core.models.strict import by_kind

__all__ = [
    "CylinderArray",
    "Geometry",
    "MeshFile",
    "NoPores",
    "OrthogonalChannels",
    "PoreGeometry",
    "SphereArray",
    "SpherePores",
    "TriplyPeriodic",
    "Voxels",
]

DEFAULT = "orthogonal-channels"


Geometry = Annotated[
    Annotated[OrthogonalChannels, Tag(DEFAULT)]
    | Annotated[SphereArray, Tag("sphere-array")]
    | Annotated[CylinderArray, Tag("cylinder-array")]
    | Annotated[NoPores, Tag("no-pores")]
    | Annotated[SpherePores, Tag("sphere-pores")]
    | Annotated[TriplyPeriodic, Tag("tpms")]
    | Annotated[Voxels, Tag("voxels")]
    | Annotated[MeshFile, Tag("mesh-file")],
    by_kind(PoreGeometry, DEFAULT),
]
