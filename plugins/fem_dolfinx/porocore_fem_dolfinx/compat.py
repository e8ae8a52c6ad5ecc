"""Where the versions of dolfinx differ, from 0.5 (Debian 12) to 0.9 (Debian 13): one function for each difference.

Everything else in this plugin imports dolfinx through this module, so that h5py always comes first.
"""

from __future__ import annotations

import inspect
import logging
import re
import warnings
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import h5py  # noqa: F401 - dolfinx 0.5 loads its own HDF5 for every library that comes later; h5py must have found its own
import numpy as np

from porocore.errors import PluginError
from porocore_fem_dolfinx.form_cache import compiling, folder

try:
    import dolfinx
    import ufl
    from dolfinx import fem, mesh
except ImportError as error:
    raise PluginError(
        f"dolfinx is installed but cannot be imported ({error}); the dolfinx of Debian 12 needs numpy below 2: "
        "pip install 'numpy<2'"
    ) from error

import dolfinx.fem.petsc as fem_petsc  # an attribute in 0.5, a module of its own later
from petsc4py import PETSc

OLDEST, NEWEST = (0, 5), (0, 9)
VERSION = tuple(int(number) for number in re.findall(r"\d+", dolfinx.__version__)[:2])


def _check_version() -> None:
    if VERSION < OLDEST or not hasattr(fem, "Expression"):
        raise PluginError(
            f"dolfinx {dolfinx.__version__} is too old: porocore-fem-dolfinx works with "
            f"{_text(OLDEST)} (Debian 12) to {_text(NEWEST)} (Debian 13); install one of these"
        )
    if VERSION > NEWEST:
        raise PluginError(
            f"dolfinx {dolfinx.__version__} is newer than what porocore-fem-dolfinx was written for, "
            f"{_text(OLDEST)} (Debian 12) to {_text(NEWEST)} (Debian 13); install one of these"
        )
    if np.issubdtype(PETSc.ScalarType, np.complexfloating):
        raise PluginError(
            "this dolfinx uses complex numbers and porocore needs real ones; on Debian install "
            "python3-dolfinx-real and set PETSC_DIR to the real build, or remove python3-dolfinx-complex"
        )


def _text(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))


_check_version()
#: Where compiled forms are kept.
FORMS = folder(dolfinx.__version__)
#: Elements of basix.ufl instead of those of the old UFL.
MODERN = find_spec("basix.ufl") is not None and VERSION >= (0, 7)
# "Applying str() to a metadata value" for every quadrature rule of our own.
logging.getLogger("UFL").setLevel(logging.ERROR)
logging.getLogger("FFCx").setLevel(logging.ERROR)


@contextmanager
def quiet() -> Iterator[None]:
    """No lines of the C compiler's driver, which logs to the root logger, nor warnings about FFCx's own code."""
    root = logging.getLogger()
    before = root.level
    root.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.filterwarnings("ignore", r"Applying str\(\) to a metadata value")
            yield
    finally:
        root.setLevel(before)


