"""The paper's benchmark over the plane of radius and Poisson's ratio, from one surrogate.

    python benchmarks/parameter_plane.py --out DIR [--plot docs/images/parameter-plane.png]

One family of cells, r from 0.15 to 0.3 and ν from 0.2 to 0.45, is sampled and learned; then the column is solved for
each pair of values. Three points are held against studies of their own: one cell with these numbers, meshed, sampled
and learned alone. DIR keeps everything, and an interrupted script goes on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import table

import porocore

CONFIG = Path(__file__).with_name("parameter_plane.yaml")
#: Values of the plane, and the points at which a study of its own is made.
RADII, RATIOS = np.linspace(0.15, 0.3, 7), np.linspace(0.2, 0.45, 6)
POINTS = ((0.2, 0.4), (0.25, 0.35), (0.275, 0.25))
#: Results that are drawn and compared, and what they are called.
RESULTS = {"final_settlement": "final settlement", "time_to_95_percent": "time to 95 %"}


def own(folder: Path, radius: float, ratio: float) -> dict[str, float]:
    """Results of the study of one cell."""
    whole = porocore.load_config(CONFIG)
    settings = whole.model_dump(mode="json")
    settings["cell"]["geometry"]["radius"] = radius
    settings["cell"]["material"]["poisson_ratio"] = ratio
    settings["macro"]["fields"] = {}
    settings["sampling"]["options"] = {"count": 48, "corners": True}
    study = porocore.Study(settings, out=folder / f"own-{radius:g}-{ratio:g}", progress=False)
    (solved,) = study.solve(("surrogate",)).values()
    from porocore.report.metrics import solution_metrics

    found = solution_metrics(solved.nonlinear.solution)
    return {name: found[name] for name in RESULTS}


def plot(
    path: Path, sweep: porocore.ParameterSweep, errors: dict[tuple[float, float], dict[str, float]]
) -> None:
    """Draw both results over the plane, with the points and their differences."""
    from porocore.report.figures.style import new_figure, png_bytes, styled
    from porocore.study.sweep.figure import plane

    @styled
    def drawn() -> bytes:
        figure = new_figure(10.4, 4.4)
        panels = figure.subplots(1, 2)
        for axes, name in zip(panels, RESULTS, strict=True):
            plane(sweep, figure, axes, name)
            for (radius, ratio), found in errors.items():
                axes.plot(radius, ratio, marker="*", ms=15, mfc="white", mec="black", zorder=5, clip_on=False)
                axes.annotate(
                    f"{100 * found[name]:+.2f} %", (radius, ratio), (0, -16), textcoords="offset points", ha="center",
                    color="white", fontweight="bold", zorder=6,
                )  # fmt: skip
        return png_bytes(figure)

    path.write_bytes(drawn())


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--plot", type=Path, help="picture of the plane")
    given = parser.parse_args()
    study = porocore.Study(CONFIG, out=given.out / "family")
    sweep = study.sweep({"radius": RADII, "poisson_ratio": RATIOS}, laws=("surrogate",))
    rows, errors = [], {}
    for radius, ratio in POINTS:
        at = int(np.isclose(sweep.values, (radius, ratio), rtol=1e-9).all(axis=1).argmax())
        alone = own(given.out, radius, ratio)
        errors[radius, ratio] = {name: sweep.figures[name][at] / alone[name] - 1 for name in RESULTS}
        rows.append([f"{radius:g}, {ratio:g}"])
        for name in RESULTS:
            rows[-1] += [
                f"{sweep.figures[name][at]:.4g}",
                f"{alone[name]:.4g}",
                f"{100 * errors[radius, ratio][name]:+.2f} %",
            ]
    header = [
        "r, ν",
        *(word for name in RESULTS.values() for word in (name, "study of its own", "difference")),
    ]
    print(table("The benchmark over radius and Poisson's ratio", header, rows))
    print(f"flagged: {int(sweep.flagged.sum())} of {len(sweep.values)} points")
    if given.plot:
        plot(given.plot, sweep, errors)


if __name__ == "__main__":
    main()
