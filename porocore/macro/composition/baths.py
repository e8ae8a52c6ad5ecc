"""Baths that differ from surface to surface as a field of the body (BathsField): steady diffusion between them."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from porocore.core.echo import joined
from porocore.core.fields import provided
from porocore.core.formulas import TimeFunction, Value
from porocore.core.models.strict import Name
from porocore.core.units import units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.fields import ParameterField, Points
from porocore.states import Array

#: Elements whose matrices are made together.
TOGETHER = 2000


def value_at(value: Value, time: float) -> float:
    """Return a number, which acts from the beginning, or the value of a function at ``time``."""
    return value.at(time) if isinstance(value, TimeFunction) else value


class BathsField(ParameterField):
    """Concentration between the baths of several surfaces; a configuration has it as ``macro.charges.bath``.

    The salt has diffused to its steady state, for ions are faster than fluid: c*(X, t) = Σ_s w_s(X) c_s(t). The share
    w_s is harmonic in the undeformed body, 1 on the surface s, 0 on the others, without flux through the rest.
    """

    kind: Literal["baths"] = "baths"
    """Steady diffusion between surfaces."""
    surfaces: Annotated[dict[Name, Value], Field(min_length=1)]
    """c_s by surface: a number or a function of time."""

    @property
    def varies(self) -> bool:
        """True where a bath changes with time."""
        return super().varies or any(isinstance(bath, TimeFunction) for bath in self.surfaces.values())

    @property
    def by_formula(self) -> bool:
        """True where a bath changes with time by a formula."""
        baths = self.surfaces.values()
        return super().by_formula or any(
            isinstance(bath, TimeFunction) and bath.expression is not None for bath in baths
        )

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which a bath or the share of the way has a kink."""
        own = (bath.corners for bath in self.surfaces.values() if isinstance(bath, TimeFunction))
        return (*super().corners, *(time for corners in own for time in corners))

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the concentrations at quadrature points of a body."""
        mesh, number = provided(points.mesh), provided(points.number)
        for surface in self.surfaces:
            mesh.surface(surface, f"{key}.{surface}")
        baths = np.array([value_at(bath, time) for bath in self.surfaces.values()])
        return np.asarray(shares_of_surfaces(mesh, tuple(self.surfaces), key)[number] @ baths)


@lru_cache(maxsize=4)
def shares_of_surfaces(mesh: BodyMesh, surfaces: tuple[str, ...], key: str) -> Array:
    """Return the shares w_s (points, surfaces) at all quadrature points of a body, which add up to 1.

    They have the shape functions of the pressure. A node of two surfaces that touch has the mean of both.

    Raises
    ------
    ConfigurationError
        A piece of the body touches none of the surfaces; the message begins with ``key``.
    """
    element, n = mesh.element, len(mesh.p_nodes)
    on = np.zeros((n, len(surfaces)))
    for column, surface in enumerate(surfaces):
        corners = mesh.surfaces[surface][:, : element.facet_corners]
        on[np.searchsorted(mesh.p_nodes, np.unique(corners)), column] = 1.0
    fixed = on.any(axis=1)
    pieces = mesh.pieces[mesh.p_nodes]
    if (alone := ~np.isin(pieces, pieces[fixed])).any():
        at = units_now().texts(mesh.points[mesh.p_nodes[alone.argmax()]], "displacement")
        raise ConfigurationError(
            f"{key}: a piece of the body, at {at}, touches none of the surfaces {joined(surfaces)}, so that its "
            "concentration is not determined; drain a surface of it"
        )
    w = np.zeros_like(on)
    w[fixed] = on[fixed] / on[fixed].sum(axis=1, keepdims=True)
    if not fixed.all():
        A = _laplacian(mesh)[~fixed]
        factor = splu(A[:, ~fixed].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        w[~fixed] = factor.solve(-(A[:, fixed] @ w[fixed]))
    # On elements with obtuse angles a discrete harmonic function may leave its ends; a bath then had no salt.
    w = np.clip(w, 0.0, 1.0)
    w /= w.sum(axis=1, keepdims=True)
    values = element.corner_values(element.points) @ w[mesh.p_cells]
    return np.asarray(values.reshape(-1, len(surfaces)))


def _laplacian(mesh: BodyMesh) -> csc_matrix:
    """Return ∫ ∇N_a · ∇N_b dX of the pressure's shape functions."""
    element, d, n = mesh.element, mesh.element.dimension, len(mesh.p_nodes)
    # Those of the corners are sums of the quadratic ones.
    linear = element.corner_values(element.nodes)
    reference = np.einsum("qak,ac->qck", element.gradients(element.points), linear)
    found = csc_matrix((n, n))
    for first in range(0, len(mesh.cells), TOGETHER):
        part = slice(first, first + TOGETHER)
        gradients = (reference @ np.linalg.inv(mesh.jacobians[part]))[..., :d]
        local = np.einsum("eq,eqai,eqbi->eab", mesh.weights[part], gradients, gradients, optimize=True)
        cells, count = mesh.p_cells[part], element.corners
        rows, columns = np.repeat(cells, count, axis=1).ravel(), np.tile(cells, count).ravel()
        found = found + coo_matrix((local.ravel(), (rows, columns)), shape=(n, n)).tocsc()
    return found
