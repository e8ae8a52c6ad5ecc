"""Figures and sentences where a load does not stay: largest values, remnants, heave, suction, forces that are gone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.units import ResultUnits
from porocore.report.context import LoadingMode, end_words, no_relaxation, relaxation
from porocore.report.dimensional import dimensional_rows
from porocore.report.figures import history_figure
from porocore.report.html import render
from porocore.report.metrics import LoadCase, case_metrics, time_to_fraction, time_within
from porocore.report.words.results import case_sentences, case_warnings, largest_rows
from tests.helpers.report_page import Page

#: When the load is taken away.
OFF = 50.0


def unloaded(solution, left, peak=2.0, rate=1.0):
    """The solution, loaded from the start and, from t = 50 on, but for the share that is left."""
    time = solution.history.time
    gone = np.where(time > OFF, 1 - np.exp(-rate * (time - OFF)), 0.0)
    shape = (1 - np.exp(-rate * time)) - (1 - left) * gone
    history = replace(
        solution.history,
        settlement=peak * shape,
        displacement=peak * np.abs(shape),
        drained=0.1 * peak * shape,
        drained_paper=0.1 * peak * shape + 1e-5,
        flagged=0 * time,
    )
    return replace(solution, history=history)


def of_unloading(column, left):
    return LoadCase(
        unloaded(column(beyond=None), left), unloaded(column(law="linear", beyond=None), left, peak=2.5)
    )


def test_a_settlement_that_is_gone_is_told_by_its_peak(column):
    """After full unloading the report said "still changed by 4077 %", "4.2 % larger", "95 % at t = 1e-9 s"."""
    case = of_unloading(column, 0.0)
    metrics = case_metrics(case)
    for law in (metrics["nonlinear"], metrics["linear"]):
        assert law["time_to_95_percent"] is law["time_to_99_percent"] is None
        assert law["steady_drift"] < 1e-12
    for name in ("settlement", "drained", "drained_paper", "time_to_95_percent", "time_to_99_percent"):
        assert metrics[f"{name}_ratio"] is None
    assert metrics["largest_settlement_ratio"] == pytest.approx(0.8)
    assert metrics["largest_drained_ratio"] == pytest.approx(0.8)
    assert metrics["nonlinear"]["largest_settlement"] == pytest.approx(2)
    # 1 − e^{−t} is within 0.1 % of 1 from ln 1000 on; the steps are some 0.7 long there.
    assert 0 <= metrics["nonlinear"]["time_of_largest_settlement"] - math.log(1000) < 1
    assert case_warnings(metrics) == []
    peak, left = case_sentences(metrics)
    assert peak.startswith("Under the load −0.2 the largest settlement is 2.000 at t = ")
    assert peak.endswith("with linear poroelasticity. The nonlinear one is 20.0 % smaller.")
    assert left == "At the end, less than 1 % of it is left."
    marks = [len(line.get_xdata()) for line in history_figure(*case.both).axes[0].lines]
    assert 1 not in marks


def test_a_settlement_that_goes_back_is_told_from_when_it_stays(column):
    """Half unloaded from 40 s on, it was said to reach 95 % of its final value at 2.2 s, on its way up."""
    metrics = case_metrics(of_unloading(column, 0.4))
    # 0.4 + 0.6 e^{−(t − 50)} comes to 1.05 and 1.01 times 0.4.
    for percent, band in ((95, 0.05), (99, 0.01)):
        exact = OFF + math.log(0.6 / (0.4 * band))
        assert metrics["nonlinear"][f"time_to_{percent}_percent"] == pytest.approx(exact, abs=0.1)
    assert metrics["settlement_ratio"] == pytest.approx(0.8)
    told = " ".join(case_sentences(metrics))
    assert "the largest settlement is 2.000" in told
    assert "At the end, it is 0.8000 and 1.000. The nonlinear one is 20.0 % smaller." in told
    assert "The nonlinear settlement stays within 5 % of its final value from t = 53." in told
    assert "reaches 95 %" not in told


def test_a_settlement_that_only_grows_has_the_times_that_it_had(column):
    history = column().history
    for share in (0.95, 0.99):
        assert time_within(history.time, history.settlement, share) == time_to_fraction(
            history.time, history.settlement, share
        )
    metrics = case_metrics(LoadCase(column(), column(law="linear")))
    assert largest_rows([metrics], settles=True) == []
    assert "final settlement is" in case_sentences(metrics)[0]


@pytest.mark.usefixtures("undrawn")
def test_largest_values_stand_in_a_table(context, column):
    case = of_unloading(column, 0.0)
    text = Page(render(replace(context, warnings=(), cases=(case,)))).text
    assert "Largest values" in text
    assert "ratio0.80000.8000" in text.replace(" ", "")
    assert "Largest values" not in Page(render(context)).text
    rows = dimensional_rows(
        case_metrics(case), case.nonlinear, np.eye(3), {"this study": ResultUnits()}, LoadingMode()
    )
    found = {row.name: row.dimensionless for row in rows}
    assert found["largest settlement"] == "2.000"
    assert found["largest drained volume"] == "0.2000"
    assert [name for name in found if name.startswith("largest Darcy flux at the times of the profiles (")]


def moving_up(solution, u_2, p):
    """The solution without settlement, but with a heave at one time and a suction at the next."""
    heave, least = np.zeros((2, len(solution.history.time)))
    heave[3], least[4] = u_2, p
    still = replace(
        solution.history, settlement=0 * heave, heave=heave, pressure_min=least, displacement=heave
    )
    return replace(solution, history=still, profiles=())


def test_heave_is_told_where_nothing_settles(column):
    """The report said "The nonlinear settlement is –."."""
    solution = moving_up(column(), 0.25, 0.0)
    metrics = case_metrics(LoadCase(solution, moving_up(column(law="linear"), 0.2, 0.0)))
    (told,) = case_sentences(metrics)
    assert told.startswith(
        "Under the load −0.2 no point of the body moves in the direction −y. The largest displ"
    )
    assert "is 0.2500 at t = " in told
    assert "and 0.2000 at t = " in told
    assert case_sentences(metrics, settles=False) == []
    rows = dimensional_rows(metrics, solution, np.eye(3), {"this study": ResultUnits()}, LoadingMode())
    assert rows[0].name.startswith("largest displacement along +y")
    assert rows[0].dimensionless == "0.2500"
    assert not [row for row in rows if "settlement" in row.name]
    bare = moving_up(solution, 0.0, 0.0)
    (told,) = case_sentences(case_metrics(LoadCase(bare, None)))
    assert told == "Under the load −0.2 no point of the body moves in the direction −y."


def test_a_body_that_rises_is_told_by_its_heave(context, column, unpictured):
    """The table of a gel that swelled by 0.65 mm said "settlement 0 mm"."""
    up, dipping = moving_up(column(), 0.25, 0.0), moving_up(column(law="linear"), 0.2, 0.0)
    page = Page(render(replace(context, published=None, cases=(LoadCase(up, dipping),)))).text
    assert "largestheaveat t" in page
    assert "nonlinear0.2500" in page
    assert "ratio1.250" in page
    assert "finalsettlement" not in page
    # One that dips a little at first has a settlement too, and one that bulges a little has none of these columns.
    dip = replace(up, history=replace(up.history, settlement=np.full_like(up.history.heave, 0.01)))
    text = Page(render(replace(context, published=None, cases=(LoadCase(dip, dipping),)))).text
    assert "largestheaveat t" in text
    assert "finalsettlement" in text
    told = case_sentences(case_metrics(LoadCase(dip, dipping)))
    assert told[0].startswith("The largest heave, in the direction +y, is 0.2500 at t = ")
    bulging = column()
    for share, shown in ((0.2, True), (0.01, False)):
        heave = share * bulging.history.settlement
        bulged = LoadCase(replace(bulging, history=replace(bulging.history, heave=heave)), None)
        told = case_sentences(case_metrics(bulged))
        assert ("The largest heave" in told[-1]) == shown
        assert told[0].startswith("Under the load −0.2 the final settlement")
        assert "largestheave" not in Page(render(replace(context, cases=(bulged,)))).text


def test_suction_is_told_unless_it_is_small(column):
    pressure = float(column().history.pressure_max.max())
    for share, shown in ((-0.5, True), (-0.01, False)):
        solution = moving_up(column(), 0.25, share * pressure)
        metrics = case_metrics(LoadCase(solution, None))
        assert metrics["nonlinear"]["least_pressure"] == share * pressure
        assert metrics["nonlinear"]["time_of_least_pressure"] == solution.history.time[4]
        told = " ".join(case_sentences(metrics, settles=False))
        assert told.startswith("The least pore pressure is ") == shown
        rows = dimensional_rows(metrics, solution, np.eye(3), {"this study": ResultUnits()}, LoadingMode())
        assert any(row.name.startswith("least pore pressure") for row in rows) == shown


def test_a_force_that_is_gone_has_no_figures_of_its_end():
    """A force of 1e-9 of its peak had a ratio of 3e8, a drift of 4690 %, and was still changing."""
    time = np.linspace(0, 30, 301)
    found = relaxation(time, np.where(time < 20, 5.0, 5 * np.exp(-2 * (time - 20))))
    for key in ("drift", "equilibrium", "peak_over_final", "relaxed_50_percent", "relaxed_95_percent"):
        assert found[key] is None
    assert found["peak"] == 5
    assert end_words(found) == no_relaxation(found) == "gone"
