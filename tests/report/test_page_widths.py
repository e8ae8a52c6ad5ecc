"""The page of a run in a browser: no table, text or picture is wider than its column."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.units import SCENARIOS, OutputUnits, ResultUnits, Scales
from porocore.report.context import AdaptiveSurrogateCost, DirectCost, LoadingMode
from porocore.report.html import render
from tests.helpers.browser import too_wide

UNITS = ResultUnits(
    Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
)
HASHES = {
    "element": "quadratic",
    "solid tetrahedra in the eighth": "1,234,567",
    "solid nodes in the eighth": "2,345,678",
    "fluid tetrahedra in the eighth": "1,234,567",
    "solid mesh hash": "5dbf1b2a049203d7",
}
PROVENANCE = {"identity of the macro stage": "0123456789abcdef" * 16}


@pytest.mark.usefixtures("undrawn")
def test_no_table_of_the_benchmark_is_cut_off(context):
    """Coefficients, mesh and the column with units were cut off behind a scroll bar at 1,200 and 1,920 pixels."""
    cell = replace(context.cell, mesh=HASHES)
    page = render(replace(context, cell=cell, provenance=PROVENANCE, scenarios=SCENARIOS))
    assert too_wide(page) == []


def test_no_table_of_a_study_with_units_is_cut_off(context, column, unpictured):
    case = context.cases[0]
    solutions = [
        column(law="potential"),
        column(law="mean-gradient-fallback", final=2.1),
        column(law="direct-potential", final=2.01),
    ]
    steps = len(solutions[0].history.time)
    force = np.outer(np.linspace(-1.2345e-6, -0.01, steps), [0, 1, 0])
    up = 3 * solutions[0].history.settlement
    first, *others = (
        replace(
            each,
            history=replace(each.history, heave=up),
            reactions={"the upper plate": force, "lower plate": -force},
        )
        for each in solutions
    )
    main = replace(case, nonlinear=first, others=tuple(others))
    direct = DirectCost("direct-potential", -0.2, 1234567, 567890, 8, 90.0, 120.0, 0.5)
    fallback = AdaptiveSurrogateCost("mean-gradient-fallback", -0.2, 1234, 5, 1229, 78, 1234.5, 12.3)
    made = replace(
        context,
        cell=replace(context.cell, mesh=HASHES),
        surrogate=replace(context.surrogate, closure="potential", exact_closure=True),
        cases=(main, main),
        published=None,
        units=UNITS,
        scenarios={"the other laboratory": UNITS.scales},
        other_surrogates=(context.surrogate,),
        direct=(direct,),
        fallbacks=(fallback,),
        loading_mode=LoadingMode(("the upper plate",), stressed=True),
        config_text="cell: " + "x" * 400,
    )
    assert too_wide(render(made)) == []
