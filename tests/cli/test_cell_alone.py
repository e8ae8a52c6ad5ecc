"""``porocore cell`` and ``porocore check`` on files that describe cells and no study."""

import json
import math
from dataclasses import fields

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from porocore import CellProblem
from porocore.macro.laws.linear import PROPERTIES, EffectiveProperties
from tests.helpers.invoked import BENCHMARK, invoke, refusal

MESH = {"size": 0.5, "fluid_size": 0.5}
CHANNELS = {"geometry": {"kind": "orthogonal-channels", "radius": 0.25}, "mesh": MESH}
SCALES = {"modulus": "12 kPa", "pore": "40 um"}
UNITS = {"length": "mm", "stress": "MPa", "time": "min"}


@pytest.fixture
def written(tmp_path):
    """Write sections into a file, and return its path."""

    def write(**sections):
        path = tmp_path / "scan.yaml"
        path.write_text(yaml.safe_dump(sections), encoding="utf-8")
        return path

    return write


def printed(*words):
    done = invoke(*words)
    assert done.exception is None, done.output
    return done.stdout


def rows(text):
    """Name and value of each row of the table."""
    return {
        name: value.strip()
        for name, _, value in (line.partition("  ") for line in text.splitlines())
        if value
    }


def test_a_cell_alone_has_the_table_of_the_report_in_the_units_of_its_scales(written):
    """K had a unit, k none, and there were no moduli; a dummy study was needed for them."""
    cell = CHANNELS | {"viscosity": "0.9 mPa s"}
    path = written(cell=cell, scales=SCALES, output_units=UNITS)
    text = printed("cell", path)
    found, plain = rows(text), CellProblem(CHANNELS, store=False).properties
    E = plain.young_moduli[0] * 0.012
    assert found["drained Young's modulus E₁ = E₂ = E₃"] == f"{E:.4g} MPa"
    k = plain.permeability[0, 0] * (40e-6) ** 2
    mantissa, power = f"{k:.3e}".split("e")
    superscript = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    assert found["permeability k₁₁ = k₂₂ = k₃₃"] == f"{mantissa} · 10{superscript} m²"
    assert float(found["Poisson's ratio ν"]) == pytest.approx(plain.poisson_ratios[0, 1], rel=1e-3)
    K = found["conductivity K₁₁ = K₂₂ = K₃₃ at μ_f = 0.0009 Pa s"]
    assert float(K.split()[0]) == pytest.approx(k / 0.9e-3 * 1e6 * 1e6 * 60, rel=1e-3)
    assert K.split()[1:3] == ["mm²/(MPa", "min)"]
    assert K.endswith(" m⁴/(N s)")
    c_v = 12e3 * k / 0.9e-3 / (plain.storage + plain.biot_tensor[0, 0] ** 2 / plain.confined_moduli[0])
    assert float(found["consolidation coefficient c_v along each axis"].split()[0]) == pytest.approx(
        c_v * 1e6 * 60, rel=1e-3
    )
    assert "drained stiffness C_eff [MPa], axes 11, 22, 33, 23, 13, 12" in text
    assert "stiffness: cubic to 0.1 %; point group m-3m" in text
    assert "dimensionless" not in text


def test_json_has_all_digits_with_units(written):
    cell = CHANNELS | {"viscosity": "0.9 mPa s"}
    done = json.loads(printed("cell", written(cell=cell, scales=SCALES, output_units=UNITS), "--json"))
    told, plain = done["properties"], CellProblem(CHANNELS, store=False).properties
    assert set(told) == set(PROPERTIES) == {field.name for field in fields(EffectiveProperties)}
    assert all("unit" in each for each in told.values())
    assert_allclose(told["stiffness_voigt"]["value"], plain.stiffness_voigt * 0.012, rtol=1e-12, atol=1e-12)
    assert told["stiffness_voigt"]["unit"] == "MPa"
    assert_allclose(told["biot_tensor"]["value"], plain.biot_tensor, atol=1e-12)
    assert told["biot_modulus"]["value"] == pytest.approx(plain.biot_modulus * 0.012, rel=1e-12)
    assert told["poisson_ratios"]["value"][1][1] is None
    assert told["consolidation_coefficients"]["unit"] == "mm²/min"


