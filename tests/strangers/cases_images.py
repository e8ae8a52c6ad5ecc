"""Images of tomographs, and the porosity that belongs to the results of a cell."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageSequence

import porocore
from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import Case

CHANNELS = {"kind": "orthogonal-channels", "radius": 0.25}


def porosity_is_that_of_the_mesh(folder: Path, ended: Ended | None) -> None:
    exact = 3 * np.pi * 0.25**2 - 8 * np.sqrt(2) * 0.25**3
    for element, of_mesh in (("quadratic-curved", 0.412245), ("linear", 0.401544)):
        mesh = {"size": 0.4, "fluid_size": 0.25, "element": element}
        for swelling in (1.0, 1.05):
            material = {"kind": "neo-hookean", "poisson_ratio": 0.3, "swelling": swelling}
            problem = porocore.CellProblem({"geometry": CHANNELS, "material": material, "mesh": mesh})
            assert problem.porosity == pytest.approx(of_mesh, abs=1e-6)
            assert problem.geometric_porosity == pytest.approx(exact, abs=1e-12)
            at_rest = problem.response(np.zeros((3, 3))).fluid_volume[0]
            assert (at_rest == problem.porosity) == (swelling == 1.0)


def decoded(folder: Path) -> None:
    """Write the lossy file as programs with a decoder of JPEG read it."""
    with Image.open(folder / "jpeg.tif") as file:
        pages = [np.array(page) for page in ImageSequence.Iterator(file)]
    tifffile.imwrite(folder / "jpeg.tif", np.array(pages))


def with_threshold(folder: Path) -> None:
    decoded(folder)
    path = folder / "jpeg.tif.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace("pore: 0", "threshold: otsu"), encoding="utf-8")


def run_and_report_tell_it(folder: Path, ended: Ended | None) -> None:
    words = [sys.executable, "-m", "porocore", "run", "jpeg.tif.yaml", "--out", "run", "--no-store"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
    before = done.stderr.partition("sampling:")[0]
    assert "warning: the image is not segmented, its values are 10 distinct" in before
    page = (folder / "run/report.html").read_text(encoding="utf-8")
    assert "the image is not segmented, its values are 10 distinct ones from 0 to 255" in page
    assert "straight square channels of 10, 20 and 40 voxels" in page


CASES: list[Case] = [
    Case(
        "image_not_segmented",
        ("check", "grey.tif.yaml"),
        status=2,
        says=(
            "grey.tif.yaml:2: cell.geometry: the image is not segmented, its values are 226 distinct",
            "expected a mesh of the porosity 0.00195, which is that of image grey.tif",
            "got 0.00127 with the solid's mesh of size 0.25",
            "'threshold: otsu' in its place parts them at 125.5 and takes the darker 44.5 %",
        ),
    ),
    Case(
        "image_not_segmented",
        ("check", "jpeg.tif.yaml"),
        before=decoded,
        says=(
            "note: geometry: the image is not segmented, its values are 10 distinct ones from 0 to 255, and 'pore: 0' "
            "takes 26.4 % of the voxels; 'threshold: otsu' in its place parts them at 127 and takes the darker 42.2 %",
        ),
    ),
    Case(
        "image_not_segmented",
        ("cell", "state", "jpeg.tif.yaml", "--no-store"),
        before=decoded,
        says=(
            "note: the image is not segmented, its values are 10",
            "porosity φ_f of the mesh 0.2600",
            "K and moduli of an image",
        ),
    ),
    Case(
        "image_not_segmented",
        ("cell", "show", "jpeg.tif.yaml", "--no-pictures"),
        before=with_threshold,
        says=("porosity: 0.421875; of the solid's mesh 0.42", "threshold 127, by Otsu's method"),
        never=("note",),
    ),
    Case(
        "image_not_segmented",
        "a run warns of it at its start, and its report",
        before=decoded,
        check=run_and_report_tell_it,
        slow=True,
    ),
    Case(
        "porosity_of_mesh",
        "CellProblem.porosity is the fluid volume of the mesh before it swells",
        check=porosity_is_that_of_the_mesh,
    ),
]
