"""Mesh of a cell in dolfinx, its function space, and the condensation of its constraints."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import tetrahedron_rule
from porocore.cell.symmetry import held_displacements
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
        nodes = np.asarray(self.domain.geometry.input_global_indices)[compat.cell_nodes(self.domain)]
        table = np.full(int(dofs.max()) + 1, -1, dtype=np.int64)
        table[dofs] = nodes[:, : dofs.shape[1]]
        return table


class Condensation:
    """All unknowns u = T x from the free ones x.

    Parameters
    ----------
    images : (n,) int
        Number of the unknown that a dof is an image of; dofs with the same number are one.
    held : (n,) bool
        Dofs that vanish, with all their images.
    """

    def __init__(self, images: IntArray, held: npt.NDArray[np.bool_]) -> None:
        classes = np.unique(images[~held])
        column = np.full(int(images.max()) + 1, -1, dtype=np.int64)
        column[classes] = np.arange(len(classes))
        rows = np.flatnonzero(~held)
        #: Number of free unknowns.
        self.size = len(classes)
        self.T = sparse.csr_matrix(
            (np.ones(len(rows)), (rows, column[images[rows]])), shape=(len(images), self.size)
        )
        self._petsc = compat.freed_with(self, to_petsc(self.T))
        # By the block size multigrid knows that three unknowns belong to one node, if all three are free.
        whole = len(classes) % 3 == 0 and (classes.reshape(-1, 3) % 3 == np.arange(3)).all()
        self._block = 3 if whole and len(images) % 3 == 0 else 1
        self._matrix: PETSc.Mat | None = None
        self._keys: IntArray | None = None

    def matrix(self, full: PETSc.Mat, entries: tuple[IntArray, IntArray, Array] | None = None) -> PETSc.Mat:
        """Return Tᵀ A T, in a matrix that the next call overwrites; ``entries`` (rows, columns, values) are added to A.

        Entries that the pattern of A has no room for make another matrix.
        """
        if self._matrix is None:
            self._matrix = compat.freed_with(self, full.ptap(self._petsc))
            self._matrix.setBlockSize(self._block)
        else:
            full.ptap(self._petsc, result=self._matrix)
        if entries is None:
            return self._matrix
        rows, columns, values = entries
        more = self.T.T @ sparse.csr_matrix((values, (rows, columns)), shape=full.getSize()) @ self.T
        if self._has_room(self._matrix, more):
            self._matrix.axpy(1.0, to_petsc(more), PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            return self._matrix
        wider = self._matrix.duplicate(copy=True)
        wider.axpy(1.0, to_petsc(more), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return wider

    def _has_room(self, matrix: PETSc.Mat, more: sparse.csr_matrix) -> bool:
        """Return whether every entry of ``more`` lies within the pattern of Tᵀ A T."""
        if self._keys is None:
            indptr, indices, _ = matrix.getValuesCSR()
            rows = np.repeat(np.arange(self.size), np.diff(indptr))
            self._keys = np.sort(rows * self.size + indices)
        more = more.tocoo()
        return bool(np.isin(more.row.astype(np.int64) * self.size + more.col, self._keys).all())

    def reduce(self, full: Array) -> Array:
        """Return Tᵀ f."""
        return np.asarray(self.T.T @ full)

    def expand(self, free: Array) -> Array:
        """Return T x."""
        return np.asarray(self.T @ free)

    def restrict(self, full: Array) -> Array:
        """Return x of a u = T x."""
        counts = np.asarray(self.T.sum(axis=0)).ravel()
        return np.asarray((self.T.T @ full) / counts)


def to_petsc(matrix: sparse.csr_matrix) -> PETSc.Mat:
    """Return a copy of a scipy matrix as a PETSc matrix of this process."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    return compat.make_matrix(PETSc.COMM_SELF, matrix.shape, matrix.indptr, matrix.indices, matrix.data)


def to_scipy(matrix: PETSc.Mat) -> sparse.csr_matrix:
    """Return a copy of a PETSc matrix of this process as a scipy matrix."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), shape=matrix.getSize())


class SolidSpace:
    """Function space of u¹ on one mesh.

    Attributes
    ----------
    domain
        Mesh of the solid.
    functions
        Lagrange functions of the mesh's order.
    dof : (nodes,)
        Dof of each node of the mesh.
    """

    def __init__(self, mesh: CellMesh, degree: int) -> None:
        self.mesh, self.domain = mesh, CellDomain(mesh, degree)
        self.functions = self.domain.lagrange(mesh.order, (3,))
        self._cell_dofs = compat.cell_dofs(self.functions.dofmap)
        self._node = self.domain.nodes_of(self._cell_dofs)
        self.dof = np.argsort(self._node)
        self._free: dict[str, Condensation] = {}

    def to_nodes(self, u: Array) -> Array:
        """Return values (nodes, 3) in the order of the mesh from those at the dofs."""
        return u.reshape(-1, 3)[self.dof]

    def to_dofs(self, values: Array) -> Array:
        """Return values at the dofs, flat, from those (nodes, 3) in the order of the mesh."""
        return np.ascontiguousarray(values[self._node]).ravel()

    def integral(self, values: Array) -> Array:
        """Return the integral over the domain of values (cells, q, ...)."""
        return np.tensordot(self.domain.weights, values, axes=2)

    def nodal_sums(self, stress: Array) -> Array:
        """Return, at each dof, the sum over its elements of the forces of a stress of the size (cells, q)."""
        # ∇N is about the inverse of the length of an element.
        length = np.cbrt(6 * self.domain.weights.sum(axis=1))
        forces = np.repeat((stress * self.domain.weights).sum(axis=1) / length, 3 * len(self._cell_dofs[0]))
        dofs = 3 * self._cell_dofs[:, :, None] + np.arange(3)
        return np.bincount(dofs.ravel(), forces, minlength=3 * len(self._node)).astype(float)

    def free(self, parity: str) -> Condensation:
        """Return the free unknowns of a class of perturbations."""
        if parity not in self._free:
            images = 3 * self.mesh.periodic_class[self._node][:, None] + np.arange(3)
            held = held_displacements(self.mesh, parity)[self._node]
            self._free[parity] = Condensation(images.ravel(), held.ravel())
        return self._free[parity]

    def release(self, parity: str) -> None:
        """Free the memory of the unknowns of a class."""
        self._free.pop(parity, None)
