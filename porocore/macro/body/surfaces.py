"""Patches cut out of named surfaces; normals, areas and tangents of facets at quadrature points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import model_validator

from porocore.core.models.strict import Name, StrictModel
from porocore.core.units.dimensions import Dimension
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, facet_middles
from porocore.states import Array, IntArray

Range = Annotated[tuple[float, float], Dimension("displacement")]


class Patch(StrictModel):
    """The facets of a surface whose middles lie within bounds; they no longer belong to that surface."""

    of: Name
    """The surface that it is a part of."""
    x: Range | None = None
    """[from, to] of the middles of its facets along x."""
    y: Range | None = None
    """[from, to] of the middles of its facets along y."""
    z: Range | None = None
    """[from, to] of the middles of its facets along z."""
    centre: Annotated[tuple[float, float, float] | None, Dimension("displacement")] = None
    """[x, y, z] of the middle of a ball that the middles of its facets lie in."""
    radius: Annotated[float | None, Dimension("displacement")] = None
    """Radius of that ball."""

    @model_validator(mode="after")
    def _bounds(self) -> Patch:
        if (self.centre is None) != (self.radius is None):
            raise ValueError("centre and radius belong together")
        if self.centre is None and not any((self.x, self.y, self.z)):
            raise ValueError("expected bounds: x, y or z: [from, to], or centre and radius")
        return self

    def holds(self, places: Array) -> Array:
        """(n,) bool, which of the places (n, 3) lie within the bounds."""
        inside = np.ones(len(places), dtype=bool)
        for axis, bounds in enumerate((self.x, self.y, self.z)):
            if bounds is not None:
                inside &= (places[:, axis] >= bounds[0]) & (places[:, axis] <= bounds[1])
        if self.centre is not None and self.radius is not None:
            inside &= np.linalg.norm(places - np.array(self.centre), axis=1) <= self.radius
        return inside


def with_patches(mesh: BodyMesh, patches: Mapping[str, Patch]) -> BodyMesh:
    """The mesh with the patches among its surfaces.

    Raises
    ------
    ConfigurationError
        A patch is of no surface, holds no facet, or has the name of a surface.
    """
    surfaces = dict(mesh.surfaces)
    unusable = {name: why for name, why in mesh.unusable.items() if name not in patches or name in surfaces}
    mesh = replace(mesh, unusable=unusable)
    for name, patch in patches.items():
        key = f"macro.surfaces.{name}"
        if name in surfaces:
            raise ConfigurationError(f"{key}: the body has a surface of this name already; take another name")
        facets = replace(mesh, surfaces=surfaces).surface(patch.of, f"{key}.of")
        inside = patch.holds(facet_middles(mesh.points, facets))
        if not inside.any():
            raise ConfigurationError(
                f"{key}: none of the {len(facets)} facets of '{patch.of}' has its middle within these bounds; widen "
                "them, or mesh the body finer there"
            )
        surfaces[name], surfaces[patch.of] = facets[inside], facets[~inside]
    return replace(mesh, surfaces=surfaces)


@dataclass(frozen=True, eq=False)
class Facets:
    """Facets at their quadrature points.

    Attributes
    ----------
    nodes : (f, m)
        Of the displacement; the first ones are the corners.
    """

    mesh: BodyMesh
    nodes: IntArray

    def tangents_of(self, points: Array) -> Array:
        """(f, q, 3, 2) ∂x/∂ξ where the nodes are at ``points``."""
        gradients = self.mesh.element.facet.gradients
        return np.asarray(np.einsum("fai,qak->fqik", points[self.nodes], gradients, optimize=True))

    @property
    def normals(self) -> Array:
        """(f, q, 3) outward, of the length of the area that a point stands for on the unit facet."""
        t = self.tangents_of(self.mesh.points)
        return np.cross(t[..., 0], t[..., 1])

    @property
    def areas(self) -> Array:
        """(f, q) area of each quadrature point."""
        return np.asarray(np.linalg.norm(self.normals, axis=-1) * self.mesh.element.facet.weights)

    @property
    def elements(self) -> IntArray:
        """(f,) number of the element that each belongs to."""
        mesh, corners = self.mesh, self.mesh.element.facet_corners
        nodes = np.sort(self.nodes[:, :corners], axis=1)
        near = np.flatnonzero(np.isin(mesh.cells[:, : mesh.element.corners], nodes).any(axis=1))
        theirs = np.sort(mesh.cells[near][:, mesh.element.facets[:, :corners]], axis=2)
        owner = {tuple(key): int(e) for e, faces in zip(near, theirs.tolist(), strict=True) for key in faces}
        return np.array([owner[tuple(key)] for key in nodes.tolist()], dtype=np.int64)

    def shares(self, of: Array) -> Array:
        """(nodes,) ∫ N dS of shape functions with values ``of`` (q, k) at the points, for the first k nodes."""
        k = of.shape[1]
        local = self.areas @ of
        return np.bincount(self.nodes[:, :k].ravel(), local.ravel(), len(self.mesh.points)).astype(float)

    def plane(self, key: str) -> Array:
        """(3,) the one outward normal of plane facets.

        Raises
        ------
        ConfigurationError
            They are not plane; the message begins with ``key``.
        """
        n = self.normals.reshape(-1, 3)
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        if np.abs(n - n[0]).max() > 1e-6:
            raise ConfigurationError(
                f"{key}: this surface is not plane; prescribe components of the displacement"
            )
        n = np.where(np.abs(n[0]) < 1e-12, 0.0, n[0])
        return np.asarray(n / np.linalg.norm(n))
