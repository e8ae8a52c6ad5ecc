"""Means over elements of the regions, parameters and material axes of a body (kept_cells, cells_of_elements)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from porocore.interfaces.element_cells import ElementCells
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.body_fields import BodyFields
from porocore.macro.composition.composed_body import ComposedBody, NeedsParameters
from porocore.states import Array


def kept_cells(
    body: BodyFields, regions: Sequence[str], times: Sequence[float], means: Callable[[Array], Array]
) -> ElementCells | None:
    """Return the cells of a body's elements at the kept times; None where they are alike.

    Parameters
    ----------
    body
        Fields of the body at some points.
    regions
        Names of its regions.
    times
        At least one.
    means
        Returns the means over all elements (elements, ...) of values at these points (points, ...).
    """
    at = [body.at(time) for time in (times if body.varies else times[:1])]
    place = at[0].place
    if place is None:
        return None
    values = [means(each.parameters) for each in at if each.parameters is not None]
    axes = [means(each.place.axes) for each in at if each.place is not None and each.place.axes is not None]
    return ElementCells(
        np.rint(means(place.region.astype(float))).astype(np.int64),
        tuple(regions),
        body.names,
        np.stack(values) if values else None,
        nearest_rotations(np.stack(axes)) if axes else None,
    )


def cells_of_elements(
    setup: ComposedBody, mesh: BodyMesh, law: NeedsParameters, times: Sequence[float]
) -> ElementCells | None:
    """Return the cells of all elements of a mesh; see :func:`kept_cells`.

    Raises
    ------
    ConfigurationError
        See :class:`~porocore.macro.composition.body_fields.BodyFields`.
    """
    shares = mesh.weights / mesh.weights.sum(axis=1, keepdims=True)

    def means(values: Array) -> Array:
        by_element = values.reshape(*shares.shape, *values.shape[1:])
        return np.asarray(np.einsum("eq,eq...->e...", shares, by_element))

    return kept_cells(BodyFields(setup, mesh, law), tuple(setup.regions), times, means)


def nearest_rotations(matrices: Array) -> Array:
    """Return the rotations (..., 3, 3) that lie nearest to matrices, such as means of rotations."""
    U, _, V = np.linalg.svd(matrices)
    U[..., -1] *= np.sign(np.linalg.det(U @ V))[..., None]
    return np.asarray(U @ V)
