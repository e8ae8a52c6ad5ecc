"""Motion of the pore wall with the parameters, and the explicit slopes of a member's solid.

A node stays on the surfaces of the wall on which it lies: one on a face, two on a ridge, three in a corner. Nodes on
mirror planes and cell faces stay there. First the nodes without freedom move; those along a curve follow their
neighbours by linear interpolation, which is a linear map, and are then projected onto their surfaces; those on a face
follow in the same way. The directions of projection are the normals of the base, so the place of a node is a smooth
function of the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from porocore.cell.contact.wall_contact import elements_at_wall
from porocore.cell.equilibrium.discrete import DiscreteSolid
from porocore.cell.equilibrium.slopes import ExplicitDependence
from porocore.cell.geometry.pore_geometry import Plane, Round, Values, WallSurface
from porocore.cell.materials.material import SWELLING, bulk_and_shear
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.tetrahedra import with_middles
from porocore.core.files.yaml_document import Location
from porocore.errors import MemberError
from porocore.states import Array, BoolArray, IntArray

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.cell.conductivity.pore import Pore
    from porocore.cell.family.family import CellParameter
    from porocore.cell.materials.material import Material


#: Distance from a surface within which a node of the base lies on it; drawn ridges are exact to some 1e-8.
ON = 1e-6
#: Sine of the angle between a surface's normal and the other constraints of a node up to which it follows from them.
APART = 0.02
STEPS = 30
#: Tolerance of a node on its surfaces.
ACCURACY = 1e-13
#: Tolerance of a surface through a node that its other constraints should hold.
TOGETHER = 1e-9
#: Distance of a body from the wall up to which it may come to cover it.
NEAR = 0.2
#: Imaginary part of a number by whose complex step derivatives are taken.
TINY = 1e-40
LOST = "nodes of the pore wall find no place on it"


class _Pairs:
    """Nodes with the surfaces on which they stay.

    Parameters
    ----------
    node, slot, surface : (m,)
        Node, place among its constraints, and surface.
    offset : (m,)
        Value that the surface's function keeps.
    """

    def __init__(self, node: IntArray, slot: IntArray, surface: IntArray, offset: Array) -> None:
        self.node, self.slot, self.surface, self.offset = node, slot, surface, offset
        self.nodes, self.row = np.unique(node, return_inverse=True)
        self._groups = [(int(i), np.flatnonzero(surface == i)) for i in np.unique(surface)]

    def of(self, chosen: BoolArray) -> _Pairs:
        """Return the chosen pairs (m,)."""
        return _Pairs(self.node[chosen], self.slot[chosen], self.surface[chosen], self.offset[chosen])

    def values(self, places: Array, surfaces: Sequence[WallSurface]) -> Values:
        """Return the values (m,) of the surfaces for nodes at places (n, 3), less the offsets; complex ones too."""
        found = np.zeros(len(self.node), dtype=np.complex128)
        for i, rows in self._groups:
            found[rows] = surfaces[i].value(places[self.node[rows]])
        return found - self.offset

    def gradients(self, places: Array, surfaces: Sequence[WallSurface]) -> Array:
        """Return the gradients (m, 3) of the surfaces for nodes at places (n, 3)."""
        found = np.zeros((len(self.node), 3))
        for i, rows in self._groups:
            found[rows] = surfaces[i].gradient(places[self.node[rows]])
        return found


class WallMotion:
    """Motion of wall nodes; set up once from their places at the base.

    Parameters
    ----------
    points : (n, 3)
        Nodes of the base, one of each set of periodic images.
    held : (n, 3)
        True for components that stay.
    edges : (e, 2)
        Pairs of neighbours on the wall.
    surfaces
        Surfaces of the base.
    """

    def __init__(
        self, points: Array, held: BoolArray, edges: IntArray, surfaces: Sequence[WallSurface]
    ) -> None:
        self.points, self.held = points, held
        count = len(points)
        on, nearest = lies_on(points, surfaces)
        node, surface = np.nonzero(on)
        offset = np.where(np.abs(nearest[node]) > ON, nearest[node], 0.0)
        normals = np.zeros((len(node), 3))
        for i in np.unique(surface):
            normals[surface == i] = surfaces[i].gradient(points[node[surface == i]])
        #: Directions in which a node is projected, (n, 3 of them, 3); 0 where there are fewer.
        self._directions = np.zeros((count, 3, 3))
        slot = self._independent(node, normals)
        pairs = _Pairs(node, slot, surface, offset)
        self._others = pairs.of(slot < 0)
        freedom = 3 - held.sum(axis=1) - np.bincount(node[slot >= 0], minlength=count)
        constraints = np.concatenate([on, held], axis=1)
        self._levels = [_Level(points, edges, freedom, constraints, level) for level in range(3)]
        self._pairs_of = [pairs.of((slot >= 0) & (freedom[node] == level)) for level in range(3)]
        #: Bodies that may come to cover a node, and how deep one may lie in them: ridges may be cut off in an element.
        self._bodies = [
            i for i, s in enumerate(surfaces) if isinstance(s, Round) and s.value(points).min() < NEAR
        ]
        ends = points[edges]
        self._deep = float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))) / 2

    def _independent(self, node: IntArray, normals: Array) -> IntArray:
        """Choose the constraints of each node that do not follow from the others; return their slots, −1 for others."""
        slot = np.full(len(node), -1)
        filled = np.zeros(len(self.points), dtype=np.int64)
        bases = np.zeros((len(self.points), 3, 3))
        place = np.arange(len(node)) - np.searchsorted(
            node, node
        )  # among the pairs of a node, which are in a row
        for k in range(int(place.max(initial=-1)) + 1):
            pairs = np.flatnonzero(place == k)
            n, normal = node[pairs], normals[pairs]
            within = np.where(self.held[n], 0.0, normal)
            rest = within - np.einsum("kji,kjl,kl->ki", bases[n], bases[n], within)
            length = np.linalg.norm(rest, axis=1)
            new = (length > APART * np.linalg.norm(normal, axis=1)) & (filled[n] < 3)
            pairs, n, at = pairs[new], n[new], filled[n[new]]
            slot[pairs] = at
            bases[n, at] = rest[new] / length[new, None]
            self._directions[n, at] = within[new] / np.linalg.norm(within[new], axis=1, keepdims=True)
            filled[n] += 1
        return slot

    def moved(self, surfaces: Sequence[WallSurface]) -> Array:
        """Return the places (n, 3) of the nodes on the surfaces of a member.

        Raises
        ------
        MemberError
            A node finds no place on its surfaces.
        """
        step = np.zeros_like(self.points)
        for level, pairs in zip(self._levels, self._pairs_of, strict=True):
            if len(level.nodes):
                step[level.nodes] = np.where(self.held[level.nodes], 0.0, level.follow(step))
                self._project(step, pairs, surfaces)
        places = self.points + step
        self._check(places, surfaces)
        return places

    def _project(self, step: Array, pairs: _Pairs, surfaces: Sequence[WallSurface]) -> None:
        """Add to the steps of the nodes what brings them onto their surfaces."""
        nodes = pairs.nodes
        least, best = np.inf, step[nodes]
        for _ in range(STEPS):
            places = self.points + step
            values = pairs.values(places, surfaces).real
            error = float(np.abs(values).max(initial=0.0))
            if not np.isfinite(error) or (error >= least and error <= ACCURACY):
                break
            if error < least:
                least, best = error, step[nodes]
            step[nodes] -= self._solved(pairs, pairs.gradients(places, surfaces), values)
        step[nodes] = best
        if not least <= ACCURACY:
            raise MemberError(LOST)

    def _solved(self, pairs: _Pairs, gradients: Array, values: Array) -> Array:
        """Return the steps (k, 3) of nodes along their directions that change the surfaces' functions by values."""
        nodes, row, slot = pairs.nodes, pairs.row, pairs.slot
        directions = self._directions[nodes]
        matrix = np.tile(np.eye(3), (len(nodes), 1, 1))
        matrix[row, slot] = np.einsum("mi,mji->mj", gradients, directions[row])
        right = np.zeros((len(nodes), 3, 1))
        right[row, slot, 0] = values
        try:
            share = np.linalg.solve(matrix, right)[:, :, 0]
        except np.linalg.LinAlgError as error:
            raise MemberError(LOST) from error
        return np.asarray(np.einsum("kj,kji->ki", share, directions))

    def _check(self, places: Array, surfaces: Sequence[WallSurface]) -> None:
        """Refuse places that left a surface which met others there at the base, or that lie within another body."""
        values = self._others.values(places, surfaces).real
        if np.abs(values).max(initial=0.0) > TOGETHER:
            raise MemberError("surfaces of the pore wall that meet in one place no longer do")
        bodies = (surfaces[i] for i in self._bodies)
        if any(body.covers(places, self._deep).any() for body in bodies if isinstance(body, Round)):
            raise MemberError("a part of the pore wall comes to lie within another pore, or another obstacle")

    def velocity(
        self, places: Array, surfaces: Sequence[WallSurface], varied: Sequence[WallSurface]
    ) -> Array:
        """Return the derivative (n, 3) of the places by a number.

        Parameters
        ----------
        places : (n, 3)
            Places of a member.
        surfaces
            Its surfaces.
        varied
            Its surfaces with the imaginary part ``TINY`` of the number.
        """
        speed = np.zeros_like(places)
        for level, pairs in zip(self._levels, self._pairs_of, strict=True):
            if not len(level.nodes):
                continue
            speed[level.nodes] = np.where(self.held[level.nodes], 0.0, level.follow(speed))
            change = pairs.values(places, varied).imag / TINY
            gradients = pairs.gradients(places, surfaces)
            change += (gradients * speed[pairs.node]).sum(axis=1)
            speed[pairs.nodes] -= self._solved(pairs, gradients, change)
        return speed