def test_without_scales_every_number_says_what_it_is_a_multiple_of(written):
    text = printed("cell", written(cell=CHANNELS))
    found = rows(text)
    pure = ("porosity", "Poisson's ratio", "anisotropy ratio", "Biot coefficient")
    for name, value in found.items():
        if name and not name.startswith(pure) and "· " not in name:
            assert value.split()[-1] in {"E", "1/E", "d²", "d²/μ_c"} or value.endswith("E d²/μ_c"), (
                name,
                value,
            )
    assert "dimensionless: multiples of E" in text
    assert found["drained Young's modulus E₁ = E₂ = E₃"] == "0.3915 E"
    deformed = printed("cell", written(cell=CHANNELS), "--at", "H22=-0.05")
    assert "stress [E]:" in deformed.splitlines()
    assert "dimensionless: multiples of E" in deformed


def test_an_image_with_the_size_of_its_voxels_has_a_permeability_in_metres(written, tmp_path):
    i = np.indices((12, 12, 12)).astype(float) - 5.5
    np.save(tmp_path / "bore.npy", (np.hypot(i[0], i[1]) < 3.5).astype(np.uint8))
    geometry = {"kind": "voxels", "path": "bore.npy", "pore": 1, "voxel_size": "2 um"}
    path = written(cell={"geometry": geometry, "mesh": {"size": 0.2, "fluid_size": 0.1}})
    text, done = printed("cell", path), json.loads(printed("cell", path, "--json"))
    k = done["properties"]["permeability"]
    assert k["unit"] == "m²"
    # By Poiseuille of the channel that has the porosity of the mesh.
    area = done["properties"]["porosity"]["value"] * (24e-6) ** 2
    assert k["value"][2][2] == pytest.approx(area**2 / (8 * math.pi) / (24e-6) ** 2, rel=0.02)
    assert "edges of the cell: 48 x 48 x 48 µm" in text  # with its mirror images
    assert rows(text)["permeability k₁₁"] == "0"
    assert " m² = " in rows(text)["permeability k₃₃"]
    assert "note: the pores do not run through the cell along x, y; K and k there are 0" in text


def test_a_solid_that_is_not_connected_has_a_permeability_and_no_moduli(written):
    path = written(cell={"geometry": {"kind": "cylinder-array", "radius": 0.3}, "mesh": MESH})
    text, done = printed("cell", path), json.loads(printed("cell", path, "--json"))
    assert "note: the solid is not connected, so it has no stiffness: its cylinders do not touch" in text
    assert rows(text)["permeability k₃₃"].endswith("d²")
    assert "modulus E₁" not in text
    assert done["properties"]["young_moduli"]["dimensionless"] == [None] * 3
    assert done["properties"]["permeability"]["dimensionless"][2][2] > 0


def test_closed_pores_are_told(written):
    spheres = {"kind": "sphere-pores", "lattice": "cubic", "radius": 0.3, "throat": 0}
    text = printed("cell", written(cell={"geometry": spheres, "mesh": MESH}))
    assert rows(text)["permeability k₁₁ = k₂₂ = k₃₃"] == "0"
    assert "note: closed pores: their fluid bears the same pressure p" in text


def test_a_solid_that_swells_has_its_stress_and_the_moduli_there(written):
    """Every closure but that of the default is right for it, and no law is asked for."""
    material = {"kind": "neo-hookean", "poisson_ratio": 0.35, "swelling": 1.02}
    path = written(cell=CHANNELS | {"material": material})
    text, done = printed("cell", path), json.loads(printed("cell", path, "--json"))
    held = done["properties"]["held_stress"]["dimensionless"]
    assert held == done["stress"]
    assert held[0][0] < -0.01
    assert "porosity φ_f of the mesh, before the solid swells" in text
    assert f"{held[0][0]:.4g} E".replace("-", "−") in text
    assert "note: the solid swells: moduli, α, M_B and c_v are those of small changes" in text
    assert "stress while the swelling is held" in printed("check", path)


