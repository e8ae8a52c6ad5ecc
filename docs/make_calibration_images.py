"""The pictures of literature.md: the fit of each calibration.

.venv/bin/python docs/make_calibration_images.py runs/brain runs/cartilage
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from make_images import IMAGES


def main() -> None:
    for folder in map(Path, sys.argv[1:]):
        fits = sorted((folder / "figures").glob("fit_*.png"))
        if len(fits) != 1:
            sys.exit(
                f"{folder}: expected the results of a calibration with one curve, got {len(fits)} figures of fits"
            )
        target = IMAGES / f"calibration-{folder.name}.png"
        shutil.copyfile(fits[0], target)
        print(target)


if __name__ == "__main__":
    main()
