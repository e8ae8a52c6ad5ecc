"""Versions of porocore, its plugins and packages that results depend on."""

from __future__ import annotations

import platform
from importlib import metadata
from typing import Any

_PACKAGES = (
    "numpy",
    "scipy",
    "h5py",
    "gmsh",
    "scikit-fem",
    "mkl",
    "fenics-dolfinx",
    "petsc4py",
    "torch",
    "jax",
)


def versions() -> dict[str, str]:
    """Return the versions of porocore, its plugins and the packages that results depend on, without importing them."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    names = {*_PACKAGES, *(d.name for d in metadata.distributions() if _is_plugin(d))}
    for name in sorted(names):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _is_plugin(distribution: Any) -> bool:
    return any(entry_point.group == "porocore" for entry_point in distribution.entry_points)
