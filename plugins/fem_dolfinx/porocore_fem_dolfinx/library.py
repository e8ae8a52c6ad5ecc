"""Import of dolfinx after h5py, and the check of its version and of its kind of numbers.

Other modules take dolfinx from here, so that h5py always comes first.
"""

from __future__ import annotations

import logging
import re
from importlib.util import find_spec

import h5py  # noqa: F401 - dolfinx 0.5 loads its own HDF5 for every library that comes later; h5py must have found its own
import numpy as np

from porocore.core.parallel.memory import return_freed_memory
from porocore.errors import PluginError

try:
    import basix
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

__all__ = ["MODERN", "PETSc", "basix", "dolfinx", "fem", "fem_petsc", "mesh", "ufl"]

OLDEST, NEWEST = (0, 5), (0, 11)
#: These versions as messages name them.
SUPPORTED = "0.5 (Debian 12) to 0.11"
VERSION = tuple(int(number) for number in re.findall(r"\d+", dolfinx.__version__)[:2])


def _check_version() -> None:
    if VERSION < OLDEST or not hasattr(fem, "Expression"):
        raise PluginError(
            f"dolfinx {dolfinx.__version__} is too old: porocore-fem-dolfinx works with {SUPPORTED}; "
            "install one of these"
        )
    if VERSION > NEWEST:
        raise PluginError(
            f"dolfinx {dolfinx.__version__} is newer than what porocore-fem-dolfinx was written for, {SUPPORTED}; "
            "install one of these"
        )
    if np.issubdtype(PETSc.ScalarType, np.complexfloating):
        raise PluginError(
            "this dolfinx uses complex numbers and porocore needs real ones; on Debian install "
            "python3-dolfinx-real and set PETSC_DIR to the real build, or remove python3-dolfinx-complex"
        )


_check_version()
return_freed_memory()  # PETSc's libraries have forbidden it
#: Elements of basix.ufl instead of those of the old UFL.
MODERN = find_spec("basix.ufl") is not None and VERSION >= (0, 7)
if MODERN:
    import basix.ufl
# "Applying str() to a metadata value" for every quadrature rule of our own.
logging.getLogger("UFL").setLevel(logging.ERROR)
logging.getLogger("FFCx").setLevel(logging.ERROR)
