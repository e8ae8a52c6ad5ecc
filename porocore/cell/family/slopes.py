"""Explicit dependence of the solid of a member on its parameters, and slopes as fields of a response."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from porocore.cell.contact.model import elements_at_wall
from porocore.cell.equilibrium.discrete import DiscreteSolid
from porocore.cell.equilibrium.solid_slopes import ExplicitDependence, SolidSlopes
from porocore.cell.materials.energy import SWELLING
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.tetrahedra import with_middles
from porocore.core.files.yaml_document import Location
from porocore.states import Array, CellSlopes, IntArray

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.cell.conductivity.pore import Pore
    from porocore.cell.family.parameters import CellParameter
    from porocore.cell.materials.material import Material

#: Step of the differences that give the slope of the elasticity from that of the stress, which is smooth at F = I.
STEP = 2e-3
#: Places and weights of a central difference of sixth order.
PLACES = np.array([-3, -2, -1, 1, 2, 3])
WEIGHTS = np.array([-1, 9, -45, 45, -9, 1]) / 60


def explicit_dependences(cell: Cell, solid: DiscreteSolid) -> list[ExplicitDependence]:
    """Return the explicit dependence of the solid of a member on each parameter."""
    if not cell.parameters:
        return []
    velocities = cell.mesh_velocity("solid", solid.mesh.domain)
    return [
        ExplicitDependence(velocity=V) if parameter.shape else _of_material(cell, solid, parameter)
        for parameter, V in zip(cell.parameters, velocities, strict=True)
    ]


def _of_material(cell: Cell, solid: DiscreteSolid, parameter: CellParameter) -> ExplicitDependence:
    key = parameter.solid_key
    if key is None:  # the viscosity
        return ExplicitDependence()
    slopes = partial(solid.material.parameter_slopes, key)
    if key[-1] == SWELLING:  # which leaves the elastic moduli as they are
        return ExplicitDependence(material=slopes)
    everywhere, mesh = np.zeros((len(solid.mesh.cells), 1, 3, 3, 3, 3)), solid.mesh
    if parameter.region is None:
        material, elements = cell.material, np.arange(len(mesh.cells))
    else:
        material = (cell.materials or {})[parameter.region]
        elements = np.flatnonzero(mesh.regions == mesh.region_names.index(parameter.region))
        key = key[1:]
    assert material is not None
    everywhere[elements] = at_rest = elasticity_slope(material, key)
    penalty = _log_penalty(solid, material, at_rest, elements)
    return ExplicitDependence(material=slopes, elasticity=everywhere, log_penalty=penalty)


def elasticity_slope(material: Material, key: Location) -> Array:
    """Return the slope (3, 3, 3, 3) of a material's elasticity at F = I by one of its numbers."""
    directions = np.eye(9).reshape(9, 1, 3, 3)
    F = np.eye(3) + STEP * PLACES[:, None, None] * directions
    stress = material.parameter_slopes(key, F)[1]
    return np.asarray(np.einsum("s,ksij->ijk", WEIGHTS, stress).reshape(3, 3, 3, 3) / STEP)


def _log_penalty(solid: DiscreteSolid, material: Material, slope: Array, elements: IntArray) -> float:
    """Return the slope of the logarithm of Young's modulus, averaged over directions and the elements at the wall."""
    wall = elements_at_wall(solid.mesh)
    if not len(wall):
        return 0.0
    E, G = material.mean_moduli()
    K = G * E / (3 * (3 * G - E))
    bulk = float(np.einsum("iijj->", slope)) / 9
    shear = (3 * float(np.einsum("ijij->", slope)) - 9 * bulk) / 30
    own = 9 * (G**2 * bulk + 3 * K**2 * shear) / (3 * K + G) ** 2
    share = float(np.isin(wall, elements).mean())
    return share * own / solid.material.mean_moduli(wall)[0]


def base_meshes(cell: Cell, domain: Domain) -> tuple[CellMesh, CellMesh] | None:
    """Return the meshes of solid and fluid of which those of a member are moved ones; None where no mesh moves."""
    if not any(parameter.shape for parameter in cell.parameters):
        return None
    base = cell.at([parameter.base for parameter in cell.parameters])
    return base.make_mesh("solid", domain), base.make_mesh("fluid", domain).quadratic


def fluid_velocities(cell: Cell, domain: Domain) -> Array:
    """Return the velocities (m, nodes, 3) of the nodes of the fluid's quadratic mesh by each parameter."""
    mesh, velocities = cell.make_mesh("fluid", domain), cell.mesh_velocity("fluid", domain)
    if mesh.order == 2:
        return velocities
    return np.stack([with_middles(V, mesh.cells)[0] for V in velocities])


def conductivity_with_slopes(cell: Cell, pore: Pore) -> tuple[Array, Array]:
    """Return K (3, 3) of the undeformed pore of a member, and its slopes (3, 3, m) by the parameters."""
    shapes = [k for k, parameter in enumerate(cell.parameters) if parameter.shape]
    slopes = np.zeros((3, 3, len(cell.parameters)))
    if shapes:
        velocities = fluid_velocities(cell, pore.fluid.mesh.domain)[shapes]
        K, slopes[:, :, shapes] = pore.undeformed_slopes(velocities)
    else:
        K = pore.undeformed
    return K / cell.viscosity, with_viscosity(cell, K, slopes)


def with_viscosity(cell: Cell, K: Array, slopes: Array) -> Array:
    """Return the slopes of K/μ_f (3, 3, m) from K and its slopes at unit viscosity."""
    slopes = slopes / cell.viscosity
    for k, parameter in enumerate(cell.parameters):
        if parameter.path == ("viscosity",):
            slopes[:, :, k] -= K / cell.viscosity**2
    return slopes


def response_slopes(slopes: SolidSlopes, conductivity: Array) -> CellSlopes:
    """Return the slopes of one row; those of the conductivity are (3, 3, m)."""
    return CellSlopes(
        potential=slopes.potential[None],
        stress=slopes.stress[None],
        fluid_volume=slopes.fluid_volume[None],
        porosity=slopes.porosity[None],
        mean_grad=slopes.mean_grad[None],
        conductivity=conductivity[None],
    )
