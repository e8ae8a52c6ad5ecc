"""The picture of conductivity.md: how the deformed pore conducts, and what that does to consolidation.

sed 's/^conductivity: .*/conductivity: piola/' benchmarks/conductivity.yaml > piola.yaml
porocore run benchmarks/conductivity.yaml --out runs/deformed
porocore run piola.yaml --out runs/piola
.venv/bin/python docs/make_conductivity_image.py runs/deformed runs/piola
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from porocore.errors import PorocoreError
from porocore.interfaces.solution import History, MacroSolution
from porocore.macro.laws.closure import PulledBack
from porocore.report.figures import png_bytes
from porocore.report.figures.style import BLACK, BLUE, DASHED, DOTTED, GREY, VERMILLION, new_figure, styled
from porocore.states import MacroState
from porocore.study.run.folder import RunFolder
from porocore.study.run.results import load_reference, load_surrogate

IMAGE = Path(__file__).parent / "images" / "conductivity.png"
COMPRESSION = np.linspace(-0.19, 0.02, 60)


def carried_and_solved(folder: RunFolder) -> tuple[np.ndarray, np.ndarray]:
    """K_ref/K (states, 3, 3) along a drained compression: of the undeformed pore carried along, and of the deformed."""
    reference = load_reference(folder)
    H = np.zeros((len(COMPRESSION), 3, 3))
    H[:, 1, 1] = COMPRESSION
    states = MacroState(H, np.zeros(len(H)))
    cell = load_surrogate(folder).predict(states, tangent=False)
    K = reference.conductivity
    carried = PulledBack.from_states(
        states, cell.mean_grad, np.zeros((len(H), 3)), reference.solid_fraction, K
    )
    return carried.conductivity / K[0, 0], cell.conductivity / K[0, 0]


def history(folder: RunFolder, law: str) -> History:
    """Under the first load."""
    return MacroSolution.load_file(folder.solution(law, folder.config.macro.loads[0])).history


@styled
def picture(deformed: RunFolder, piola: RunFolder):
    """Conductivity against compression, and settlement against time."""
    figure = new_figure(8.8, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    carried, solved = carried_and_solved(deformed)
    for K, colour, name in ((solved, BLUE, "deformed"), (carried, VERMILLION, "piola")):
        left.plot(COMPRESSION, K[:, 1, 1], color=colour, label=f"{name}, along the load")
        left.plot(COMPRESSION, K[:, 0, 0], color=colour, ls=DASHED, label=f"{name}, across")
    left.axhline(1, color=GREY, lw=0.8)
    left.set(xlabel="$H_{22}$, drained ($p = 0$) [–]", ylabel=r"$K_\mathrm{ref}/K$ [–]", ylim=(0, None))
    left.set_title("Conductivity of the compressed cell")
    left.legend(loc="lower right")
    lines = (
        (history(deformed, "potential"), BLUE, "-", "deformed"),
        (history(piola, "potential"), VERMILLION, "-", "piola"),
        (history(piola, "linear"), BLACK, DOTTED, "linear poroelasticity"),
    )
    for found, colour, dashes, name in lines:
        right.plot(found.time, found.settlement / found.settlement[-1], color=colour, ls=dashes, label=name)
    right.axhline(0.95, color=GREY, lw=0.8)
    right.text(119, 0.94, "95 %", color=GREY, ha="right", va="top", fontsize=9)
    right.set(xlabel="time $t$ [–]", ylabel="settlement / its final value [–]", xlim=(0, 120), ylim=(0, 1.03))
    load = f"{deformed.config.macro.loads[0]:g}".replace("-", "−")
    right.set_title(f"Consolidation under P = {load}")
    right.legend(loc="lower right")
    return figure


def main() -> None:
    """Write docs/images/conductivity.png from the two run folders that the command line names."""
    if len(sys.argv) != 3:
        sys.exit("usage: python docs/make_conductivity_image.py DEFORMED PIOLA, two finished run folders")
    try:
        found = picture(*(RunFolder.open(name) for name in sys.argv[1:]))
    except PorocoreError as error:
        sys.exit(f"error: {error}")
    IMAGE.write_bytes(png_bytes(found, dpi=120))
    print(f"{IMAGE}: {IMAGE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
