"""Units of the report and of its figures in ``metrics.json``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.core.units import OutputUnits, ResultUnits, Scales, value_of
from porocore.report.context import reactions
from porocore.report.dimensional import FIGURES, figures_with_units
from porocore.report.format import number
from porocore.report.html import render
from porocore.report.metrics import case_metrics
from tests.helpers.report_page import Page


def test_a_study_with_units_speaks_in_them(context):
    """Summary, cell, body, warnings and the texts of pictures; only factors and shares are plain numbers."""
    units = ResultUnits(
        Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
    )
    page = Page(render(replace(context, units=units, published=None)))
    minutes = number(case_metrics(context.cases[0])["nonlinear"]["time_to_95_percent"] * 2000 / 60, 3)
    for text in (
        "final settlement is 20.00 mm",
        f"95 % of its final value at t = {minutes} min",
        "settlement [mm]",
        "pressure [mmHg]",
        "volume [mm³]",
        "The first points are flagged at t = ",
        f"{number(context.cell.linear.stiffness[1, 1, 1, 1] * 2000 / 133.322387415)} mmHg",
        "4.850 · 10⁻¹⁴ m²",
        "−0.007566 1/mmHg",
        "Numbers have the units of the study",
        "The scales are in SI units. All other values are dimensionless",
    ):
        assert text in page.words.replace("|", ""), text
    assert "Numbers without a unit are dimensionless" not in page.words
    texts = " ".join(image["alt"] for image in page.all("img"))
    assert "along the column at t = 33.3333 min, 333.333 min, 1333.33 min" in texts


def test_figures_of_metrics_have_their_unit_beside_them():
    units = ResultUnits(
        Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
    )
    given = {"load": -0.2, "nonlinear": {"final_settlement": 0.25, "time_to_95_percent": None, "steps": 3}}
    found = figures_with_units(given, units)
    assert found["nonlinear"]["final_settlement"] == {"value": 2.5, "unit": "mm", "dimensionless": 0.25}
    assert (found["load"], found["nonlinear"]["steps"]) == (-0.2, 3)
    assert found["nonlinear"]["time_to_95_percent"] is None
    assert figures_with_units(given, ResultUnits()) == given
    times = [value_of(f"{k / 10} min", "time", units.scales) for k in range(1, 30)]
    told = figures_with_units({"end_time": times, "potential": np.array([[1.0], [2.0]])}, units)
    assert told["end_time"]["value"] == [k / 10 for k in range(1, 30)]
    assert np.shape(told["potential"]["value"]) == (2, 1)


def test_every_figure_of_a_solution_has_a_unit_or_is_known_to_have_none(context):
    """A new figure is listed in FIGURES, or here."""
    plain = {"load", "steady_drift", "flagged_end", "flagged_largest", "flagged_time_mean"}
    plain |= {"steps", "newton_iterations", "drift", "drop", "peak_over_final", "drained_paper_ratio"}
    plain |= {"settlement_ratio", "time_to_95_percent_ratio", "time_to_99_percent_ratio", "drained_ratio"}
    plain |= {
        "largest_settlement_ratio",
        "largest_drained_ratio",
        "largest_displacement_ratio",
        "moves_along_y",
    }

    def names(figures):
        for key, value in figures.items():
            if isinstance(value, dict):
                yield from names(value)
            elif isinstance(value, float | int):
                yield key

    moved = {"punch": np.linspace(0, 1, len(context.cases[0].nonlinear.history.time))[:, None] * np.ones(3)}
    force = reactions(replace(context.cases[0].nonlinear, reactions=moved))["punch"]
    assert {*names(case_metrics(context.cases[0])), *names(force)} <= plain | set(FIGURES)
