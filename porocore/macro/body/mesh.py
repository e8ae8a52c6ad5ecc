"""Mesh of a body (BodyMesh): nodes, Jacobians, facets of a named surface, deformation, checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from porocore.core.echo import did_you_mean, joined
from porocore.errors import ConfigurationError
from porocore.macro.body.element import ELEMENTS, ReferenceElement
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """Isoparametric elements that carry the displacement at all their nodes and the pressure at their corners.

    Unknowns are numbered displacements first, 3 · node + component, then the pressures. Every backend reports in
    this order of nodes, elements and quadrature points.

    Attributes
    ----------
    points : (nodes, 3)
        Nodes of the displacement, X.
    cells : (elements, 27 or 10)
        Nodes of each element in VTK's order, triquadratic hexahedra or quadratic tetrahedra.
    surfaces
        Outward facets (facets, 9 or 6) of each named part of the surface, by their nodes.
    volumes
        Elements (k,) of each named volume.
    unusable
        Why nothing can be prescribed on a surface that a file names.
    unusable_volumes
        Why a volume that a file names cannot be a region.
    """

    points: Array
    cells: IntArray
    surfaces: Mapping[str, IntArray] = field(default_factory=dict)
    volumes: Mapping[str, IntArray] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)
    unusable_volumes: Mapping[str, str] = field(default_factory=dict)

    @property
    def element(self) -> ReferenceElement:
        """Reference element of the mesh."""
        return ELEMENTS[self.cells.shape[1]]

    @cached_property
    def p_nodes(self) -> IntArray:
        """(p_nodes,) which nodes are corners and carry a pressure, ascending."""
        return np.asarray(np.unique(self.cells[:, : self.element.corners]))

    @cached_property
    def p_cells(self) -> IntArray:
        """(elements, 8 or 4) places in ``p_nodes`` of the corners of each element."""
        return np.asarray(np.searchsorted(self.p_nodes, self.cells[:, : self.element.corners]))

    @property
    def n_u(self) -> int:
        """Number of displacement unknowns."""
        return 3 * len(self.points)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_u + len(self.p_nodes)

    @cached_property
    def straight(self) -> bool:
        """True if the elements are the images of their corners, without curved edges."""
        corners = self.points[self.cells[:, : self.element.corners]]
        placed = np.einsum(
            "na,eai->eni", self.element.corner_values(self.element.nodes), corners, optimize=True
        )
        return bool(np.abs(placed - self.points[self.cells]).max() < 1e-12 * np.ptp(self.points))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def node_at(self, places: Array) -> IntArray:
        """(n,) numbers of the nodes at, or nearest to, ``places`` (n, 3)."""
        return np.asarray(self._tree.query(places)[1], dtype=np.int64)

    @cached_property
    def jacobians(self) -> Array:
        """(elements, q, 3, 3) ∂X_i/∂ξ_j at the quadrature points."""
        gradients = self.element.gradients(self.element.points)
        return np.asarray(np.einsum("eai,qaj->eqij", self.points[self.cells], gradients, optimize=True))

    @cached_property
    def weights(self) -> Array:
        """(elements, q) volume of each quadrature point."""
        return np.asarray(np.linalg.det(self.jacobians) * self.element.weights)

    @cached_property
    def quadrature_points(self) -> Array:
        """(elements, q, 3) places of the quadrature points."""
        return np.asarray(self.element.values(self.element.points) @ self.points[self.cells])

    @cached_property
    def centres(self) -> Array:
        """(elements, 3) centres of volume."""
        shares = self.weights / self.weights.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum("eq,eqi->ei", shares, self.quadrature_points))

    @cached_property
    def stretch(self) -> float:
        """Largest ∫ Σ_j |∂N/∂X_j| dX over the body of a displacement node's shape function N."""
        gradients = self.element.gradients(self.element.points)
        grad = np.einsum("qak,eqkj->eqaj", gradients, np.linalg.inv(self.jacobians), optimize=True)
        local = np.einsum("eq,eqaj->ea", self.weights, np.abs(grad))
        return float(np.bincount(self.cells.ravel(), local.ravel()).max())

    @cached_property
    def share_of_volume(self) -> float:
        """Largest ∫ N dX over the body of a pressure node's shape function N."""
        local = self.weights @ self.element.corner_values(self.element.points)
        return float(np.bincount(self.p_cells.ravel(), local.ravel()).max())

    def pressure_everywhere(self, p: Array) -> Array:
        """(nodes,) the linear pressure at all nodes, from its values (p_nodes,) at the corners."""
        everywhere = np.empty(len(self.points))
        everywhere[self.cells] = p[self.p_cells] @ self.element.corner_values(self.element.nodes).T
        return everywhere

    @cached_property
    def unnamed(self) -> int:
        """Number of facets of the boundary that belong to no named surface."""
        named = [self.corners_of(facets) for facets in self.surfaces.values()]
        return len(boundary_facets(self.cells)) - len(set[tuple[int, ...]]().union(*named))

    def corners_of(self, facets: IntArray) -> list[tuple[int, ...]]:
        """Return the corners of facets (k, m) in ascending order, by which they are known."""
        corners = np.sort(facets[:, : self.element.facet_corners], axis=1)
        return [tuple(key) for key in corners.tolist()]

    def surface(self, name: str, key: str) -> IntArray:
        """Facets of a named part.

        Raises
        ------
        ConfigurationError
            There is none of that name, or nothing can be prescribed on it; the message begins with ``key``.
        """
        if name in self.unusable:
            raise ConfigurationError(f"{key}: {self.unusable[name]}")
        if name not in self.surfaces:
            listed = (
                f"{each} (a number, without a name)" if each.isdecimal() else each for each in self.surfaces
            )
            names = ", ".join(listed) or "none; give the surfaces of the mesh file names"
            near = did_you_mean(name, self.surfaces)
            advice = f"{near} its surfaces are {names}".lstrip()
            raise ConfigurationError(f"{key}: the body has no surface '{name}'; {advice}")
        return self.surfaces[name]

    def require_surfaces(self, names: Iterable[str], key: str) -> None:
        """Check that the body has all surfaces of these names.

        Raises
        ------
        ConfigurationError
            It has not; the message begins with ``key`` and a name, and tells all names that are wrong.
        """
        wrong = [name for name in names if name not in self.surfaces or name in self.unusable]
        if not wrong:
            return
        try:
            self.surface(wrong[0], f"{key}.{wrong[0]}")
        except ConfigurationError as error:
            asked = [" ".join([f"'{name}'", *self._near(name)]) for name in wrong[1:]]
            also = f"; also wrong: {joined(asked)}" if asked else ""
            raise ConfigurationError(f"{error}{also}") from None

    def _near(self, name: str) -> tuple[str, ...]:
        asked = "" if name in self.unusable else did_you_mean(name, self.surfaces)
        return (f"({asked})",) if asked else ()

    def check(self, what: str) -> BodyMesh:
        """Return this mesh.

        Raises
        ------
        ConfigurationError
            An element is turned inside out; the message begins with ``what``.
        """
        bad = int((self.weights <= 0).any(axis=1).sum())
        if bad:
            raise ConfigurationError(
                f"{what}: {bad} of {len(self.cells)} elements are turned inside out or flat; mesh the body anew, "
                "finer where it is curved"
            )
        return self


def counted_facets(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return all facets (k, 9 or 6), each once and outward of its first element, and how many elements have it (k,)."""
    element = ELEMENTS[cells.shape[1]]
    facets = cells[:, element.facets].reshape(-1, element.facets.shape[1])
    corners = np.sort(facets[:, : element.facet_corners], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    order = np.argsort(first)
    return np.asarray(facets[first[order]]), count[order]


def boundary_facets(cells: IntArray) -> IntArray:
    """Facets (k, 9 or 6) that belong to one element only, outward."""
    facets, count = counted_facets(cells)
    return np.asarray(facets[count == 1])


def facet_middles(points: Array, facets: IntArray) -> Array:
    """(k, 3) means of the corners."""
    return np.asarray(points[facets[:, : 4 if facets.shape[1] == 9 else 3]].mean(axis=1))