def lies_on(points: Array, surfaces: Sequence[WallSurface]) -> tuple[BoolArray, Array]:
    """Return on which surfaces points (n, 3) lie, (n, s), at least the nearest one, and the value (n,) of that."""
    on = np.zeros((len(points), len(surfaces)), dtype=bool)
    nearest, which = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    for i, surface in enumerate(surfaces):
        if isinstance(surface, Plane):
            on[:, i] = np.all([np.abs(other.value(points)) <= ON for other in surface.between], axis=0)
            continue
        value = surface.value(points)
        on[:, i] = np.abs(value) <= ON
        closer = np.abs(value) < np.abs(nearest)
        nearest[closer], which[closer] = value[closer], i
    on[np.arange(len(points)), which] = True
    return on, nearest


class _Level:
    """Nodes of one freedom: in corners (0), along curves (1) or on faces (2); they follow those of less freedom."""

    def __init__(
        self,
        points: Array,
        edges: IntArray,
        freedom: IntArray,
        constraints: BoolArray,
        level: int,
    ) -> None:
        self.nodes = np.flatnonzero(freedom == level)
        both = np.concatenate([edges, edges[:, ::-1]])
        a, b = both.T
        # Along a curve the neighbours are those that have its constraints too.
        along = (freedom[a] == level) & (freedom[b] <= level) & (level > 0)
        if level == 1:
            along &= (~constraints[a] | constraints[b]).all(axis=1)
        a, b = a[along], b[along]
        weight = 1 / np.linalg.norm(points[a] - points[b], axis=1)
        count = len(points)
        free = self._reached(a, b, freedom == level, count)
        matrix = csr_matrix(coo_matrix((weight, (a, b)), (count, count)))[free]
        total = np.asarray(matrix.sum(axis=1)).ravel()
        self._free = np.searchsorted(self.nodes, free)
        self._coupling = matrix.copy()
        if len(free):
            square = (coo_matrix((total, (range(len(free)),) * 2)) - matrix[:, free]).tocsc()
            self._factor = splu(square)

    def _reached(self, a: IntArray, b: IntArray, own: BoolArray, count: int) -> IntArray:
        """Return the nodes of this level from which a way along it leads to a node of less freedom."""
        within = own[a] & own[b]
        graph = coo_matrix((np.ones(within.sum()), (a[within], b[within])), (count, count))
        piece = connected_components(graph, directed=False)[1]
        return np.flatnonzero(own & np.isin(piece, piece[a[own[a] & ~own[b]]]))

    def follow(self, steps: Array) -> Array:
        """Return the steps of this level's nodes that interpolate those (n, 3) of nodes of less freedom."""
        found = np.zeros((len(self.nodes), 3))
        if len(self._free):
            known = steps.copy()
            known[self.nodes] = 0.0
            found[self._free] = self._factor.solve(self._coupling @ known)
        return found


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
    bulk, shear = bulk_and_shear(slope)
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
