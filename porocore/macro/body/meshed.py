"""The mesh of a problem: its body's, with the names that the problem gives to parts of its surface."""

from __future__ import annotations

from porocore.macro.body.kinds import make_body
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.surfaces import with_patches
from porocore.macro.problem import MacroSetup


def body_mesh(problem: MacroSetup) -> BodyMesh:
    """Mesh of ``problem``.

    Raises
    ------
    ConfigurationError
        The body cannot be meshed, or a patch of its surface is of no surface.
    """
    return with_patches(make_body(problem.body), problem.surfaces)
