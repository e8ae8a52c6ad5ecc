"""(j) How many cell solves each sampler needs: on the inputs of the benchmark, on four, and on seven.

    python benchmarks/samplers.py --cache DIR [--plot docs/images/samplers.png]

Two inputs: p from −0.02 to 0.24 and H22 from −0.40 to 0.04, as the benchmark of Dehghani & Zilian visits them,
contact of the pore wall included; the surrogate is ``polynomial`` with ``degree: 8``. Four inputs: the diagonal of H
from −0.30 to 0.15 and p from 0 to 0.15; a third of the box is contact, some of it unstable. Seven inputs: the upper
triangle of H within ±0.15, which reaches every stretch, and p from 0 to 0.15, on the whole cell; and strong
compression, the box of four inputs with shears within ±0.10, on a coarse mesh. With four and with seven the surrogate
is ``polynomial``, and curves are medians over three seeds.

Every state that a sampler asks for is a solve, whatever becomes of it; what is not stable is left out of training and
of the unseen states. Errors of P_E and φ, the worst component's, on random states that nobody trained on, as a share of
the range: root mean squares, and the largest of all.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import table
from solved_states import CELL, Given, Library, random_points

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.inputs import InputSpace
from porocore.interfaces.sampler import Sampler, StudyFacts
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.density import DensitySweep
from porocore.sampling.samplers.designs import LatinHypercube, SobolDesign
from porocore.states import Array, CellResponse, MacroState
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate, judge

EXAMPLE = Path(__file__).parents[1] / "examples" / "dehghani2022.yaml"
TWO = InputSpace(("p", "H22"), (-0.02, -0.40), (0.24, 0.04))
FOUR = InputSpace(("H11", "H22", "H33", "p"), (-0.30,) * 3 + (0.0,), (0.15,) * 4)
STRONG = InputSpace(
    ("H11", "H22", "H33", "H12", "H13", "H23", "p"),
    (-0.30,) * 3 + (-0.10,) * 3 + (0.0,),
    (0.15,) * 3 + (0.10,) * 3 + (0.15,),
)
SEVEN = InputSpace(("H11", "H22", "H33", "H12", "H13", "H23", "p"), (-0.15,) * 6 + (0.0,), (0.15,) * 7)
#: Steps in p and H22 of the sweeps.
STEPS = ((0.13, 0.20), (0.13, 0.10), (0.065, 0.10), (0.065, 0.06))
#: The last one is with fresh seeds and fresh unseen states, which were fixed before any of them was solved.
INPUTS = {"two": TWO, "four": FOUR, "seven": SEVEN, "seven-again": SEVEN, "seven-strong": STRONG}
#: Some states in contact take a minute on the usual mesh of the whole cell.
CELLS = {"seven-strong": Cell(mesh=MeshSettings(size=0.3, fluid_size=0.15, element="linear"))}
SIZES = {
    "two": (8, 12, 16, 24, 32, 48, 64),
    "four": (16, 24, 32, 48, 64),
    "seven": (12, 16, 24, 32),
    "seven-again": (12, 16, 24, 32),
    "seven-strong": (24, 32, 48),
}
SEEDS = {"four": (0, 1, 2), "seven": (0, 1, 2), "seven-again": (11, 12, 13), "seven-strong": (21, 22, 23)}
#: Number and seed of the unseen states.
UNSEEN = {
    "two": (120, 7),
    "four": (120, 101),
    "seven": (160, 101),
    "seven-again": (100, 301),
    "seven-strong": (100, 401),
}
#: With seven inputs, states whose H11 + H22 + H33 is below this, and their share of the box: (0.6)³/6.
COMPRESSED = (-0.27, 0.036)
TITLES = {"seven-strong": "seven inputs, strong compression"}
#: Errors for which the number of solves is stated: root mean squares, and largest ones.
TARGETS = {
    "two": ((0.005, 0.002), (0.005, 0.002)),
    "four": ((0.02, 0.015), (0.12, 0.10)),
    "seven": ((0.0005, 0.0004), (0.01, 0.007)),
    "seven-again": ((0.0005, 0.0004), (0.01, 0.007)),
    "seven-strong": ((0.015, 0.013), (0.10, 0.07)),
}

Curve = list[tuple[int, float, float]]


@dataclass(frozen=True)
class Unseen:
    """States that nobody trained on, with their responses, and what share of the box (n,) each stands for."""

    states: MacroState
    responses: CellResponse
    share: Array


def unseen_states(library: Library, name: str) -> Unseen:
    """Random in the box; of seven inputs those with the largest compression are drawn more often, and count for less.

    Where all three stretches are small, in 3.6 % of that box, errors are ten times as large as elsewhere: of 160 states
    seven lie there, and the mean square would depend on where.
    """
    count, seed = UNSEEN[name]
    inputs = library.inputs
    states, responses = library.solve("unseen", Given(inputs, random_points(inputs, count, seed=seed)))
    share = np.full(len(states), 1 / len(states))
    if inputs is SEVEN:
        points = random_points(inputs, 4000, seed=seed + 1)
        more = library.solve(
            "unseen-compressed", Given(inputs, points[points[:, :3].sum(axis=1) < COMPRESSED[0]][:40])
        )
        states = MacroState.concatenate([states, more[0]])
        responses = CellResponse.concatenate([responses, more[1]])
        there = np.trace(states.grad_u, axis1=1, axis2=2) < COMPRESSED[0]
        share = np.where(there, COMPRESSED[1] / there.sum(), (1 - COMPRESSED[1]) / (~there).sum())
    return Unseen(states, responses, share)


def errors(
    library: Library, degree: int | None, samples: tuple[MacroState, CellResponse], unseen: Unseen
) -> tuple[float, float]:
    """Root mean square of the worst component, and the largest error of all."""
    fitted = PolynomialSurrogate(degree=degree).fit(library.training_set(*samples), seed=0)
    truth = unseen.responses
    found = fitted.predict(unseen.states, tangent=False)
    mean, largest = [], []
    for a, b in ((found.stress, truth.stress), (found.fluid_volume, truth.fluid_volume)):
        wrong, b = (a - b).reshape(len(b), -1), b.reshape(len(b), -1)
        spread = np.ptp(b, axis=0).max()
        mean.append(float(np.sqrt(unseen.share @ wrong**2).max() / spread))
        largest.append(float(np.abs(wrong).max() / spread))
    return max(mean), max(largest)


def study(library: Library) -> StudyFacts:
    """For a sampler that learns what the closure ``potential`` needs; nobody explores here."""

    def explore(data: object, *, elements: int, steps: int) -> None:
        raise RuntimeError("the samplers of this benchmark do not explore")

    return StudyFacts(
        library.reference, library.cell.identity, ("mean_grad", "stress", "fluid_volume"), explore, judge
    )


def curves(folder: Path, name: str) -> dict[str, list[Curve]]:
    """Error against the number of solves of every sampler, (solves, root mean square, largest), for each seed."""
    inputs, degree = INPUTS[name], 8 if name == "two" else None
    library = Library(folder / name, inputs, CELLS.get(name, CELL))
    unseen = unseen_states(library, name)
    most = SIZES[name][-1]

    def nested(label: str, sampler: Sampler) -> Curve:
        """A sampler whose beginnings serve smaller budgets."""
        states, responses, places = library.numbered(label, sampler)
        return [
            (n, *errors(library, degree, (states[places < n], responses[places < n]), unseen))
            for n in SIZES[name]
        ]

    def alone(label: str, sampler: Sampler) -> tuple[int, float, float]:
        samples = library.solve(label, sampler)
        return (sampler.expected, *errors(library, degree, samples, unseen))

    def active(label: str, seed: int) -> Curve:
        sampler = Active(inputs, count=most, seed=seed)
        sampler.inform(study(library))
        return nested(label, sampler)

    if name == "two":
        return {
            "active": [active("active", 0)],
            "sobol": [nested("sobol", SobolDesign(inputs, count=most))],
            "sobol, corners": [nested("sobol-corners", SobolDesign(inputs, count=most, corners=True))],
            "density-sweep": [
                [
                    alone(f"sweep-{i}", DensitySweep(inputs, step={"p": p, "H22": H}, tolerance=0.05))
                    for i, (p, H) in enumerate(STEPS)
                ]
            ],
        }
    seeds = SEEDS[name]
    samplers = {
        "active": [active(f"active-seed{seed}", seed) for seed in seeds],
        "latin-hypercube": [
            [alone(f"latin-{n}-seed{seed}", LatinHypercube(inputs, count=n, seed=seed)) for n in SIZES[name]]
            for seed in seeds
        ],
    }
    if name in ("four", "seven"):
        samplers["sobol"] = [
            nested(f"sobol-seed{seed}", SobolDesign(inputs, count=most, seed=seed)) for seed in seeds
        ]
    return samplers


def median(seeds: list[Curve]) -> Curve:
    """Of several seeds, size by size."""
    return [
        (row[0][0], *(float(np.median([point[which] for point in row])) for which in (1, 2)))
        for row in zip(*seeds, strict=True)
    ]


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


def plot(path: Path, found: dict[str, dict[str, list[Curve]]]) -> None:
    """Both errors of all comparisons; medians as lines, single seeds as points."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter, ScalarFormatter

    figure = Figure(figsize=(3.7 * len(found) + 1, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    colours = {"active": "#b3313b", "sobol": "#2357a5", "density-sweep": "0.35", "latin-hypercube": "#c8811a"}
    panels = figure.subplots(2, len(found), sharex="col", squeeze=False)
    for column, (name, samplers) in enumerate(found.items()):
        for row, what in enumerate(("root mean square error", "largest error")):
            axes = panels[row, column]
            for label, seeds in samplers.items():
                first, _, more = label.partition(", ")
                middle = median(seeds)
                axes.loglog(
                    [point[0] for point in middle],
                    [100 * point[1 + row] for point in middle],
                    color=colours[first],
                    ls=(0, (4, 2)) if more else "-",
                    marker="o" if len(seeds) == 1 else None,
                    ms=4,
                    lw=1.6,
                    label=label,
                )
                for curve in seeds if len(seeds) > 1 else ():
                    axes.loglog(
                        [point[0] for point in curve],
                        [100 * point[1 + row] for point in curve],
                        color=colours[first],
                        ls="none",
                        marker="o",
                        ms=3.5,
                        alpha=0.45,
                        mew=0,
                    )
            axes.set_xticks([n for n in SIZES[name] if n != 12 or name != "two"])
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.yaxis.set_minor_formatter(
                FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
            )
            axes.grid(which="major", color="0.9", lw=0.7)
            axes.spines[["top", "right"]].set_visible(False)
            if row == 0:
                axes.set_title(TITLES.get(name, f"{name} inputs"), fontsize=10)
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
    parser.add_argument("--only", choices=tuple(INPUTS), help="one of the comparisons")
    arguments = parser.parse_args()
    found = {
        name: curves(arguments.cache, name) for name in ((arguments.only,) if arguments.only else INPUTS)
    }
    if arguments.plot:
        plot(
            arguments.plot,
            {name: samplers for name, samplers in found.items() if name != "seven-again"} or found,
        )
    for name, samplers in found.items():
        rows = []
        for sampler, seeds in samplers.items():
            for label, curve in [
                (sampler, median(seeds)),
                *((f"seed {i}", curve) for i, curve in zip(SEEDS.get(name, ()), seeds, strict=False)),
            ]:
                wanted = [
                    needed(curve, target, which)
                    for which, targets in enumerate(TARGETS[name], start=1)
                    for target in targets
                ]
                sizes = ", ".join(f"{n}: {100 * a:.2g} / {100 * b:.2g}" for n, a, b in curve)
                rows.append([label, sizes, *wanted])
        header = [
            "",
            "solves: rms / largest, %",
            *(
                f"{w} {100 * t:g} %"
                for w, targets in zip(("rms", "largest"), TARGETS[name], strict=True)
                for t in targets
            ),
        ]
        print(table(f"(j) {name} inputs", header, rows))


if __name__ == "__main__":
    main()
