"""Bodies from mesh files and geometries."""

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import Facets, boundary_facets
from porocore.macro.body.mesh_file import read_body
from porocore.macro.problem import MacroProblem
from porocore.testing.macro_checks.bodies import write_tetrahedra


@pytest.mark.parametrize("suffix", [".msh", ".vtu"])
def test_a_mesh_file_gives_the_body(tmp_path, suffix):
    """Linear tetrahedra become quadratic with straight edges; a .vtu has tags for names."""
    import meshio

    write_tetrahedra(tmp_path / "box.msh", Box(size=(1, 2, 3), elements=(2, 1, 2)), bend=0.03)
    path = tmp_path / f"body{suffix}"
    mesh = meshio.read(tmp_path / "box.msh")
    if suffix == ".vtu":
        tags = [data.astype(int) for data in mesh.cell_data["gmsh:physical"]]
        meshio.write(path, meshio.Mesh(mesh.points, mesh.cells, cell_data={"surface": tags}))
    else:
        path = tmp_path / "box.msh"
    body = read_body(path, None, 2.0)
    names = {"x-", "x+", "y-", "y+", "z-", "z+"} if suffix == ".msh" else {str(n) for n in range(10, 16)}
    assert set(body.surfaces) == names
    assert body.cells.shape == (24, 10)
    assert body.straight
    assert body.weights.sum() == pytest.approx(8 * 6, rel=1e-12)
    assert sum(map(len, body.surfaces.values())) == len(boundary_facets(body.cells))


def test_a_geometry_is_meshed_by_gmsh_with_its_names(tmp_path):
    path = tmp_path / "drum.geo"
    path.write_text(
        'SetFactory("OpenCASCADE");\nCylinder(1) = {0, 0, 0, 0, 1, 0, 0.5};\nPhysical Volume("body") = {1};\n'
        'Physical Surface("mantle") = {1};\nPhysical Surface("lids") = {2, 3};\n'
        'Print.Background = 0;\nPrintf("made");\nIf (1 >= 0)\nPrintf("so");\nEndIf\n',
        encoding="utf-8",
    )
    body = read_body(path, 0.3, 1.0)
    assert body.cells.shape[1] == 10
    assert not body.straight
    assert body.weights.sum() == pytest.approx(np.pi / 4, rel=2e-3)
    area = {name: Facets(body, facets).areas.sum() for name, facets in body.surfaces.items()}
    assert area["mantle"] == pytest.approx(np.pi, rel=2e-3)
    assert area["lids"] == pytest.approx(np.pi / 2, rel=2e-3)


def test_what_is_near_in_a_body_from_a_file_is_near_in_memory(tmp_path):
    """Nodes in any order, as meshing programs leave them; named surfaces and volumes follow."""
    import meshio

    write_tetrahedra(tmp_path / "box.msh", Box(size=(1, 1, 1), elements=(6, 6, 6)))
    mesh = meshio.read(tmp_path / "box.msh")
    shuffled = np.random.default_rng(0).permutation(len(mesh.points))
    place = np.argsort(shuffled)
    for block in mesh.cells:
        block.data = place[block.data]
    mesh.points = mesh.points[shuffled]
    mesh.write(tmp_path / "shuffled.msh", file_format="gmsh22")
    bodies = [read_body(tmp_path / name, None, 1.0) for name in ("box.msh", "shuffled.msh")]
    for body in bodies:
        assert np.median(np.ptp(body.cells, axis=1)) < len(body.points) / 6  # 5 of 6 at random
        assert body.weights.sum() == pytest.approx(1, rel=1e-12)
        np.testing.assert_array_equal(body.points[body.surfaces["x+"], 0], 1)
        inside = [np.ptp(body.centres[own], axis=0) for own in body.volumes.values()]
        np.testing.assert_allclose(inside, [np.ptp(body.centres, axis=0)], rtol=1e-12)


def test_files_that_are_no_body_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="no such file"):
        read_body(tmp_path / "none.msh", None, 1.0)
    broken = tmp_path / "broken.msh"
    broken.write_text("$MeshFormat\n4.1 0 8\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"broken\.msh"):
        read_body(broken, None, 1.0)
    geometry = tmp_path / "drum.geo"
    geometry.write_text("Point(1) = {0, 0, 0};\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"macro\.body\.size: missing"):
        read_body(geometry, None, 1.0)


def test_a_body_from_a_file_counts_by_its_content_and_not_by_where_it_lies(tmp_path):
    def specification(folder, elements):
        folder.mkdir()
        write_tetrahedra(folder / "box.msh", Box(size=(1, 1, 1), elements=elements))
        body = {"kind": "file", "path": str(folder / "box.msh")}
        return MacroProblem.model_validate({"body": body, "boundary": {}}).specification()

    here = specification(tmp_path / "here", (1, 1, 1))
    assert specification(tmp_path / "there", (1, 1, 1)) == here
    assert specification(tmp_path / "other", (2, 1, 1)) != here
    assert str(tmp_path) not in str(here)
