"""Solid of several materials, one for each region (Composite), placed on the elements of a mesh."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from porocore.cell.materials.energy import StrainEnergy
from porocore.cell.materials.material import Material
from porocore.core.echo import suggestion
from porocore.core.files.yaml_document import Location
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh


@dataclass(frozen=True)
class Composite:
    """Materials of ``cell.materials`` by the names of their regions."""

    materials: Mapping[str, Material]

    @property
    def isotropic(self) -> bool:
        """True where every material is isotropic."""
        return all(material.isotropic for material in self.materials.values())

    @property
    def mirrored(self) -> bool:
        """True where every material is invariant under the mirrors of the three axes."""
        return all(material.mirrored for material in self.materials.values())

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether a signed permutation Q (3, 3) of the axes leaves the response of the solid unchanged.

        The ``regions`` are mapped as :meth:`~porocore.cell.geometry.pore_geometry.PoreGeometry.regions_after` says.
        """
        if regions is None:
            return False
        for region, material in self.materials.items():
            image, turned = self.materials.get(regions.get(region, region)), material.turned(Q)
            if image is None or turned is None or not turned.equals(image):
                return False
        return True

    @property
    def swells(self) -> bool:
        """True where a material is swollen."""
        return any(material.swells for material in self.materials.values())

    @property
    def description(self) -> str:
        """Short description of the materials by region."""
        return "; ".join(f"{region}: {material.description}" for region, material in self.materials.items())

    @property
    def identity(self) -> str:
        """Materials by region, as text."""
        return json.dumps({region: m.identity for region, m in self.materials.items()}, sort_keys=True)

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Return the strain energy of every element of a mesh of the solid.

        Raises
        ------
        ConfigurationError
            A region has no material, or a material no region.
        """
        for region in self.materials:
            if region not in mesh.region_names:
                advice = suggestion(region, mesh.region_names, "its regions are", "it has no regions")
                raise ConfigurationError(
                    f"cell.materials.{region}: the solid has no region of this name; {advice}"
                )
        if lacking := [region for region in mesh.region_names if region not in self.materials]:
            raise ConfigurationError(
                f"cell.materials: expected a material for each region of the solid, got none for {', '.join(lacking)}; "
                f"add '{lacking[0]}:' below it"
            )
        parts = (
            (region, self.materials[region].on(mesh), np.flatnonzero(mesh.regions == k))
            for k, region in enumerate(mesh.region_names)
        )
        return PlacedMaterials(tuple(part for part in parts if len(part[2])))


@dataclass(frozen=True, eq=False)
class PlacedMaterials(StrainEnergy):
    """Solids on the elements of a mesh, each with its region and its elements; every element has one solid."""

    parts: tuple[tuple[str, StrainEnergy, IntArray], ...]

    @property
    def isotropic(self) -> bool:
        """True where every material is isotropic."""
        return all(material.isotropic for _, material, _ in self.parts)

    def energy_density(self, F: Array) -> Array:
        return self._gathered(F, (), lambda material: material.energy_density)

    def stress(self, F: Array) -> Array:
        return self._gathered(F, (3, 3), lambda material: material.stress)

    def tangent(self, F: Array) -> Array:
        return self._gathered(F, (3, 3, 3, 3), lambda material: material.tangent)

    def _gathered(
        self, F: Array, shape: tuple[int, ...], function: Callable[[StrainEnergy], Callable[[Array], Array]]
    ) -> Array:
        out = np.empty((*F.shape[:-2], *shape))
        for _, material, elements in self.parts:
            out[elements] = function(material)(F[elements])
        return out

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; all elements have the same weight."""
        young = shear = count = 0.0
        for _, material, own in self.parts:
            n = len(own) if elements is None else int(np.isin(own, elements).sum())
            E, G = material.mean_moduli()
            young, shear, count = young + n * E, shear + n * G, count + n
        return young / count, shear / count

    @property
    def mean_stretch(self) -> float:
        """Mean of λ over the elements, all of the same weight."""
        counts = [len(elements) for _, _, elements in self.parts]
        return float(np.average([material.mean_stretch for _, material, _ in self.parts], weights=counts))

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return the slopes by a number of one region, the first of the keys; they are 0 in the others."""
        by_energy, by_stress = np.zeros(F.shape[:-2]), np.zeros(F.shape)
        for region, material, elements in self.parts:
            if region == key[0]:
                by_energy[elements], by_stress[elements] = material.parameter_slopes(key[1:], F[elements])
        return by_energy, by_stress


#: Solid of a cell: one material, or one for each region.
Solid = Material | Composite
