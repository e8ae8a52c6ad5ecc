"""Measurements of a run: forces on surfaces and inflows from nodal reactions, and values at probes.

A surface bears forces in the directions in which it holds the body: a smooth plane along its normal alone. Where those
of the surfaces of a node are independent, the reaction R there has one decomposition into such forces. Else the part of
each is the force of the stress beside it, ∫ P·N φ dS projected on its directions, and what all these lack of R is
shared by the areas of the facets at the node. So the parts add up to R, turn with the body, and do not depend on the
order of the surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import add
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.core.units import units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.body.points import BodyPoints
from porocore.states import Array, IntArray

#: Of the largest eigenvalue of a node, below which a direction is not held.
RANK = 1e-9
#: Sine of an angle between directions below which they are one.
SAME = 1e-6
#: Of the largest vector area of a facet's node.
ROUND_OFF = 1e-12


@dataclass(frozen=True, eq=False)
class Support:
    """Surface and the orthonormal directions (k, 3) in which it holds the body; (1, 1) for the fluid."""

    facets: Facets
    directions: Array


@dataclass(frozen=True, eq=False)
class Share:
    """Linear map from the nodal reactions and the field in all elements to the total of one surface.

    Attributes
    ----------
    projection : (c, c)
        On the directions of the surface.
    by_reaction : (c, unknowns)
        Sparse.
    by_field : (c, elements · c · 3)
        Sparse; empty where the reactions alone decide.
    """

    projection: Array
    by_reaction: Any
    by_field: Any

    def total(self, reactions: Array, field: Array | None) -> Array:
        """Return the total (c,) from the reactions (unknowns,) and P_E (elements, 3, 3), or −q (elements, 3).

        ``field`` may be None where :attr:`needs_field` is false.
        """
        total = self.by_reaction @ reactions
        if field is not None and self.needs_field:
            total = total + self.by_field @ field.ravel()
        return np.asarray(self.projection @ total)

    def weights(self, of_total: Array) -> tuple[Array, Array]:
        """Return the weights of the reactions (unknowns, f) and of the field (elements · c · 3, f) in sums of totals.

        ``of_total`` (c, f) are those of the total in each of f sums: this is the transpose of :meth:`total`.
        """
        projected = self.projection.T @ of_total
        return np.asarray(self.by_reaction.T @ projected), np.asarray(self.by_field.T @ projected)

    @property
    def needs_field(self) -> bool:
        """True if surfaces share a node, so that the stress or the flux beside it is needed."""
        return bool(self.by_field.nnz)


def shares(mesh: BodyMesh, supports: Mapping[str, Support], *, fluid: bool = False) -> dict[str, Share]:
    """Return the share of each surface in the nodal reactions, of forces or of the ``fluid``.

    A face that belongs to several surfaces counts wholly for each.
    """
    pieces = _without_overlap(mesh, supports)
    found = _shares_of_pieces(mesh, pieces, fluid)
    total = {}
    for name, support in supports.items():
        own = [share for names, share in found.items() if name in names]
        total[name] = Share(
            support.directions.T @ support.directions,
            reduce(add, (share.by_reaction for share in own)),
            reduce(add, (share.by_field for share in own)),
        )
    return total


def _without_overlap(mesh: BodyMesh, supports: Mapping[str, Support]) -> dict[tuple[str, ...], Support]:
    """Return the pieces of surfaces that overlap, each by the names of the surfaces to which it belongs."""
    names_of: dict[tuple[int, ...], list[str]] = {}
    keys = {name: mesh.corners_of(support.facets.nodes) for name, support in supports.items()}
    for name, own in keys.items():
        for key in own:
            names_of.setdefault(key, []).append(name)
    rows: dict[tuple[str, ...], list[int]] = {}
    for name, own in keys.items():
        for row, key in enumerate(own):
            if names_of[key][0] == name:
                rows.setdefault(tuple(names_of[key]), []).append(row)
    return {
        names: Support(
            Facets(mesh, supports[names[0]].facets.nodes[own]),
            _together([supports[name].directions for name in names]),
        )
        for names, own in rows.items()
    }


def _together(directions: Sequence[Array]) -> Array:
    """Return orthonormal directions (k, d) of the space of all given ones."""
    if len(directions) == 1:
        return directions[0]
    _, sizes, rows = np.linalg.svd(np.concatenate(directions), full_matrices=False)
    return np.asarray(rows[sizes > SAME * sizes[0]])


def _shares_of_pieces(
    mesh: BodyMesh, pieces: Mapping[tuple[str, ...], Support], fluid: bool
) -> dict[tuple[str, ...], Share]:
    """Return the share of each piece; no two have a facet in common."""
    parts = {names: _Part(mesh, support, fluid) for names, support in pieces.items()}
    count, c = np.zeros(len(mesh.points), dtype=np.int64), 1 if fluid else 3
    whole = np.zeros((len(mesh.points), c, c))
    for part in parts.values():
        nodes = np.unique(part.nodes)
        count[nodes] += 1
        whole += part.areas[:, None, None] * part.projection
    inverse = np.zeros_like(whole)
    held = np.flatnonzero(count)
    inverse[held] = np.linalg.pinv(whole[held], rcond=RANK, hermitian=True)
    shared = count > 1
    fields = {names: part.by_field(shared) for names, part in parts.items()}
    together = sum(fields.values())
    return {names: part.share(inverse, fields[names], together) for names, part in parts.items()}


class _Part:
    """Surface with nodes (f, m) of its facets, vector areas (f, m, 3) ∫ φ N dS, areas at nodes (nodes,)."""

    def __init__(self, mesh: BodyMesh, support: Support, fluid: bool) -> None:
        self.mesh, facets, reference = mesh, support.facets, mesh.element.facet
        self.fluid, self.c = fluid, 1 if fluid else 3
        values = reference.corner_values if fluid else reference.values
        self.facets = facets.nodes
        self.nodes = facets.nodes[:, : values.shape[1]]
        self.vectors = np.einsum("fqi,q,qa->fai", facets.normals, reference.weights, values, optimize=True)
        area = np.repeat(facets.areas.sum(axis=1), self.nodes.shape[1])
        self.areas = np.bincount(self.nodes.ravel(), area, len(mesh.points)).astype(float)
        self.projection = support.directions.T @ support.directions

    def unknowns(self, nodes: IntArray) -> IntArray:
        """Return the unknowns (n, c) at the nodes."""
        if self.fluid:
            return np.asarray(self.mesh.n_u + np.searchsorted(self.mesh.p_nodes, nodes)[:, None])
        return np.asarray(3 * nodes[:, None] + np.arange(3))

    def by_field(self, shared: npt.NDArray[np.bool_]) -> Any:
        """Return the force of the field beside each shared node, sparse (c · nodes, elements · c · 3)."""
        facet, local = np.nonzero(shared[self.nodes])
        vectors, nodes = self.vectors[facet, local], self.nodes[facet, local]
        wanted, which = np.unique(facet, return_inverse=True)
        element = Facets(self.mesh, self.facets[wanted]).elements[which.ravel()]
        c = self.c
        values = np.einsum("ij,nk->nijk", self.projection, vectors)
        rows = c * nodes[:, None] + np.arange(c)
        columns = c * 3 * element[:, None] + np.arange(3 * c)
        shape = (c * len(self.mesh.points), c * 3 * len(self.mesh.cells))
        return sparse.csr_matrix(
            (
                values.ravel(),
                (np.repeat(rows, 3 * c, axis=1).ravel(), np.repeat(columns[:, None], c, axis=1).ravel()),
            ),
            shape=shape,
        )

    def share(self, inverse: Array, own: Any, together: Any) -> Share:
        """Return the surface's share: its own force of the field, and its part of the remaining reactions.

        ``inverse`` (nodes, c, c) is that of the sum of areas times projections.
        """
        nodes, c, n = np.unique(self.nodes), self.c, len(self.mesh.points)
        parts = self.areas[nodes, None, None] * (self.projection @ inverse[nodes])

        def summed(unknowns: IntArray, columns: int) -> Any:
            rows = np.broadcast_to(np.arange(c)[None, :, None], parts.shape)
            places = np.broadcast_to(unknowns[:, None, :], parts.shape)
            return sparse.csr_matrix((parts.ravel(), (rows.ravel(), places.ravel())), shape=(c, columns))

        at_nodes = summed(c * nodes[:, None] + np.arange(c), c * n)
        all_nodes = sparse.csr_matrix((np.ones(c * n), (np.tile(np.arange(c), n), np.arange(c * n))))
        by_field = (all_nodes @ own - at_nodes @ together).tocsr()
        # Where directions are independent, the two are one but for round-off.
        by_field.data[np.abs(by_field.data) <= ROUND_OFF * abs(own).max()] = 0.0
        by_field.eliminate_zeros()
        return Share(self.projection, summed(self.unknowns(nodes), self.mesh.size), by_field)


def interpolation(mesh: BodyMesh, probes: Mapping[str, tuple[float, float, float]]) -> Any:
    """Return the sparse matrix (4 probes, unknowns) from all unknowns to u_1, u_2, u_3 and p of each probe.

    Raises
    ------
    ConfigurationError
        A probe lies outside the body.
    """
    if not probes:
        return sparse.csr_matrix((0, mesh.size))
    points = BodyPoints.at(mesh, np.array(list(probes.values())))
    if not points.inside.all():
        name = list(probes)[int(np.argmin(points.inside))]
        raise outside(mesh, f"macro.probes.{name}", np.array(probes[name]))
    of_u = np.concatenate([np.eye(3), np.zeros((1, 3))])
    every = points[np.repeat(np.arange(len(points)), 4)]
    return every.rows(np.tile(of_u, (len(points), 1)), np.tile([0.0, 0.0, 0.0, 1.0], len(points)))


def outside(mesh: BodyMesh, key: str, place: Array) -> ConfigurationError:
    """Return the complaint about a place outside the body."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    said = partial(units_now().texts, quantity="displacement", digits=6)
    unit = (
        "multiples of scales.length where they have no unit"
        if units_now().given
        else "lengths as in macro.body"
    )
    return ConfigurationError(
        f"{key}: the point {said(place)} lies outside the body, which extends from {said(low)} to {said(high)}; move "
        f"it inside (coordinates are {unit})"
    )
