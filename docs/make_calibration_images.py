"""The pictures of calibrations: the fit of each test from the literature, and the profile of the filmed plug.

.venv/bin/python docs/make_calibration_images.py runs/brain runs/brain-relaxation runs/cartilage
.venv/bin/python docs/make_calibration_images.py --plug runs/plug runs/plug-curves
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from make_images import IMAGES

from porocore import CellProblem
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.report.figures.style import BLACK, BLUE, GREY, ORANGE

#: Script that made the data of the plug.
PLUG = Path(__file__).parents[1] / "examples" / "calibrations" / "filmed_plug.py"


def fits(folders: list[Path]) -> None:
    for folder in folders:
        found = sorted((folder / "figures").glob("fit_*.png"))
        if len(found) != 1:
            sys.exit(
                f"{folder}: expected the results of a calibration with one curve, got {len(found)} figures of fits"
            )
        target = IMAGES / f"calibration-{folder.name}.png"
        shutil.copyfile(found[0], target)
        print(target)


def moduli(folder: Path, study: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights [mm], aggregate moduli [kPa] there, and their standard deviations in ln H, by the data alone.

    These are to first order, at the best evaluation of the fit, so that an interrupted calibration has them, too.
    """
    plan = read_plan(PLUG.with_name(study))
    data, (field,) = curve_data(plan.curves), plan.fields
    lines = (folder / "evaluations-0.jsonl").read_text(encoding="utf-8").splitlines()
    found = [each for each in map(json.loads, lines) if each.get("slopes")]

    def squares(each: dict[str, Any]) -> float:
        return float(np.square((np.array(each["values"]) - data.values) / data.deviations).sum())

    best, members = min(found, key=squares), list(field.members)
    unknowns = np.array(best["unknowns"])
    # The coordinates of all unknowns are logarithms.
    J = np.array(best["slopes"]) * unknowns / data.deviations[:, None]
    deviations = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[members]
    cell = plan.experiments[0].config.cell
    modulus = CellProblem(cell, parameters={"stiffness": 0.6}, store=False).properties.confined_moduli[1]
    return np.array(field.lines["y"]), modulus / 0.6 * unknowns[members], deviations


def plug(film: Path, curves: Path) -> None:
    spec = importlib.util.spec_from_file_location("filmed_plug", PLUG)
    assert spec is not None
    assert spec.loader is not None
    column = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(column)
    figure, panels = plt.subplots(1, 2, figsize=(8.6, 3.4), sharey=True, layout="constrained")
    studies = ("filmed-plug.yaml", "plug-curves.yaml")
    titles = ("film of 120 points", "settlement and base pressure")
    for axes, folder, study, colour, words in zip(
        panels, (film, curves), studies, (BLUE, ORANGE), titles, strict=True
    ):
        heights, values, deviations = moduli(folder, study)
        axes.plot(column.HEIGHTS, column.MODULI, color=BLACK, ls="--", label="truth")
        width = np.exp(np.minimum(1.96 * deviations, 5.0))
        bars = [values * (1 - 1 / width), values * (width - 1)]
        axes.errorbar(
            heights, values, bars, fmt="o-", ms=4, color=colour, ecolor=GREY, elinewidth=1.2, capsize=3,
            label="fit, 95 % intervals",
        )  # fmt: skip
        axes.set_title(words)
        axes.set_xlabel("height y [mm]")
        axes.set_ylim(0, 600)
        axes.legend(loc="upper right")
        off = np.log(values / np.interp(heights, column.HEIGHTS, column.MODULI)) / deviations
        print(folder, *(np.round(each, 3).tolist() for each in (values, deviations, off)))
    panels[0].set_ylabel("aggregate modulus [kPa]")
    figure.savefig(IMAGES / "calibration-plug.png", dpi=110)
    print(IMAGES / "calibration-plug.png")


def main() -> None:
    if sys.argv[1:2] == ["--plug"]:
        plug(*map(Path, sys.argv[2:]))
    else:
        fits([Path(each) for each in sys.argv[1:]])


if __name__ == "__main__":
    main()
