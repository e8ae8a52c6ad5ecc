"""The size of a voxel with its unit: the length of the cell follows, and what contradicts it is refused."""

import numpy as np
import pytest
import tifffile
import yaml

from porocore.core.units import length_text
from porocore.errors import ConfigurationError
from porocore.study.config.loading import cell_from, load_config
from porocore.study.config.schema import configuration_schema
from porocore.study.notes.at_rest import edges

SCALES = {"modulus": "1 kPa", "length": "1 mm", "viscosity": "1 mPa*s"}
STUDY = {
    "sampling": {"inputs": {"p": {"range": [0, "10 Pa"], "step": 0.1}}},
    "macro": {"loads": [0.1], "boundary": {"y+": {"pressure": 0}}, "time": {"end": "2 h", "step": "1 min"}},
}


@pytest.fixture
def load(tmp_path):
    np.save(tmp_path / "image.npy", np.indices((8, 8, 16))[2] % 8 < 4)

    def made(geometry, **scales):
        geometry = {"kind": "voxels", "path": "image.npy", "repeat": "periodic", **geometry}
        study = {**STUDY, "cell": {"geometry": geometry, "viscosity": 1}}
        if scales:
            study["scales"] = {key: value for key, value in {**SCALES, **scales}.items() if value is not None}
        (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
        return load_config(tmp_path / "study.yaml")

    return made


@pytest.mark.parametrize(
    ("geometry", "length", "text"),
    [
        ({"voxel_size": "12 um"}, 96e-6 * 2 ** (1 / 3), "96 x 96 x 192 µm"),
        ({"voxel_size": 12e-6}, 96e-6 * 2 ** (1 / 3), "96 x 96 x 192 µm"),
        ({"voxel_size": "12 um", "repeat": "mirror"}, 192e-6 * 2 ** (1 / 3), "192 x 192 x 384 µm"),
        ({"voxel_size": ["20 nm", "20 nm", "0.01 um"]}, 160e-9, "160 x 160 x 160 nm"),
        ({"voxel_size": "12 um", "crop": [[0, 8], [0, 8], [0, 8]]}, 96e-6, "96 x 96 x 96 µm"),
    ],
    ids=["one", "in metres", "mirrored", "three", "cropped"],
)
def test_the_length_of_the_cell_is_that_of_its_voxels(load, geometry, length, text):
    config = load(geometry, pore=None)
    assert config.cell.geometry.length == pytest.approx(length, rel=1e-12)
    assert config.scales.pore == pytest.approx(length, rel=1e-12)
    # The unit of time is L² μ_c/(E d²) with the length of the cell.
    time = 1e-6 * 1e-3 / (1e3 * length**2)
    assert config.macro.time.end == pytest.approx(7200 / time, rel=1e-12)
    assert list(edges(config.cell, config.cell_length)) == [f"  edges of the cell: {text}"]


def test_a_resolved_configuration_is_read_again(load, tmp_path):
    config = load({"voxel_size": "12 um"}, pore=None)
    (tmp_path / "again.yaml").write_text(config.resolved_yaml())
    assert load_config(tmp_path / "again.yaml") == config


def test_another_length_is_refused_in_one_message(load):
    assert load({"voxel_size": "12 um", "crop": [[0, 8]] * 3}, pore="0.096 mm").scales.pore == pytest.approx(
        96e-6
    )
    with pytest.raises(ConfigurationError) as refused:
        load({"voxel_size": "12 um", "crop": [[0, 8]] * 3}, pore="0.1 mm")
    lines = str(refused.value).splitlines()
    assert len(lines) == 1
    assert "scales.pore: expected 96 µm, the length of the cell by cell.geometry.voxel_size" in lines[0]
    assert "got '0.1 mm'; leave scales.pore out, or voxel_size" in lines[0]


def test_what_is_no_length_of_a_voxel_is_refused(load):
    with pytest.raises(
        ConfigurationError, match=r"voxel_size: expected a length, such as 5 mm, got '12 kPa'"
    ):
        load({"voxel_size": "12 kPa"})
    with pytest.raises(ConfigurationError, match=r"voxel_size.*greater|voxel_size.*expected"):
        load({"voxel_size": -1.0}, pore=None)
    with pytest.raises(ConfigurationError, match=r"scales\.pore: missing"):
        load({}, pore=None)


def test_a_cell_from_python_takes_the_unit_too(tmp_path):
    np.save(tmp_path / "image.npy", np.indices((8, 8, 8))[2] % 8 < 4)
    geometry = {"kind": "voxels", "path": "image.npy", "voxel_size": "3 um", "repeat": "periodic"}
    assert cell_from({"geometry": geometry}, tmp_path).geometry.length == pytest.approx(24e-6)


def test_lengths_have_the_unit_that_suits_them():
    assert length_text(2.3e-8) == "23 nm"
    assert length_text(1e-3, 5e-4) == "1 x 0.5 mm"
    assert length_text(2.0) == "2 m"
    assert length_text(1e-12) == "0.001 nm"


def test_an_editor_does_not_ask_for_what_the_voxels_tell():
    assert configuration_schema()["$defs"]["Scales"]["required"] == ["length"]


def test_a_misspelt_voxel_size_is_told_beside_the_pore_that_it_hides(load):
    """It was told alone: the scales lack their pore, since the key that gives it is another one."""
    with pytest.raises(ConfigurationError) as refused:
        load({"voxelsize": "12 um", "pour": 1}, pore=None)
    other, key, pore = str(refused.value).splitlines()
    assert "cell.geometry.voxelsize: unknown key; did you mean 'voxel_size'?" in key
    assert "cell.geometry.pour: unknown key; did you mean 'pore'?" in other
    assert pore.endswith(
        "scales.pore: missing; add 'pore:' under 'scales:', or 'voxel_size:' under 'cell.geometry:'"
    )
    with pytest.raises(ConfigurationError) as refused:
        load({"voxel_size": "12 kPa"}, modulus="1 mm")
    assert [line.split(": ")[1] for line in str(refused.value).splitlines()] == [
        "cell.geometry.voxel_size",
        "scales.modulus",
    ]


@pytest.mark.parametrize(
    ("spacing", "told"),
    [(6.5, "'voxel_size: 6.5 um'"), (13, "'voxel_size: [6.5 um, 6.5 um, 13 um]'"), (None, "")],
)
def test_the_size_that_the_file_states_is_what_to_write(load, tmp_path, spacing, told):
    how = {} if spacing is None else {"imagej": True, "resolution": (1 / 6.5, 1 / 6.5)}
    metadata = {} if spacing is None else {"axes": "ZYX", "spacing": spacing, "unit": "um"}
    tifffile.imwrite(tmp_path / "image.tif", np.zeros((8, 8, 8), np.uint8), metadata=metadata, **how)
    with pytest.raises(ConfigurationError) as refused:
        load({"path": "image.tif"}, pore=None)
    end = (
        f"or under 'cell.geometry:' what the image file states, {told}" if told else "under 'cell.geometry:'"
    )
    assert "scales.pore: missing; add 'pore:' under 'scales:', or " in str(refused.value)
    assert str(refused.value).splitlines()[0].endswith(end)


def test_an_image_that_cannot_be_read_is_refused_at_the_line_of_its_path(load, tmp_path):
    tifffile.imwrite(tmp_path / "image.tif", np.zeros((8, 8), np.uint8))
    with pytest.raises(
        ConfigurationError, match=r"study.yaml:\d+: cell.geometry.path: .*image.tif: expected an image in"
    ):
        load({"path": "image.tif", "voxel_size": "12 um"}, pore=None)
