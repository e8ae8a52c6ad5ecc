"""Kinds of files by their first bytes, and names that similar ones are found for."""

import pytest

from porocore.core.echo import did_you_mean
from porocore.core.files.slices import foreign, told_by


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (b"\x93NUMPY\x01\0", "a .npy file of NumPy"),
        (b"MM\0*", "a TIFF image"),
        (b'<?xml version="1.0"?>\n<VTKFile type="a">', "an XML file of VTK"),
        (b"\n<!DOCTYPE HTML>", "a web page"),
        (b"\0" * 600, "a file of zeros alone"),
        ("ä".encode() * 300, "text"),
        (b"x" + "ä".encode() * 300, "text"),
    ],
)
def test_a_kind_is_told(tmp_path, content, name):
    (tmp_path / "file").write_bytes(content)
    assert told_by(tmp_path / "file").name == name


@pytest.mark.parametrize("content", [b"", bytes(range(256)), b'<?xml version="1.0"?><!-- a --><VTKFile>'])
def test_a_file_that_tells_no_kind_is_left_to_its_reader(tmp_path, content):
    (tmp_path / "file").write_bytes(content)
    assert told_by(tmp_path / "file") is None


def test_a_name_that_fits_is_no_fault(tmp_path):
    path = tmp_path / "a.TIFF"
    path.write_bytes(b"II*\0")
    assert foreign(path, "a TIFF image", (".tif",), "") is None


def test_names_are_similar_whatever_their_case():
    assert did_you_mean("VOID", ["matrix", "void"]) == "did you mean 'void'?"
