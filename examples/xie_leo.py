"""A law of one's own in the macro solver: large-strain consolidation of clay (Xie & Leo 2004).

Run it with ``python examples/xie_leo.py [BACKEND]``. A macroscopic law derives ``porocore.MacroLaw`` and returns
stress, storage, flux and their exact derivatives. ``ClayLaw`` in ``porocore/commands/verify/xie_leo.py`` is one.
``porocore verify --case xie-leo`` compares it with the published numbers.
"""

import sys

from porocore.commands.verify.xie_leo import ClayLaw, column, mean_pressure
from porocore.macro.analytic import XieLeo
from porocore.plugins.registry import get

YEAR = 365.25 * 86400.0


def main() -> None:
    """Solve the layer and print its history beside the closed form."""
    layer = XieLeo()
    times = tuple(years * YEAR for years in (5, 10, 20, 40, 80))
    solver = get("macro solver", sys.argv[1] if len(sys.argv) > 1 else "skfem")()
    solution = solver.solve(
        solver.prepare(column(layer, elements=20, steps=200, times=times)), ClayLaw(layer)
    )
    print("years   settlement [m]        consolidation by pressure")
    print("        solved   closed form  solved   closed form")
    for i, profile in enumerate(solution.after_rest):
        settlement = -profile.u[:, 1].min()
        degree = 1 - mean_pressure(solution, i) / layer.load
        print(
            f"{profile.time / YEAR:5.0f}   {settlement:.4f}   {layer.settlement(profile.time):.4f}       "
            f"{degree:.4f}   {layer.degree_by_pressure(profile.time):.4f}"
        )


if __name__ == "__main__":
    main()
