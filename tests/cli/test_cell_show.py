"""``porocore cell show``: what it prints and writes, and how it refuses."""

import json
import sys

import meshio
import numpy as np
import pytest
import yaml

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.quality import measure_mesh_quality, quality_lines
from porocore.cli import main

COARSE = MeshSettings(size=0.25, fluid_size=0.25, element="linear")


@pytest.fixture
def show(monkeypatch, capsys, tmp_path):
    """Run the command for a file that holds a cell alone: status, standard output, standard error."""

    def run(geometry, *words):
        study = {"cell": {"geometry": geometry, "mesh": COARSE.model_dump()}}
        (tmp_path / "study.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
        words = ["cell", "show", str(tmp_path / "study.yaml"), "--out", str(tmp_path / "out"), *words]
        monkeypatch.setattr(sys, "argv", ["porocore", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return run


def test_facts_and_files_of_an_image_beside_the_configuration(show, tmp_path):
    x = (np.arange(6) + 0.5) / 12
    pores = np.add.outer(np.add.outer(0 * x, x**2), x**2) < 0.25**2  # one channel along x
    np.save(tmp_path / "pores.npy", pores)
    geometry = {"kind": "voxels", "path": "pores.npy", "pore": 1}
    code, out, err = show(geometry, "--no-pictures")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "geometry: image pores.npy of 6³ voxels, mirror"
    assert "fluid, one piece: runs through in one direction only, along x" in lines
    assert "solid, one piece: runs through in every direction" in lines
    assert "K = 0 along y, z: of the fluid it does not run through there" in lines
    assert "opposite faces: every facet has its partner" in lines
    for path, phase in zip(lines[-2:], ("solid", "fluid"), strict=True):
        assert path == str(tmp_path / "out" / f"study_{phase}.vtu")
        assert "region" in meshio.read(path).cell_data
    code, out, err = show(geometry, "--no-pictures", "--json")
    found = json.loads(out)
    assert found["blocked"] == "yz"
    assert found["porosity"] == pytest.approx(pores.mean())
    assert found["fluid"]["share"] == pytest.approx(found["porosity"], abs=0.05)
    (piece,) = found["fluid"]["pieces"]
    assert np.hypot(*piece.pop("inside")[1:]) < 0.25
    assert piece == pytest.approx({"volume": found["fluid"]["share"], "rank": 1, "axes": "x"})


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ({"kind": "voxels", "path": "nowhere.npy"}, "nowhere.npy: no such file"),
        (
            {"kind": "tpms", "surface": "gyroid", "level": 3},
            "cell.geometry: expected a level between -1.5 and 1.5",
        ),
        (
            {"radii": [0.1, 0.2]},
            "cell.geometry.radii: expected a list of 3 entries (along x, y and z), got [0.1, 0.2]",
        ),
        (
            {"kind": "sphere-pores", "centres": [[0, 0]], "radius": 0.3},
            "cell.geometry.centres.0: expected a list of 3 entries (along x, y and z), got [0, 0]",
        ),
        ({"kind": "gyroid"}, "cell.geometry.kind: expected one of orthogonal-channels, "),
    ],
)
def test_errors_name_file_line_and_key(show, tmp_path, geometry, message):
    code, out, err = show(geometry)
    assert (code, out) == (2, "")
    assert f"{tmp_path / 'study.yaml'}:" in err
    assert message in err
    assert not (tmp_path / "out").exists()


def test_a_loose_solid_is_told_and_not_refused():
    cell = Cell(geometry={"kind": "tpms", "surface": "schwarz-p", "level": 1.5}, mesh=COARSE)
    quality = measure_mesh_quality(cell)
    assert "solid, one piece: closed in itself, reaches no other cell" in quality_lines(quality)
    assert any(
        line.startswith("the solid has no stiffness: it does not reach") for line in quality_lines(quality)
    )
    assert quality.blocked == ""


def test_without_pores_there_is_no_fluid_to_describe():
    lines = quality_lines(measure_mesh_quality(Cell(geometry={"kind": "no-pores"}, mesh=COARSE)))
    assert "fluid: none" in lines
    assert "K = 0 along x, y, z: of the fluid there is none there" in lines


@pytest.mark.slow
def test_a_picture_is_drawn(show, tmp_path):
    pytest.importorskip("pyvista")
    code, out, _ = show({"kind": "tpms", "surface": "gyroid", "level": 0.0})
    assert code == 0
    picture = tmp_path / "out" / "study.png"
    assert out.splitlines()[-1] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_without_pyvista_the_files_are_written_and_the_message_tells_what_to_install(
    show, tmp_path, monkeypatch
):
    from porocore.commands.fields import pictures

    monkeypatch.setattr(pictures, "find_spec", lambda name: None)
    code, _, err = show({"kind": "no-pores"})
    assert code == 2
    assert "pip install pyvista" in err
    assert (tmp_path / "out" / "study_solid.vtu").exists()
    assert not (tmp_path / "out" / "study.png").exists()


def test_tetrahedra_are_counted_in_the_whole_cell_and_in_an_eighth():
    cell = Cell(mesh=COARSE)
    whole, eighth = (len(cell.make_mesh("solid", part).cells) for part in ("whole", "eighth"))
    assert whole == 8 * eighth
    told = f"solid: {whole:,} tetrahedra in the whole cell ({eighth:,} in an eighth), "
    assert [line for line in quality_lines(measure_mesh_quality(cell)) if line.startswith(told)]