def lagrange_element(cell: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """Of a scalar, vector or tensor field."""
    if MODERN:
        import basix.ufl

        return basix.ufl.element("Lagrange", cell, degree, shape=shape)
    if not shape:
        return ufl.FiniteElement("Lagrange", cell, degree)
    if len(shape) == 1:
        return ufl.VectorElement("Lagrange", cell, degree, dim=shape[0])
    return ufl.TensorElement("Lagrange", cell, degree, shape=shape)


def broken_element(cell: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """The same functions as :func:`lagrange_element`, not joined between cells."""
    if MODERN:
        import basix.ufl

        return basix.ufl.element("Lagrange", cell, degree, shape=shape, discontinuous=True)
    return (
        ufl.VectorElement("DG", cell, degree, dim=shape[0])
        if shape
        else ufl.FiniteElement("DG", cell, degree)
    )


def quadrature_points(cell: str, degree: int) -> Any:
    """(q, 3) points of the default rule of this degree, in the order of :func:`quadrature_element`."""
    import basix

    return basix.make_quadrature(getattr(basix.CellType, cell), degree)[0]


def quadrature_element(cell: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """Values at the points of the default rule of this degree."""
    if MODERN:
        import basix.ufl

        return basix.ufl.quadrature_element(cell, value_shape=shape, degree=degree)
    if not shape:
        return ufl.FiniteElement("Quadrature", cell, degree, quad_scheme="default")
    if len(shape) == 1:
        return ufl.VectorElement("Quadrature", cell, degree, dim=shape[0], quad_scheme="default")
    return ufl.TensorElement("Quadrature", cell, degree, shape=shape, quad_scheme="default")


# Degrees of the default rule on a tetrahedron with 1, 4 and 14 points, and of n x n x n products of Gauss-Jacobi rules.
_RULES_BY_SIZE = {1: (1, "default"), 4: (2, "default"), 14: (4, "default")} | {
    n**3: (2 * n - 2, "Gauss-Jacobi") for n in range(4, 8)
}


def values_at_points(points: Any, weights: Any, shape: tuple[int, ...] = ()) -> Any:
    """Element of values at points (q, 3) of the reference tetrahedron, for integrals with the rule of these points.

    Elements of the old UFL have the points of basix's own rules. FFCx never looks at them: a value belongs to the point
    of the same number in whatever rule the integral has, so one with as many points will do.
    """
    if MODERN:
        import basix.ufl

        # Copies: the bindings of 0.9 take no array that cannot be written.
        rule = {"points": np.array(points), "weights": np.array(weights)}
        return basix.ufl.quadrature_element("tetrahedron", value_shape=shape, **rule)
    degree, scheme = _RULES_BY_SIZE[len(points)]
    if not shape:
        return ufl.FiniteElement("Quadrature", "tetrahedron", degree, quad_scheme=scheme)
    return ufl.TensorElement("Quadrature", "tetrahedron", degree, shape=shape, quad_scheme=scheme)


def mixed_element(*elements: Any) -> Any:
    """Of several fields."""
    if MODERN:
        import basix.ufl

        return basix.ufl.mixed_element(list(elements))
    return ufl.MixedElement(*elements)


def _compile(comm: Any, make: Any, *arguments: Any) -> Any:
    """Call what compiles, or takes from our cache."""
    name = "jit_options" if "jit_options" in inspect.signature(make).parameters else "jit_params"
    with quiet(), compiling(FORMS, comm):
        return make(*arguments, **{name: {"cache_dir": str(FORMS)}})


def _comm_of(integrand: Any) -> Any:
    """The MPI communicator of the mesh that a UFL form (or list of forms) or expression lives on."""
    while isinstance(integrand, Sequence):
        integrand = next(part for part in integrand if part is not None)
    is_form = isinstance(integrand, ufl.Form)
    domain = integrand.ufl_domain() if is_form else ufl.domain.extract_unique_domain(integrand)
    return domain.ufl_cargo().comm


def function_space(domain: Any, element: Any) -> Any:
    """Of an element from this module."""
    make = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    return _compile(domain.comm, make, domain, element)


def make_mesh(comm: Any, cell: str, degree: int, points: Any, cells: Any, **options: Any) -> Any:
    """Lagrange cells of this degree in dolfinx's (not VTK's) order of nodes; see :func:`from_vtk`."""
    domain = ufl.Mesh(lagrange_element(cell, degree, (3,)))
    parameters = inspect.signature(mesh.create_mesh).parameters
    name = "domain" if "domain" in parameters else "e"
    with quiet():
        return mesh.create_mesh(
            comm, np.asarray(cells, dtype=np.int64), x=np.asarray(points), **{name: domain}, **options
        )


# Basix numbers a tetrahedron's edges from the last, and a hexahedron's corners as a tensor product.
_FROM_VTK = {
    ("tetrahedron", 4): (0, 1, 2, 3),
    ("tetrahedron", 10): (0, 1, 2, 3, 9, 8, 5, 7, 6, 4),
    ("hexahedron", 8): (0, 1, 3, 2, 4, 5, 7, 6),
    ("hexahedron", 27): (
        *(0, 1, 3, 2, 4, 5, 7, 6),
        *(8, 11, 16, 9, 17, 10, 19, 18, 12, 15, 13, 14),
        *(24, 22, 20, 21, 23, 25, 26),
    ),
}


def from_vtk(cell: str, nodes: int) -> Any:
    """Permutation p so that ``cells[:, p]`` of VTK's order is dolfinx's.

    dolfinx's own ``perm_vtk`` is the inverse of it in some versions and not in others.
    """
    return np.array(_FROM_VTK[cell, nodes])


def cell_dofs(dofmap: Any) -> Any:
    """(cells, n) of a function space's dofmap or a mesh's geometry dofmap, local numbers, ghosts included."""
    table = dofmap.list if hasattr(dofmap, "list") else dofmap
    if isinstance(table, np.ndarray):
        return table
    return table.array.reshape(table.num_nodes, -1)


def geometry_dofs(domain: Any) -> Any:
    """(cells, n) local nodes of the mesh."""
    return cell_dofs(domain.geometry.dofmap)


def constant(domain: Any, value: Any) -> Any:
    """Of a form; change ``.value`` later."""
    return fem.Constant(domain, np.asarray(value, dtype=np.float64))


def form(integrals: Any) -> Any:
    """Compile, or take from the cache."""
    return _compile(_comm_of(integrals), fem.form, integrals)


def expression(value: Any, points: Any) -> Any:
    """Compile a UFL expression for evaluation at points (q, 3) of the reference cell."""
    return _compile(_comm_of(value), fem.Expression, value, np.asarray(points))


def evaluate(compiled: Any, domain: Any, cells: Any) -> Any:
    """Values (cells, points · components) of an :func:`expression`."""
    cells = np.asarray(cells, dtype=np.int32)
    if "mesh" in inspect.signature(compiled.eval).parameters:
        return compiled.eval(domain, cells).reshape(len(cells), -1)
    return compiled.eval(cells).reshape(len(cells), -1)


def vector_of(function: Any) -> Any:
    """A function's values as a PETSc vector that shares its memory."""
    return function.vector if hasattr(function, "vector") else function.x.petsc_vec


def freed_with(owner: Any, item: Any) -> Any:
    """Return a PETSc object that is destroyed as soon as its owner is gone.

    Python alone does not free it: petsc4py keeps what Python lets go of until PETSc collects its garbage, which it
    does for one communicator at a time, and that of a mesh may be gone by then. Where several processes share the
    object, its owner must be let go of on all of them together.
    """
    weakref.finalize(owner, item.destroy)
    return item


def collect_garbage(comm: Any) -> None:
    """Free the PETSc objects of a communicator that Python has let go of; all its processes call this together."""
    if hasattr(PETSc, "garbage_cleanup"):
        PETSc.garbage_cleanup(comm)


def assemble_vector(compiled: Any) -> Any:
    """A linear form on one process, as a new array."""
    vector = fem_petsc.assemble_vector(compiled)
    values = vector.array.copy()
    vector.destroy()
    return values


def assemble_matrix(compiled: Any, matrix: Any = None) -> Any:
    """A bilinear form as a PETSc matrix, into ``matrix`` if it was made by this function before."""
    if matrix is None:
        matrix = fem_petsc.assemble_matrix(compiled)
    else:
        matrix.zeroEntries()
        fem_petsc.assemble_matrix(matrix, compiled)
    matrix.assemble()
    return matrix


def block_matrix(blocks: Any) -> Any:
    """An empty PETSc matrix for a list of lists of bilinear forms; on each process the first rows come first."""
    return fem_petsc.create_matrix_block(blocks)


def assemble_blocks(blocks: Any, matrix: Any) -> None:
    """Anew into what :func:`block_matrix` made."""
    matrix.zeroEntries()
    fem_petsc.assemble_matrix_block(matrix, blocks, bcs=[])
    matrix.assemble()
