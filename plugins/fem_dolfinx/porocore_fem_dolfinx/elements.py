"""Lagrange elements, quadrature elements and quadrature points, of basix.ufl or of the old UFL."""

from __future__ import annotations

import numpy as np

from porocore.states import Array
from porocore_fem_dolfinx.library import MODERN, basix, ufl
from porocore_fem_dolfinx.types import Element


def _old(family: str, cell: str, degree: int, shape: tuple[int, ...], **options: str) -> Element:
    """Return the element of a scalar, vector or tensor field by the old UFL."""
    if not shape:
        return ufl.FiniteElement(family, cell, degree, **options)
    if len(shape) == 1:
        return ufl.VectorElement(family, cell, degree, dim=shape[0], **options)
    return ufl.TensorElement(family, cell, degree, shape=shape, **options)


def lagrange_element(
    cell: str, degree: int, shape: tuple[int, ...] = (), *, discontinuous: bool = False
) -> Element:
    """Return the Lagrange element of a scalar, vector or tensor field, which may be discontinuous between cells."""
    if MODERN:
        return basix.ufl.element("Lagrange", cell, degree, shape=shape, discontinuous=discontinuous)
    return _old("DG" if discontinuous else "Lagrange", cell, degree, shape)


def coordinate_element(cell: str, degree: int, dimension: int = 3) -> Element:
    """Return the element of the nodes of a mesh in two or three dimensions.

    FFCx 0.5 exchanges that of any other variant for this one when it first compiles a form on the mesh, so that forms
    had two names in the cache, and each was compiled twice.
    """
    if MODERN:
        return lagrange_element(cell, degree, (dimension,))
    return _old("Lagrange", cell, degree, (dimension,), variant="equispaced")


def quadrature_points(cell: str, degree: int) -> Array:
    """Return the points (q, 3) of the default rule of this degree, in the order of :func:`quadrature_element`.

    Those of flat cells are (q, 2).
    """
    return np.asarray(basix.make_quadrature(getattr(basix.CellType, cell), degree)[0])


def quadrature_element(cell: str, degree: int, shape: tuple[int, ...] = ()) -> Element:
    """Return the element of values at the points of the default rule of this degree."""
    if MODERN:
        return basix.ufl.quadrature_element(cell, value_shape=shape, degree=degree)
    return _old("Quadrature", cell, degree, shape, quad_scheme="default")


# Degrees of the default rule on a tetrahedron with 1, 4 and 14 points, and of n x n x n products of Gauss-Jacobi rules.
_RULES_BY_SIZE = {1: (1, "default"), 4: (2, "default"), 14: (4, "default")} | {
    n**3: (2 * n - 2, "Gauss-Jacobi") for n in range(4, 8)
}


def values_at_points(points: Array, weights: Array, shape: tuple[int, ...] = ()) -> Element:
    """Return the element of values at points (q, 3) of the reference tetrahedron, to be integrated with their rule.

    Elements of the old UFL have the points of basix's own rules. FFCx never looks at them: a value belongs to the point
    of the same number in whatever rule the integral has, so one with as many points will do.
    """
    if MODERN:
        # Copies: the bindings of 0.9 take no array that cannot be written.
        rule = {"points": np.array(points), "weights": np.array(weights)}
        return basix.ufl.quadrature_element("tetrahedron", value_shape=shape, **rule)
    degree, scheme = _RULES_BY_SIZE[len(points)]
    return _old("Quadrature", "tetrahedron", degree, shape, quad_scheme=scheme)
