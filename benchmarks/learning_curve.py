"""(f) How many cell solves a surrogate needs: models and ways of sampling, on the inputs of the benchmark.

    python benchmarks/learning_curve.py --cache DIR [--plot docs/images/learning-curve.png]

H22 from −0.20 to 0.04 and p from −0.02 to 0.24, where the cell is stable. Errors are root mean squares on 200 random
states that nobody trained on, as a share of the range: the larger one of P_E,22 and φ for a potential (a network alone
does not learn the lateral stress, which does no work here), that of <∇u¹> for the paper's network. What this network
says of P_E goes through its closure, whose own error is another matter.

A second table holds the default potentials of all backends against the whole of P_E and φ, from 40 solves.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import table
from solved_states import Given, Library, farthest_points, random_points, worst_share

from porocore.core.inputs import InputSpace
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.plugins.registry import registry
from porocore.sampling.samplers.density import DensitySweep
from porocore.states import CellResponse, MacroState

#: In the order in which the paper sweeps them.
INPUTS = InputSpace(("p", "H22"), (-0.02, -0.20), (0.24, 0.04))
SIZES = (6, 10, 20, 40, 80, 160, 320)
#: Steps in p and H22 of the sweeps, from which about as many solves follow; six are fewer than a sweep has corners.
STEPS = {
    10: (0.24, 0.20),
    20: (0.12, 0.07),
    40: (0.08, 0.035),
    80: (0.05, 0.024),
    160: (0.035, 0.015),
    320: (0.024, 0.0095),
}
TARGET = 0.005
#: Potentials as they are by default, and the number of solves for the second table.
DEFAULTS, SOLVES = {"polynomial": {}, "torch": {"model": "potential"}, "jax": {"model": "potential"}}, 40
SEEDS = (0, 1, 2)

Make = Callable[[], Surrogate]
Samples = list[tuple[MacroState, CellResponse]]


def models(backend: str) -> dict[str, tuple[Make, tuple[int, ...]]]:
    """Choices that are compared, and the seeds that are tried."""

    def network(**options: object) -> Make:
        return lambda: registry().get("surrogate", backend)(**options)

    return {
        "polynomial": (lambda: registry().get("surrogate", "polynomial")(), (0,)),
        "polynomial, degree: 8": (lambda: registry().get("surrogate", "polynomial")(degree=8), (0,)),
        "network, values and slopes": (network(model="potential", anchor="none"), SEEDS),
        "network, values only": (network(model="potential", anchor="none", derivatives=False), SEEDS),
        "the paper's network, ⟨∇u¹⟩": (network(model="mlp"), SEEDS),
    }


def error_of(surrogate: Surrogate, states: MacroState, truth: CellResponse) -> float:
    """See the module."""
    predicted = surrogate.predict(states, tangent=False)
    if predicted.stress is None:
        return worst_share(predicted.mean_grad - truth.mean_grad, truth.mean_grad)
    return max(
        worst_share((predicted.stress - truth.stress)[:, 1, 1], truth.stress[:, 1, 1]),
        worst_share(predicted.fluid_volume - truth.fluid_volume, truth.fluid_volume),
    )


def default_rows(data: TrainingSet, states: MacroState, truth: CellResponse) -> list[list[str]]:
    """Errors of P_E, of P_E,22 alone and of φ of the potentials with default options, each with every seed."""
    rows = []
    for backend, options in DEFAULTS.items():
        errors = []
        for seed in SEEDS:
            fitted = registry().get("surrogate", backend)(**options).fit(data, seed=seed)
            found = fitted.predict(states, tangent=False)
            errors.append(
                [
                    worst_share(found.stress - truth.stress, truth.stress),
                    worst_share((found.stress - truth.stress)[:, 1, 1], truth.stress[:, 1, 1]),
                    worst_share(found.fluid_volume - truth.fluid_volume, truth.fluid_volume),
                ]
            )
        rows.append([backend, *(f"{100 * e:.2g} %" for e in np.max(errors, axis=0))])
    return rows


def sample(library: Library) -> dict[str, Samples]:
    """Nested parts of one sequence of farthest points; sweeps of ever smaller steps."""
    states, responses = library.solve("farthest", Given(INPUTS, farthest_points(INPUTS, max(SIZES))))
    filling = [(states[:n], responses[:n]) for n in SIZES]
    sweeps = []
    for size, (p, H22) in STEPS.items():
        sweep = DensitySweep(INPUTS, step={"p": p, "H22": H22}, tolerance=0.05)
        sweeps.append(library.solve(f"sweep-{size}", sweep))
    return {"farthest points": filling, "one factor at a time": sweeps}


def needed(curve: list[tuple[int, float]]) -> str:
    """Solves from which on the error stays below the target, between two sizes by their logarithms."""
    if curve[-1][1] > TARGET:
        return f"> {curve[-1][0]}"
    at = next(i for i in range(len(curve)) if all(e <= TARGET for _, e in curve[i:]))
    if at == 0:
        return f"≤ {curve[0][0]}"
    (n0, e0), (n1, e1) = curve[at - 1], curve[at]
    share = np.log(e0 / TARGET) / np.log(e0 / e1)
    return f"{np.ceil(n0 * (n1 / n0) ** share):.0f}"


def plot(path: Path, curves: dict[tuple[str, str], list[tuple[int, float]]]) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter, ScalarFormatter

    figure = Figure(figsize=(7.4, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    names, ways = list(dict.fromkeys(k[0] for k in curves)), list(dict.fromkeys(k[1] for k in curves))
    colours = dict(zip(names, ("#0b6e4f", "#5fb08f", "#2357a5", "#c8811a", "#b3313b"), strict=True))
    for (name, way), curve in curves.items():
        first = way == ways[0]
        n, e = zip(*curve, strict=True)
        axes.loglog(
            n,
            100 * np.array(e),
            color=colours[name],
            ls="-" if first else (0, (4, 2)),
            marker="o" if first else "s",
            ms=4.5,
            mfc=colours[name] if first else "white",
            lw=1.4,
        )
    axes.axhline(100 * TARGET, color="0.5", lw=0.8, ls=":")
    axes.set_ylim(None, 60)  # room for the legend
    axes.text(axes.get_xlim()[1] * 0.97, 100 * TARGET * 1.15, "0.5 %", ha="right", color="0.4", fontsize=9)
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(SIZES)
    axes.set(xlabel="cell solves", ylabel="error on unseen states [% of the range]")
    axes.grid(which="major", color="0.9", lw=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    handles = [axes.plot([], [], color=colours[name], lw=2, label=name)[0] for name in names]
    handles += [
        axes.plot([], [], color="0.3", ls=ls, marker=m, ms=4.5, mfc=face, label=way)[0]
        for way, ls, m, face in zip(ways, ("-", (0, (4, 2))), ("o", "s"), ("0.3", "white"), strict=True)
    ]
    axes.legend(handles=handles, fontsize=8.5, frameon=False, ncols=2, loc="upper center")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for solved states; made if missing")
    parser.add_argument("--plot", type=Path, help="PNG to write")
    parser.add_argument("--backend", default="jax", help="library of the networks: jax or torch")
    arguments = parser.parse_args()
    library = Library(arguments.cache, INPUTS)
    unseen = library.solve("unseen", Given(INPUTS, random_points(INPUTS, 200, seed=7)))
    samples = sample(library)
    curves: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for name, (make, seeds) in models(arguments.backend).items():
        for way, sets in samples.items():
            curve = []
            for states, responses in sets:
                data = library.training_set(states, responses)
                errors = [error_of(make().fit(data, seed=seed), *unseen) for seed in seeds]
                curve.append((len(states), float(np.median(errors))))
            curves[name, way] = curve
            print(name, way, [(n, f"{100 * e:.3g} %") for n, e in curve], flush=True)
    if arguments.plot:
        plot(arguments.plot, curves)
    rows = [
        [name, way, needed(curve), ", ".join(f"{100 * e:.2g} ({n})" for n, e in curve)]
        for (name, way), curve in curves.items()
    ]
    header = ["", "sampling", "solves for 0.5 %", "error in % (solves)"]
    print(table(f"(f) Errors in % of the range, {arguments.backend}", header, rows))
    states, responses = samples["farthest points"][SIZES.index(SOLVES)]
    rows = default_rows(library.training_set(states, responses), *unseen)
    print(
        table(
            f"(f) Default potentials from {SOLVES} solves, the worst seed", ["", "P_E", "P_E,22", "φ"], rows
        )
    )


if __name__ == "__main__":
    main()
