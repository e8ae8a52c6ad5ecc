"""(j) How many cell solves each sampler needs: on the inputs of the benchmark, and on seven.

    python benchmarks/samplers.py --cache DIR [--plot docs/images/samplers.png]

Two inputs: p from −0.02 to 0.24 and H22 from −0.40 to 0.04, as the benchmark of Dehghani & Zilian visits them,
contact of the pore wall included; the surrogate is ``polynomial`` with ``degree: 8``. Seven inputs: the upper triangle
of H within ±0.15, which reaches every stretch, and p from 0 to 0.15, on the whole cell; the surrogate is
``polynomial``. Errors of P_E and φ, the worst component's, on random states that nobody trained on, as a share of the
range: root mean squares, and the largest of all.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import table
from solved_states import CELL, Given, Library, random_points, worst_share

from porocore.inputs import InputSpace
from porocore.interfaces.sampler import Sampler, Study
from porocore.sampling.active import Active
from porocore.sampling.density import DensitySweep
from porocore.sampling.designs import LatinHypercube, SobolDesign
from porocore.states import CellResponse, MacroState
from porocore.surrogates.polynomial_surrogate import PolynomialSurrogate

EXAMPLE = Path(__file__).parents[1] / "examples" / "dehghani2022.yaml"
TWO = InputSpace(("p", "H22"), (-0.02, -0.40), (0.24, 0.04))
SEVEN = InputSpace(("H11", "H22", "H33", "H12", "H13", "H23", "p"), (-0.15,) * 6 + (0.0,), (0.15,) * 7)
#: Steps in p and H22 of the sweeps.
STEPS = ((0.13, 0.20), (0.13, 0.10), (0.065, 0.10), (0.065, 0.06))
SIZES = {"two": (8, 12, 16, 24, 32, 48, 64), "seven": (8, 12, 16, 24, 32, 48, 64)}
LATIN, SEEDS = (12, 16, 24, 32, 64), (0, 1)
MOST, UNSEEN = 64, {"two": 120, "seven": 60}
#: Errors for which the number of solves is stated.
TARGETS = {"two": (0.005, 0.002), "seven": (0.002, 0.001, 0.0003)}

Curve = list[tuple[int, float, float]]


def errors(
    library: Library, degree: int | None, samples: tuple[MacroState, CellResponse], unseen
) -> tuple[float, float]:
    """Root mean square of the worst component, and the largest error of all."""
    fitted = PolynomialSurrogate(degree=degree).fit(library.training_set(*samples), seed=0)
    states, truth = unseen
    found = fitted.predict(states, tangent=False)
    pairs = ((found.stress, truth.stress), (found.fluid_volume, truth.fluid_volume))
    return (
        max(worst_share(a - b, b) for a, b in pairs),
        max(float(np.abs(a - b).max() / np.ptp(b.reshape(len(b), -1), axis=0).max()) for a, b in pairs),
    )


def study(library: Library) -> Study:
    """For a sampler that learns what the closure ``potential`` needs; nobody explores here."""

    def explore(data: object, *, elements: int, steps: int) -> None:
        raise RuntimeError("the samplers of this benchmark do not explore")

    return Study(library.reference, CELL.identity, ("mean_grad", "stress", "fluid_volume"), explore)


def curves(folder: Path, name: str) -> dict[str, Curve]:
    """Error against the number of solves of every sampler, (solves, root mean square, largest)."""
    inputs, degree = (TWO, 8) if name == "two" else (SEVEN, None)
    library = Library(folder / name, inputs)
    unseen = library.solve("unseen", Given(inputs, random_points(inputs, UNSEEN[name], seed=7)))

    def nested(label: str, sampler: Sampler) -> Curve:
        states, responses = library.solve(label, sampler)
        return [
            (n, *errors(library, degree, (states[:n], responses[:n]), unseen))
            for n in SIZES[name]
            if n <= len(states)
        ]

    def alone(label: str, sampler: Sampler) -> tuple[int, float, float]:
        samples = library.solve(label, sampler)
        return (len(samples[0]), *errors(library, degree, samples, unseen))

    active = Active(inputs, count=MOST)
    active.inform(study(library))
    found = {"active": nested("active", active)}
    if name == "two":
        found["sobol"] = nested("sobol", SobolDesign(inputs, count=MOST))
        found["sobol, corners"] = nested("sobol-corners", SobolDesign(inputs, count=MOST, corners=True))
        found["density-sweep"] = [
            alone(f"sweep-{i}", DensitySweep(inputs, step={"p": p, "H22": H}, tolerance=0.05))
            for i, (p, H) in enumerate(STEPS)
        ]
    else:
        again = Active(inputs, count=LATIN[-2], seed=1)
        again.inform(study(library))
        found["active, seed 1"] = nested("active-seed1", again)
        for seed in SEEDS:
            found[f"latin-hypercube, seed {seed}"] = [
                alone(f"latin-{n}-seed{seed}", LatinHypercube(inputs, count=n, seed=seed))
                for n in (LATIN if seed == 0 else LATIN[:-1])
            ]
        found["sobol"] = nested("sobol", SobolDesign(inputs, count=LATIN[-2]))
    return found


def needed(curve: Curve, target: float, which: int) -> str:
    """Solves from which on the error stays below the target, between two sizes by their logarithms."""
    values = [(row[0], row[which]) for row in curve]
    if values[-1][1] > target:
        return f"> {values[-1][0]}"
    at = next(i for i in range(len(values)) if all(e <= target for _, e in values[i:]))
    if at == 0:
        return f"≤ {values[0][0]}"
    (n0, e0), (n1, e1) = values[at - 1], values[at]
    return f"{np.ceil(n0 * (n1 / n0) ** (np.log(e0 / target) / np.log(e0 / e1))):.0f}"


def plot(path: Path, found: dict[str, dict[str, Curve]]) -> None:
    """Both errors of both comparisons."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter, ScalarFormatter

    figure = Figure(figsize=(8.4, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    colours = {"active": "#b3313b", "sobol": "#2357a5", "density-sweep": "0.35", "latin-hypercube": "#c8811a"}
    panels = figure.subplots(2, 2, sharex=True)
    for row, what in enumerate(("root mean square error", "largest error")):
        for column, (name, samplers) in enumerate(found.items()):
            axes = panels[row, column]
            for label, curve in samplers.items():
                first, _, more = label.partition(", ")
                axes.loglog(
                    [point[0] for point in curve],
                    [100 * point[1 + row] for point in curve],
                    color=colours[first],
                    ls=(0, (4, 2)) if more in ("corners", "seed 1") else "-",
                    marker="o",
                    ms=4,
                    lw=1.4,
                    label=label,
                )
            axes.set_xticks((8, 16, 32, 64))
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.grid(which="major", color="0.9", lw=0.7)
            axes.spines[["top", "right"]].set_visible(False)
            if row == 0:
                axes.set_title(f"{name} inputs", fontsize=10)
                axes.legend(fontsize=8.5, frameon=False)
            else:
                axes.set_xlabel("cell solves")
            if column == 0:
                axes.set_ylabel(f"{what} [% of the range]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for solved states; made if missing")
    parser.add_argument("--plot", type=Path, help="PNG to write")
    parser.add_argument("--only", choices=("two", "seven"), help="one of the two comparisons")
    arguments = parser.parse_args()
    found = {
        name: curves(arguments.cache, name)
        for name in ((arguments.only,) if arguments.only else ("two", "seven"))
    }
    if arguments.plot:
        plot(arguments.plot, found)
    for name, samplers in found.items():
        rows = []
        for sampler, curve in samplers.items():
            wanted = [needed(curve, target, which) for which in (1, 2) for target in TARGETS[name]]
            rows.append(
                [sampler, ", ".join(f"{n}: {100 * a:.2g} / {100 * b:.2g}" for n, a, b in curve), *wanted]
            )
        header = [
            "",
            "solves: rms / largest, %",
            *(f"{w} {100 * t:g} %" for w in ("rms", "largest") for t in TARGETS[name]),
        ]
        print(table(f"(j) {name} inputs", header, rows))


if __name__ == "__main__":
    main()