def test_a_cell_without_pores_has_moduli_alone(written):
    path = written(cell={"geometry": {"kind": "no-pores"}, "mesh": MESH})
    text = printed("cell", path)
    found = rows(text)
    assert found["drained Young's modulus E₁ = E₂ = E₃"] == "1.000 E"
    assert found["porosity φ_f of the mesh"] == found["permeability k₁₁ = k₂₂ = k₃₃"] == "0"
    assert not {"Biot modulus M_B", "storage 1/M_B"} & found.keys()
    assert "Biot" not in printed("check", path)


def test_a_family_asks_which_member_and_says_it(written):
    channels = {"kind": "orthogonal-channels", "radius": {"range": [0.2, 0.3]}}
    path = written(cell={"geometry": channels, "mesh": MESH})
    assert "give its value with --parameters radius=0.25" in refusal("cell", path)
    assert printed("cell", path, "--parameters", "radius=0.22").startswith("member: radius=0.22\n")
    told = printed("check", path)
    assert "a family of cells: radius 0.2 to 0.3; meshes, pores and moduli are those of the middle" in told
    assert "at rest, drained, in the middle of the ranges:" in told


def test_several_cells_are_told_apart(written):
    channels = {"kind": "orthogonal-channels", "radius": 0.3}
    cells = {"soft": {"geometry": channels, "mesh": MESH}, "stiff": CHANNELS}
    path = written(cells=cells)
    assert refusal("cell", path).endswith("cells: expected the name of a cell with --cell: soft and stiff")
    assert "--cell: there is no cell 'stif'; did you mean 'stiff'?" in refusal("cell", path, "--cell", "stif")
    text = printed("cell", path, "--cell", "soft")
    assert text.startswith("cell: of 'cells.soft:'; the file has others, too: --cell stiff\n")
    assert "radius 0.3" in text
    told = printed("check", path)
    assert "cell soft at rest, drained:" in told
    assert "cell stiff at rest, drained:" in told
    assert f"next: porocore cell {path} --cell soft" in told
    both = written(cell=CHANNELS, cells={"soft": cells["soft"]})
    assert printed("cell", both).startswith("cell: of 'cell:'; the file has others, too: --cell soft\n")
    words = refusal("cell", BENCHMARK, "--cell", "soft")
    assert words.endswith("--cell: there is no cell 'soft'; the file has no 'cells:'; leave it out")


def test_check_outlines_a_cell_alone_and_says_what_a_run_needs(written):
    """It refused the file: sampling and macro were missing."""
    told = printed("check", written(cell=CHANNELS | {"viscosity": "1 mPa s"}, scales=SCALES))
    for words in (
        "a cell without a study",
        "cell: geometry: orthogonal channels of radius 0.25 along x, y, z",
        "edges of the cell: 40 x 40 x 40 µm",
        "s for the state at rest",
        "Young's modulus 4698 Pa",
        "no faults; next: porocore cell",
        "a run needs more sections: 'sampling:' and 'macro:' (and 'length:' under 'scales:'",
    ):
        assert words in told
    assert "body" not in told


def test_a_file_with_a_part_of_a_study_is_checked_as_a_study(written):
    words = refusal(
        "check", written(cell=CHANNELS, sampling={"inputs": {"p": {"range": [0, 0.1], "step": 0.05}}})
    )
    assert "macro: " in words
    assert "scales.length" in refusal("cell", written(cell=CHANNELS, scales=SCALES, macro={}))


def test_faults_of_a_cell_alone_have_their_lines(written):
    words = refusal("check", written(cell={"geometry": {"kind": "orthogonal-channels", "radius": 0.7}}))
    assert "scan.yaml:4: cell.geometry.radius: expected" in words


def test_a_study_has_the_same_numbers_for_its_cell(written):
    study = yaml.safe_load(BENCHMARK.read_text(encoding="utf-8")) | {"cell": CHANNELS}
    whole = json.loads(printed("cell", written(**study), "--json"))["properties"]
    alone = json.loads(printed("cell", written(cell=CHANNELS), "--json"))["properties"]
    assert whole == alone
