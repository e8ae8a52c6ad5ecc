"""A quarter of a disc in the plane, the meridian of half a ball, as a geometry or a mesh of quadrilaterals."""

from __future__ import annotations

from pathlib import Path

DOME = """SetFactory("OpenCASCADE");
Point(1) = {0, 0, 0};
Point(2) = {0.5, 0, 0};
Point(3) = {0, 0.5, 0};
Line(1) = {1, 2};
Circle(2) = {2, 1, 3};
Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1};
Physical Curve("base") = {1};
Physical Curve("dome") = {2};
Physical Curve("axis") = {3};
Physical Surface("body") = {1};
"""


def write_dome(folder: Path, quadrilaterals: int = 0) -> Path:
    """Write the geometry, or the mesh with quadrilaterals of an order, and return its path."""
    path = folder / "dome.geo"
    path.write_text(DOME, encoding="utf-8")
    if not quadrilaterals:
        return path
    from porocore.core.files.gmsh_model import gmsh_session

    with gmsh_session() as gmsh:
        gmsh.open(str(path))
        for name, value in (("MeshSizeMax", 0.12), ("RecombineAll", 1), ("RecombinationAlgorithm", 2)):
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(quadrilaterals)
        gmsh.write(str(path.with_suffix(".msh")))
    return path.with_suffix(".msh")
