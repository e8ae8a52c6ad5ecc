"""Configuration of a cell: pore geometry, materials, viscosity, mesh, contact; its symmetry and identity."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationError,
    model_serializer,
    model_validator,
)

from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.family.family import Family, fault
from porocore.cell.family.mesh import member_mesh, member_velocity
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.drawn import CylinderArray, NoPores, SphereArray
from porocore.cell.geometry.pore_geometry import PoreGeometry, require_few
from porocore.cell.geometry.spheres import SpherePores
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.materials.hyperelastic import AnyMaterial, Composite, NeoHookean, Solid
from porocore.cell.materials.material import SWELLING
from porocore.cell.materials.prony import RELAXATION, Relaxation
from porocore.cell.meshing.connectivity import pieces, why_disconnected
from porocore.cell.meshing.mesh import CellMesh, Domain, MeshSettings, block, make_mesh, tiled
from porocore.cell.meshing.mesh_file import MeshFile
from porocore.cell.meshing.tetrahedra import Phase, porosity
from porocore.core.files.plain_data import json_hash
from porocore.core.models.name import Name
from porocore.core.models.strict import CalledByUsers, by_kind, copied
from porocore.core.tensors import PointGroup
from porocore.core.units import Dimension, Unit
from porocore.errors import ConfigurationError
from porocore.states import Array

Geometry = Annotated[
    Annotated[OrthogonalChannels, Tag("orthogonal-channels")]
    | Annotated[SphereArray, Tag("sphere-array")]
    | Annotated[CylinderArray, Tag("cylinder-array")]
    | Annotated[NoPores, Tag("no-pores")]
    | Annotated[SpherePores, Tag("sphere-pores")]
    | Annotated[TriplyPeriodic, Tag("tpms")]
    | Annotated[Voxels, Tag("voxels")]
    | Annotated[MeshFile, Tag("mesh-file")],
    by_kind(PoreGeometry, "orthogonal-channels"),
]
Cells = Annotated[int, Field(ge=1, le=8)]
#: Name of a region; a number is the name of a tag.
Region = Annotated[Name, BeforeValidator(lambda name: str(name) if isinstance(name, int) else name)]


class Cell(Family, metaclass=CalledByUsers):
    """Configuration of a cell: all that determines its cell problems.

    A number of the pores' shape, of a material or the viscosity may be ``{"range": [lower, upper]}``. It is then one
    of the :attr:`parameters` of a family of cells, and :meth:`at` returns a member of it.

    Examples
    --------
    >>> from porocore import Cell
    >>> family = Cell(material={"poisson_ratio": {"range": [0.2, 0.4]}})
    >>> [parameter.name for parameter in family.parameters]
    ['poisson_ratio']
    >>> family.at({"poisson_ratio": 0.25}).material.poisson_ratio
    0.25
    """

    geometry: Geometry = OrthogonalChannels()
    """Shape of the pores."""
    material: AnyMaterial | None = None
    """Strain energy of the solid; neo-Hookean where neither this nor ``materials`` is given."""
    materials: Annotated[dict[Region, AnyMaterial], Field(min_length=1)] | None = None
    """Instead of ``material``, one for each region of the solid by its name."""
    viscosity: Annotated[float, Field(gt=0), Dimension("viscosity")] = 1e-3
    """μ_f of the pore fluid; the conductivity K is proportional to its inverse. With scales there is no default."""
    mesh: MeshSettings = MeshSettings()
    """How finely the cell is meshed, and with which elements."""
    contact: ContactSettings = ContactSettings()
    """What happens where the pore wall meets itself."""
    symmetry: Literal["auto", "none"] = "auto"
    """``auto``: an eighth of the cell where geometry and load allow it; ``none``: always the whole cell."""
    supercell: Annotated[tuple[Cells, Cells, Cells], Unit("cells")] = (1, 1, 1)
    """Whole cells along each axis that are solved as one periodic domain; more than one leaves the mirrors out."""

    @model_validator(mode="before")
    @classmethod
    def _default_material(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("material") is None and data.get("materials") is None:
            return {**data, "material": NeoHookean()}
        return data

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        if self.material is not None and self.materials is not None:
            raise ValueError("expected either material or materials, got both; keep the one that is meant")
        return self

    @model_validator(mode="after")
    def _relaxes_alike(self) -> Self:
        if self.materials is None:
            return self
        (first, one), *others = self.materials.items()
        for region, material in others:
            if material.relaxation != one.relaxation:
                why = (
                    f"expected the relaxation of the region '{first}', since the average of regions that relax "
                    "differently is no Prony series; give all materials of a cell the same branches, or none"
                )
                at = ("materials", region, RELAXATION)
                raise ValidationError.from_exception_data("Cell", [fault(at, why, material.relaxation)])
        return self

    @model_validator(mode="after")
    def _few(self) -> Self:
        mesh, cells = self.mesh, math.prod(self.supercell)
        for name, size, count in (("size", mesh.size, cells), ("fluid_size", mesh.fluid_size, 1)):
            try:
                require_few(count * self.geometry.elements(size), f"mesh.{name}")
            except ConfigurationError as error:
                raise ValueError(str(error)) from None
        return self

    @model_serializer(mode="wrap")
    def _only_what_is_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        data.pop("materials" if self.materials is None else "material", None)
        return self._with_ranges(data)

    @property
    def solid(self) -> Solid:
        """Material of the solid, or one for each of its regions."""
        if self.materials is not None:
            return Composite(self.materials)
        assert self.material is not None
        return self.material

    @property
    def relaxation(self) -> Relaxation | None:
        """Relaxation of the whole solid; None: it is elastic."""
        materials = [self.material] if self.materials is None else [*self.materials.values()]
        return None if materials[0] is None else materials[0].relaxation

    @property
    def in_equilibrium(self) -> Self:
        """The cell as cell problems see it, without the relaxation of its solid; itself where it is elastic."""
        if self.relaxation is None:
            return self
        if self.materials is not None:
            solids = {region: one.in_equilibrium for region, one in self.materials.items()}
            return copied(self, materials=solids)
        assert self.material is not None
        return copied(self, material=self.material.in_equilibrium)

    @property
    def modulus(self) -> float:
        """Young's modulus of the stiffest solid in it, averaged over directions [E]."""
        materials = [self.material] if self.materials is None else self.materials.values()
        return max(material.mean_moduli()[0] for material in materials if material is not None)

    @property
    def before_swelling(self) -> Self:
        """The cell with a swelling stretch of 1 in all of its solid."""
        if self.materials is not None:
            dry = {region: one.model_copy(update={SWELLING: 1.0}) for region, one in self.materials.items()}
            return self.model_copy(update={"materials": dry})
        assert self.material is not None
        return self.model_copy(update={"material": self.material.model_copy(update={SWELLING: 1.0})})

    @property
    def unstressed(self) -> Self:
        """The cell at rest without stress: before its whole solid swells, with the stretch no parameter any more.

        Itself where its regions have stretches of their own, since no state of it is without stress.
        """
        if self.materials is not None:
            return self
        stretch = [each.name for each in self.parameters if each.path == ("material", SWELLING)]
        return self.before_swelling.fixed(stretch)

    @property
    def symmetric(self) -> bool:
        """True where the mirrors of the pores are used; the flow is then solved on the eighth."""
        return self.symmetry == "auto" and self._generic.geometry.unfolding != "whole"

    @property
    def mirrored(self) -> bool:
        """True where states without shear are solved on the eighth."""
        return self.symmetric and self._generic.solid.mirrored and self.supercell == (1, 1, 1)

    @cached_property
    def point_group(self) -> PointGroup:
        """Point group of the cell: of its pores, its material and its block of cells.

        It is exact for the description; a free mesh breaks some of its operations by the discretisation error. That of
        a family is the group of all its members.
        """
        if self.is_family:
            return self._generic.point_group
        counts = np.array(self.supercell)
        return self.geometry.point_group.kept(
            lambda Q: (
                bool((np.abs(Q) @ counts == counts).all())
                and self.solid.allows(Q, self.geometry.regions_after(Q))
            )
        )

    @property
    def disconnected(self) -> str:
        """Reason why the solid is not connected across the periodic cell, so has no stiffness; empty if it is.

        Raises
        ------
        PorocoreError
            A mesh is needed, and the geometry cannot be meshed.
        """
        known = self.geometry.disconnected
        if known is None:
            return why_disconnected(pieces(make_mesh(self.geometry, self.mesh, "solid", "whole")))
        return known

    @property
    def mesh_porosity(self) -> float:
        """Porosity φ_f of the mesh of the solid, to which the responses belong; see also ``geometry.porosity``.

        Raises
        ------
        PorocoreError
            The geometry cannot be meshed.
        """
        solid = self._mesh_of_one("solid", "whole")
        return porosity(solid.points, solid.cells, "solid")

    def require_pores(self) -> None:
        """Refuse a cell that is solid throughout.

        Raises
        ------
        ConfigurationError
            It has no pores.
        """
        if self.geometry.porosity == 0:
            raise ConfigurationError(
                "cell.geometry: the cell has no pores, so there is nothing to homogenise"
            )

    def require_stiffness(self) -> None:
        """Refuse a cell whose solid cannot be solved.

        Raises
        ------
        ConfigurationError
            The solid is not connected across the periodic cell.
        """
        if disconnected := self.disconnected:
            raise ConfigurationError(
                f"cell.geometry: the solid of {self.geometry.description} is not connected across the periodic cell, "
                f"so it has no stiffness and only its conductivity can be computed: {disconnected}"
                + "".join(f"; {told}" for told in self.geometry.value_warnings)
            )

    def specification(self) -> dict[str, Any]:
        """Return all that the cell problems depend on, so not the relaxation; of a file its content, not its path.

        That of a member has its own numbers, and the base values from which its mesh was moved.
        """
        found = {**self.in_equilibrium.model_dump(mode="json"), "geometry": self.geometry.specification()}
        return {**self._with_ranges(found), **({"moved_from": self.moved_from} if self.moved_from else {})}

    @property
    def identity(self) -> str:
        """Hash of the specification."""
        return json_hash(self.specification())

    def make_mesh(self, phase: Phase, domain: Domain) -> CellMesh:
        """Return the mesh of one phase on the eighth or on the whole cell, the same for every backend.

        The whole solid is that of the supercell; the fluid is that of one cell. The mesh of a member is that of its
        family's base, moved.

        Raises
        ------
        PorocoreError
            The geometry cannot be meshed, or its mesh cannot be moved so far.
        """
        mesh = self._mesh_of_one(phase, domain)
        return block(mesh, self.supercell) if self._several(phase, domain) else mesh

    def mesh_velocity(self, phase: Phase, domain: Domain) -> Array:
        """Return the derivative of the places of the nodes of :meth:`make_mesh` by each parameter, (m, nodes, 3).

        It is 0 for parameters of materials and of the fluid.

        Raises
        ------
        PorocoreError
            As of :meth:`make_mesh`.
        """
        mesh = self._mesh_of_one(phase, domain)
        several = self._several(phase, domain)
        nodes = len(block(mesh, self.supercell).points if several else mesh.points)
        found = np.zeros((len(self.parameters), nodes, 3))
        for k, parameter in enumerate(self.parameters):
            if parameter.shape:
                base = self.base_section("geometry")
                speed = member_velocity(base, self.mesh, phase, domain, self.geometry, parameter.path[1:])
                found[k] = tiled(mesh, speed, self.supercell) if several else speed
        return found

    def _several(self, phase: Phase, domain: Domain) -> bool:
        """Return whether a mesh is that of several cells."""
        return phase == "solid" and domain == "whole" and self.supercell != (1, 1, 1)

    def _mesh_of_one(self, phase: Phase, domain: Domain) -> CellMesh:
        if not self.moved_from:
            return make_mesh(self.geometry, self.mesh, phase, domain)
        return member_mesh(self.base_section("geometry"), self.mesh, phase, domain, self.geometry)
