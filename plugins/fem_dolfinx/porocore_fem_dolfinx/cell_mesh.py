"""The core's cell mesh as a dolfinx mesh (CellDomain): function spaces, values at points, maps of nodes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from mpi4py import MPI

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.states import Array, IntArray
from porocore_fem_dolfinx import compat, elements
from porocore_fem_dolfinx.types import CompiledExpression, Expr, Function, FunctionSpace


class CellDomain:
    """One phase on the eighth or the whole cell, on this process alone.

    Attributes
    ----------
    mesh
        The core's mesh.
    domain
        The dolfinx mesh; its cells and nodes are in another order.
    dx
        Measure with the core's quadrature rule.
    points, weights
        That rule: (q, 3) on the reference cell, and (cells, q) with the volume in them.
    """

    def __init__(self, mesh: CellMesh, degree: int) -> None:
        self.mesh = mesh
        cells = mesh.cells[:, compat.from_vtk("tetrahedron", mesh.cells.shape[1])]
        self.domain = compat.make_mesh(MPI.COMM_SELF, "tetrahedron", mesh.order, mesh.points, cells)
        self.n_cells = self.domain.topology.index_map(3).size_local
        self._all = np.arange(self.n_cells)
        self.points, weights = tetrahedron_rule(degree)
        self._reference_weights = weights
        self.dx = ufl.Measure(
            "dx",
            domain=self.domain,
            metadata={
                "quadrature_rule": "custom",
                "quadrature_degree": degree,
                "quadrature_points": self.points,
                "quadrature_weights": weights,
            },
        )
        volume = self.expression(ufl.as_vector([abs(ufl.JacobianDeterminant(self.domain))]))
        self.weights = self.evaluate(volume)[:, :, 0] * weights

    def move(self, points: Array) -> None:
        """Move the nodes to ``points`` (nodes, 3), in the core's order; later assemblies are on the moved mesh."""
        self.domain.geometry.x[:] = points[np.asarray(self.domain.geometry.input_global_indices)]

    def lagrange(self, degree: int, shape: tuple[int, ...] = ()) -> FunctionSpace:
        """Return a space of Lagrange functions."""
        return compat.function_space(self.domain, elements.lagrange_element("tetrahedron", degree, shape))

    def at_points(self, shape: tuple[int, ...]) -> tuple[Function, IntArray]:
        """Return a function of values at the quadrature points, and the place (cells, q) of each point among them."""
        element = elements.values_at_points(self.points, self._reference_weights, shape)
        space = compat.function_space(self.domain, element)
        return compat.make_function(space), compat.cell_dofs(space.dofmap)

    @cached_property
    def elements(self) -> IntArray:
        """Number (cells,) of each cell among the core's elements."""
        return np.asarray(self.domain.topology.original_cell_index)

    def expression(self, value: Expr) -> CompiledExpression:
        """Return an expression compiled for the quadrature points."""
        return compat.expression(value, self.points)

    def evaluate(self, compiled: CompiledExpression) -> Array:
        """Return the values (cells, q, components) of an expression."""
        values = compat.evaluate(compiled, self.domain, self._all)
        return values.reshape(self.n_cells, len(self.points), -1)

    def nodes_of(self, dofs: IntArray) -> IntArray:
        """Return the core's node at each dof (dofs,) of a Lagrange space whose dofs are nodes of the mesh.

        ``dofs`` is the (cells, k) table of the space. Dofs are ordered in a cell as its nodes are, vertices first, so
        k nodes of each cell are enough.
        """
        nodes = np.asarray(self.domain.geometry.input_global_indices)[
            compat.cell_dofs(self.domain.geometry.dofmap)
        ]
        table = np.full(int(dofs.max()) + 1, -1, dtype=np.int64)
        table[dofs] = nodes[:, : dofs.shape[1]]
        return table
