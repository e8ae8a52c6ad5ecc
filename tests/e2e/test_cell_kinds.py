"""Whole studies of cells without mirrors and of images; a changed image is noticed."""

import numpy as np
import pytest

from tests.e2e.study import message, porocore, succeeded, write_study

COARSE = {"size": 0.25, "fluid_size": 0.25, "element": "linear"}


@pytest.mark.slow
def test_a_study_of_a_gyroid(tmp_path):
    geometry = {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.5}
    study = write_study(tmp_path / "study.yaml", {"cell.geometry": geometry, "cell.mesh": COARSE})
    done = porocore("run", study, "--out", tmp_path / "run")
    assert succeeded(done) == str(tmp_path / "run" / "report.html")


@pytest.mark.slow
def test_a_study_of_an_image_belongs_to_that_image(tmp_path):
    x = (np.arange(8) + 0.5) / 16
    X, Y, Z = np.meshgrid(x, x, x, indexing="ij")
    squares = np.minimum(np.minimum(X**2 + Y**2, Y**2 + Z**2), X**2 + Z**2)
    np.save(tmp_path / "pores.npy", squares < 0.25**2)
    changes = {"cell.geometry": {"kind": "voxels", "path": "pores.npy", "pore": 1}, "cell.mesh": COARSE}
    study = write_study(tmp_path / "study.yaml", changes)
    succeeded(porocore("sample", study, "--out", tmp_path / "run"))
    np.save(tmp_path / "pores.npy", squares < 0.2**2)
    text = message(porocore("sample", study, "--out", tmp_path / "run", "--resume"))
    assert "pores.npy" in text
    assert "changed" in text or "sha256" in text
