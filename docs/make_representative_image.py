"""The picture of representative-volume.md: sub-volumes of smoothed noise.

.venv/bin/python docs/make_representative_image.py FOLDER
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import porocore
from porocore.commands.representative.plan import SubvolumePlan
from porocore.commands.representative.results import verdict

IMAGE = Path(__file__).parent / "images" / "representative-volume.png"
PLAN = SubvolumePlan(sizes=(12, 16, 24, 32), count=8, element=3.0, tolerance=0.1)


def main() -> None:
    """Make an image of 96³ voxels in a folder, study it there, and copy the picture."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    noise = gaussian_filter(np.random.default_rng(2).standard_normal((96,) * 3), 1.8, mode="wrap")
    np.save(folder / "pores.npy", (noise > np.quantile(noise, 0.5)).astype(np.uint8))
    (folder / "scan.yaml").write_text(
        "cell:\n  geometry:\n"
        "    {kind: voxels, path: pores.npy, pore: 1, drop_grains: true, fill_pores: 8, voxel_size: 2 um}\n"
    )
    config = porocore.load_config(folder / "scan.yaml", cell_only=True)
    found = porocore.study_representative_volume(config, folder / "rev", PLAN, resume=True, tell=print)
    print("\n".join(verdict(found)))
    shutil.copyfile(found.pictures[0], IMAGE)


if __name__ == "__main__":
    main()
