"""Differences between dolfinx 0.5 (Debian 12) and 0.11: meshes, spaces, forms, assembly.

Elements, which differ too, have a module of their own.
"""

from __future__ import annotations

import atexit
import inspect
import logging
import warnings
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np

from porocore.states import Array, IntArray
from porocore_fem_dolfinx.elements import coordinate_element
from porocore_fem_dolfinx.form_cache import compiling, folder
from porocore_fem_dolfinx.library import PETSc, dolfinx, fem, fem_petsc, mesh, ufl
from porocore_fem_dolfinx.types import (
    CompiledExpression,
    CompiledForm,
    Constant,
    Element,
    Expr,
    Form,
    Function,
    FunctionSpace,
    Mesh,
)

if TYPE_CHECKING:
    from mpi4py import MPI

Made = TypeVar("Made")
#: Where compiled forms are kept.
FORMS = folder(dolfinx.__version__)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress all logs but errors, such as that of the C compiler's driver, and warnings about FFCx's own code.

    The driver sets the level of the root logger itself, so that a level set here would not last.
    """
    root = logging.getLogger()
    before, disabled = root.level, root.manager.disable
    logging.disable(max(disabled, logging.WARNING))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.filterwarnings("ignore", r"Applying str\(\) to a metadata value")
            yield
    finally:
        logging.disable(disabled)
        root.setLevel(before)


def _compile(comm: MPI.Intracomm, make: Callable[..., Made], *arguments: object) -> Made:
    """Call a function that compiles forms or takes them from our cache."""
    names = {"jit_options", "jit_params"} & set(inspect.signature(make).parameters)
    with quiet(), compiling(FORMS, comm):
        return make(*arguments, **{name: {"cache_dir": str(FORMS)} for name in names})


def _comm_of(integrand: Expr) -> MPI.Intracomm:
    """Return the communicator of the mesh of a UFL expression, a form or a list of forms."""
    while isinstance(integrand, Sequence):
        integrand = next(part for part in integrand if part is not None)
    is_form = isinstance(integrand, ufl.Form)
    domain = integrand.ufl_domain() if is_form else ufl.domain.extract_unique_domain(integrand)
    comm: MPI.Intracomm = domain.ufl_cargo().comm
    return comm


def function_space(domain: Mesh, element: Element) -> FunctionSpace:
    """Return the function space of an element."""
    make = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    space: FunctionSpace = _compile(domain.comm, make, domain, element)
    return space


def make_mesh(comm: MPI.Intracomm, cell: str, degree: int, points: Array, cells: IntArray) -> Mesh:
    """Return a mesh of Lagrange cells at points (n, 3) or (n, 2), their nodes in dolfinx's (not VTK's) order.

    See :func:`from_vtk`.
    """
    domain = ufl.Mesh(coordinate_element(cell, degree, np.shape(points)[1]))
    parameters = inspect.signature(mesh.create_mesh).parameters
    name = "domain" if "domain" in parameters else "e"
    with quiet():
        made: Mesh = mesh.create_mesh(
            comm, np.asarray(cells, dtype=np.int64), x=np.asarray(points), **{name: domain}
        )
    return made


# Basix numbers a tetrahedron's edges from the last, and a hexahedron's corners as a tensor product.
_FROM_VTK = {
    ("tetrahedron", 4): (0, 1, 2, 3),
    ("tetrahedron", 10): (0, 1, 2, 3, 9, 8, 5, 7, 6, 4),
    ("triangle", 3): (0, 1, 2),
    ("triangle", 6): (0, 1, 2, 4, 5, 3),
    ("quadrilateral", 4): (0, 1, 3, 2),
    ("quadrilateral", 9): (0, 1, 3, 2, 4, 7, 5, 6, 8),
    ("hexahedron", 8): (0, 1, 3, 2, 4, 5, 7, 6),
    ("hexahedron", 27): (
        *(0, 1, 3, 2, 4, 5, 7, 6),
        *(8, 11, 16, 9, 17, 10, 19, 18, 12, 15, 13, 14),
        *(24, 22, 20, 21, 23, 25, 26),
    ),
}


def from_vtk(cell: str, nodes: int) -> IntArray:
    """Return the permutation p by which ``cells[:, p]`` is in dolfinx's order if ``cells`` is in VTK's.

    dolfinx's own ``perm_vtk`` is the inverse of it in some versions and not in others.
    """
    return np.array(_FROM_VTK[cell, nodes])


def cell_dofs(dofmap: fem.DofMap) -> IntArray:
    """Return the table (cells, n) of a space's dofmap, local numbers, ghosts included."""
    table = dofmap.list if hasattr(dofmap, "list") else dofmap
    return np.asarray(table if isinstance(table, np.ndarray) else table.array.reshape(table.num_nodes, -1))


def cell_nodes(domain: Mesh) -> IntArray:
    """Return the table (cells, n) of the nodes of a mesh, local numbers, ghosts included."""
    by_kind = getattr(domain.geometry, "dofmaps", None)  # one for each kind of cell
    return cell_dofs(by_kind[0] if isinstance(by_kind, list) else domain.geometry.dofmap)


