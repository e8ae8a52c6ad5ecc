"""Protocols and type aliases of dolfinx and UFL objects (Mesh, Function, Form, …), for the type checker."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from porocore.states import Array, IntArray

if TYPE_CHECKING:
    import dolfinx
    import ufl
    from mpi4py import MPI
    from petsc4py import PETSc

#: Expression and integral of UFL.
Expr: TypeAlias = "ufl.core.expr.Expr"
Form: TypeAlias = "ufl.Form"
#: Finite element, of basix.ufl or of the old UFL; nothing is asked of it.
Element: TypeAlias = object
#: Compiled form, or lists of them; only dolfinx looks into it.
CompiledForm: TypeAlias = object


class CompiledExpression(Protocol):
    """Compiled expression, to be evaluated in cells."""

    eval: Callable[..., Array]


class Geometry(Protocol):
    """Nodes of a mesh on this process."""

    x: Array
    input_global_indices: IntArray
    dofmap: dolfinx.cpp.graph.AdjacencyList_int32


class Mesh(Protocol):
    """Mesh on the processes of a communicator."""

    comm: MPI.Intracomm
    topology: dolfinx.cpp.mesh.Topology
    geometry: Geometry


class FunctionSpace(Protocol):
    """Finite element space."""

    dofmap: dolfinx.fem.DofMap

    def tabulate_dof_coordinates(self) -> Array: ...


class Values(Protocol):
    """Values of a function on this process, copies of others' last."""

    array: Array
    petsc_vec: PETSc.Vec

    def scatter_forward(self) -> None: ...


class Function(Protocol):
    """Function of a space, which is an expression too."""

    x: Values


class Constant(Protocol):
    """Constant of a compiled form, which is an expression too."""

    value: Any

    def __getitem__(self, index: tuple[Expr, ...]) -> Expr: ...
    def __truediv__(self, other: float) -> Expr: ...
