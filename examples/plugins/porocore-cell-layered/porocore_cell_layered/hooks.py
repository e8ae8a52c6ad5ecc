"""What this plugin offers. Listing plugins imports this module, so it imports nothing heavy."""

from porocore import Offer, hookimpl

#: The version of the interface that this plugin was made for.
POROCORE_INTERFACES = {"cell solver": 1}


def _load():
    from porocore_cell_layered.cell_solver import LayeredCellSolver

    return LayeredCellSolver


def _suites():
    from porocore_cell_layered.conformance import TestLayeredCellSolver

    return [TestLayeredCellSolver]


@hookimpl
def porocore_cell_solvers():
    return [
        Offer(
            name="layered",
            load=_load,
            summary="plane layers of solids and fluid in closed form, at finite strain",
            requires=("numpy",),
            install="pip install porocore-cell-layered",
            suites=_suites,
        )
    ]