def constant(domain: Mesh, value: Array | float) -> Constant:
    """Return a constant for forms, whose ``value`` may change without compilation."""
    made: Constant = fem.Constant(domain, np.asarray(value, dtype=np.float64))
    return made


def make_function(space: FunctionSpace) -> Function:
    """Return a function of a space, zero so far."""
    made: Function = fem.Function(space)
    return made


@overload
def form(integrals: list[list[Form]]) -> list[list[CompiledForm]]: ...
@overload
def form(integrals: Form) -> CompiledForm: ...
def form(integrals: Form | list[list[Form]]) -> CompiledForm:
    """Return a form, or lists of forms, compiled or taken from the cache."""
    return _compile(_comm_of(integrals), fem.form, integrals)


def expression(value: Expr, points: Array) -> CompiledExpression:
    """Return a UFL expression compiled for points (q, 3) of the reference cell."""
    compiled: CompiledExpression = _compile(_comm_of(value), fem.Expression, value, np.asarray(points))
    return compiled


def evaluate(compiled: CompiledExpression, domain: Mesh, cells: IntArray) -> Array:
    """Return the values (cells, points · components) of an :func:`expression`."""
    local = np.asarray(cells, dtype=np.int32)
    if "mesh" in inspect.signature(compiled.eval).parameters:
        return compiled.eval(domain, local).reshape(len(local), -1)
    return compiled.eval(local).reshape(len(local), -1)


def vector_of(function: Function) -> PETSc.Vec:
    """Return a PETSc vector that shares the memory of a function's values."""
    return function.vector if hasattr(function, "vector") else function.x.petsc_vec


def freed_with(owner: object, item: PETSc.Object) -> PETSc.Object:
    """Return a PETSc object, or a solver that holds some, to be destroyed as soon as its owner is gone.

    Python alone does not free it: petsc4py keeps what Python lets go of until PETSc collects its garbage, which it
    does for one communicator at a time, and that of a mesh may be gone by then. Where several processes share the
    object, its owner must be let go of on all of them together.
    """
    weakref.finalize(owner, item.destroy)
    return item


#: Solvers that call Python, as long as they are there.
_calling_python: list[weakref.ref[PETSc.KSP]] = []


def freed_before_python(solver: PETSc.KSP) -> PETSc.KSP:
    """Return a solver that calls Python, to be destroyed before Python ends.

    PETSc ends later than Python does. What several processes share it destroys only then, if it is there until the end,
    and a call of Python would be a segmentation violation.
    """
    _calling_python[:] = [one for one in _calling_python if one() is not None] + [weakref.ref(solver)]
    return solver


@atexit.register
def _free_before_python() -> None:
    for one in _calling_python:
        solver = one()
        if solver is not None:
            solver.destroy()


def collect_garbage(comm: MPI.Intracomm) -> None:
    """Free the PETSc objects of a communicator that Python has let go of; all its processes call this together."""
    if hasattr(PETSc, "garbage_cleanup"):
        PETSc.garbage_cleanup(comm)


def assemble_vector(compiled: CompiledForm) -> Array:
    """Return a linear form, assembled on one process, as a new array."""
    vector = fem_petsc.assemble_vector(compiled)
    values: Array = vector.array.copy()
    vector.destroy()
    return values


def assemble_matrix(compiled: CompiledForm, matrix: PETSc.Mat | None = None) -> PETSc.Mat:
    """Return a bilinear form, assembled into ``matrix`` if that was made by this function before."""
    if matrix is None:
        matrix = fem_petsc.assemble_matrix(compiled)
    else:
        matrix.zeroEntries()
        fem_petsc.assemble_matrix(matrix, compiled)
    matrix.assemble()
    return matrix


def make_matrix(
    comm: MPI.Intracomm, sizes: tuple[Any, Any], indptr: IntArray, indices: IntArray, data: Array
) -> PETSc.Mat:
    """Return a PETSc matrix of the rows of this process, given in CSR; ``sizes`` are as createAIJ takes them."""
    csr = (indptr.astype(PETSc.IntType), indices.astype(PETSc.IntType), data)
    matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
    matrix.assemble()
    return matrix


def block_matrix(blocks: CompiledForm) -> PETSc.Mat:
    """Return an empty matrix for a list of lists of bilinear forms; each process has the first rows first."""
    make = getattr(fem_petsc, "create_matrix_block", None) or fem_petsc.create_matrix
    return make(blocks)


def assemble_blocks(blocks: CompiledForm, matrix: PETSc.Mat) -> None:
    """Assemble into a matrix of :func:`block_matrix`."""
    matrix.zeroEntries()
    assemble = getattr(fem_petsc, "assemble_matrix_block", None) or fem_petsc.assemble_matrix
    assemble(matrix, blocks, bcs=[])
    matrix.assemble()
