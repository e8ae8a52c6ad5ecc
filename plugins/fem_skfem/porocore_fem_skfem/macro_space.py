"""The box as scikit-fem sees it: mesh, quadrature, shape functions, and which unknowns are prescribed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import Basis, ElementHex1, ElementHex2, FacetBasis, MeshHex

from porocore.errors import ConfigurationError
from porocore.problem import FACES, Boundary, Face, MacroProblem

#: Three Gauss points in each direction: exact for the products of the quadratic displacement with itself.
INTEGRATION_ORDER = 5
#: VTK's order of the 27 nodes of a triquadratic hexahedron, in half edges of the element.
VTK_NODES = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)


@dataclass(frozen=True, eq=False)
class Reference:
    """Shape functions of one element; the elements of a box are congruent, so one stands for all.

    Attributes
    ----------
    weights : (q,)
        Of the quadrature, with the element's volume in them.
    grad_u : (q, 27, 3)
        ∇N of the quadratic displacement.
    p, grad_p : (q, 8), (q, 8, 3)
        N and ∇N of the linear pressure.
    p_at_nodes : (27, 8)
        N of the pressure at the nodes of the displacement.
    """

    weights: Any
    grad_u: Any
    p: Any
    grad_p: Any
    p_at_nodes: Any


@dataclass(frozen=True, eq=False)
class Space:
    """Unknowns of the u–p problem, (nodes × 3 displacements, then pressures), and the data of its boundary.

    Attributes
    ----------
    problem
        What it was made for.
    points, p_points : (nodes, 3), (p_nodes, 3)
        Nodes of the displacement and of the pressure.
    cells, p_cells : (elements, 27), (elements, 8)
        Nodes of each element, in scikit-fem's order.
    vtk_cells : (elements, 27)
        The same in VTK's order.
    reference
        Shape functions.
    prescribed, values : (k,)
        Unknowns that are prescribed, in ascending order, and their values under a load of 1.
    force : (3 nodes,)
        ∫ t̄ N dS under a load of 1.
    outflow : (p_nodes,)
        ∫ q̄ N dS under a load of 1.
    """

    problem: MacroProblem
    points: Any
    p_points: Any
    cells: Any
    p_cells: Any
    vtk_cells: Any
    reference: Reference
    prescribed: Any
    values: Any
    force: Any
    outflow: Any

    @property
    def n_u(self) -> int:
        """Number of displacement unknowns, prescribed ones included."""
        return 3 * len(self.points)

    @property
    def size(self) -> int:
        """Number of unknowns, prescribed ones included."""
        return self.n_u + len(self.p_points)

    @property
    def dofs(self) -> Any:
        """(elements, 81 + 8): unknown of u_i at local node a in column 27 i + a, then the pressures."""
        u = [3 * self.cells + i for i in range(3)]
        return np.concatenate([*u, self.n_u + self.p_cells], axis=1)


def make_space(problem: MacroProblem) -> Space:
    """Mesh the box, evaluate the shape functions and collect the boundary data.

    Raises
    ------
    ConfigurationError
        Two faces prescribe different values on their common edge, or a translation is not held.
    """
    axes = [np.linspace(0, size, n + 1) for size, n in zip(problem.size, problem.elements, strict=True)]
    mesh = MeshHex.init_tensor(*axes)
    u_basis = Basis(mesh, ElementHex2(), intorder=INTEGRATION_ORDER)
    p_basis = u_basis.with_element(ElementHex1())
    cells, points = u_basis.element_dofs.T.astype(np.int64), u_basis.doflocs.T.copy()
    prescribed, values = _dirichlet(problem, mesh, u_basis, p_basis)
    force, outflow = _neumann(problem, mesh, len(points), p_basis.N)
    return Space(
        problem,
        points,
        p_basis.doflocs.T.copy(),
        cells,
        p_basis.element_dofs.T.astype(np.int64),
        _vtk_order(points, cells),
        _reference(u_basis, p_basis),
        prescribed,
        values,
        force,
        outflow,
    )


def _reference(u_basis: Any, p_basis: Any) -> Reference:
    """From the first element."""
    grad = [
        np.stack([b.basis[a][0].grad[:, 0].T for a in range(b.Nbfun)], axis=1) for b in (u_basis, p_basis)
    ]
    nodes = ElementHex2().doflocs.T  # in the element's own coordinates, which need not run along x, y, z
    return Reference(
        weights=u_basis.dx[0].copy(),
        grad_u=grad[0],
        p=np.stack([np.asarray(p_basis.basis[a][0])[0] for a in range(p_basis.Nbfun)], axis=1),
        grad_p=grad[1],
        p_at_nodes=np.stack([ElementHex1().lbasis(nodes, a)[0] for a in range(p_basis.Nbfun)], axis=1),
    )


def _vtk_order(points: Any, cells: Any) -> Any:
    corner = points[cells].min(axis=1, keepdims=True)
    half = np.ptp(points[cells], axis=1)[:, None, :] / 2
    lattice = np.rint((points[cells] - corner) / half).astype(np.int64)
    key = lattice @ np.array([1, 3, 9])
    order = np.argsort(key, axis=1)[:, np.argsort(np.argsort(VTK_NODES @ np.array([1, 3, 9])))]
    return np.take_along_axis(cells, order, axis=1)


def _facets(mesh: MeshHex, problem: MacroProblem, face: Face) -> Any:
    axis = "xyz".index(face[0])
    side = problem.size[axis] if face[1] == "+" else 0.0
    slack = 1e-6 * problem.size[axis] / problem.elements[axis]
    return mesh.facets_satisfying(lambda x: np.abs(x[axis] - side) < slack, boundaries_only=True)


def _dirichlet(problem: MacroProblem, mesh: MeshHex, u_basis: Any, p_basis: Any) -> tuple[Any, Any]:
    n_u = 3 * u_basis.N
    values = np.full(n_u + p_basis.N, np.nan)
    for face in FACES:
        boundary = problem.boundary.get(face, Boundary())
        facets = _facets(mesh, problem, face)
        wanted = [
            (3 * u_basis.get_dofs(facets).all() + i, value, f"u_{i + 1}")
            for i, value in enumerate(boundary.displacement)
        ]
        wanted.append((n_u + p_basis.get_dofs(facets).all(), boundary.pressure, "p"))
        for dofs, value, name in wanted:
            if value is None:
                continue
            before = values[dofs]
            clash = before[~np.isnan(before) & (before != value)]
            if clash.size:
                raise ConfigurationError(
                    f"macro.boundary.{face}: {name} = {value:g} contradicts {name} = {clash[0]:g} of a "
                    "neighbouring face on their common edge; prescribe it on one of them only"
                )
            values[dofs] = value
    for i in range(3):
        if np.isnan(values[i:n_u:3]).all():
            raise ConfigurationError(
                f"macro.boundary: nothing holds the body in direction {i + 1}; "
                f"prescribe u_{i + 1} on some face"
            )
    prescribed = np.flatnonzero(~np.isnan(values))
    return prescribed, values[prescribed]


def _neumann(problem: MacroProblem, mesh: MeshHex, nodes: int, p_nodes: int) -> tuple[Any, Any]:
    force, outflow = np.zeros((nodes, 3)), np.zeros(p_nodes)
    for face in FACES:
        boundary = problem.boundary.get(face, Boundary())
        facets = _facets(mesh, problem, face)
        if any(boundary.traction):
            force += np.outer(_face_integrals(mesh, ElementHex2(), facets), boundary.traction)
        if boundary.flux:
            outflow += boundary.flux * _face_integrals(mesh, ElementHex1(), facets)
    return force.ravel(), outflow


def _face_integrals(mesh: MeshHex, element: Any, facets: Any) -> Any:
    """∫ N dS over the facets, for each node."""
    basis = FacetBasis(mesh, element, facets=facets, intorder=INTEGRATION_ORDER)
    local = np.stack([(np.asarray(basis.basis[a][0]) * basis.dx).sum(axis=1) for a in range(basis.Nbfun)])
    return np.bincount(basis.element_dofs.ravel(), local.ravel(), minlength=basis.N)
