"""Laws beside one another: gaps between their histories, in figures of merit, in the figure and on the page."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from porocore.report.context import DirectCost, history_difference, law_differences
from porocore.report.figures import history_figure
from porocore.report.metrics import LoadCase, case_metrics


@pytest.fixture(scope="module")
def case(column):
    linear = column(law="linear", final=2.6, beyond=None)
    others = (column(law="direct-potential", final=2.02), column(law="mean-gradient", final=2.1))
    return LoadCase(column(law="potential"), linear, others)


def test_the_gap_is_that_of_the_settlements(case):
    """Settlements of 2 and 2.02 that grow alike are 1 % of 2.02 apart at the end, and nowhere more."""
    found = {(pair["law"], pair["reference"]): pair for pair in law_differences(case)}
    assert set(found) == {
        ("potential", "direct-potential"),
        ("mean-gradient", "direct-potential"),
        ("mean-gradient", "potential"),
    }
    settlement = found["potential", "direct-potential"]["settlement"]
    reached = 1 - np.exp(-0.1 * 100)
    assert settlement["end_percent"] == pytest.approx(-100 * 0.02 / 2.02, rel=1e-6)
    assert settlement["largest_percent"] == pytest.approx(100 * 0.02 / 2.02, rel=1e-6)
    assert settlement["time_of_largest"] == pytest.approx(100.0)
    assert reached == pytest.approx(1, abs=1e-4)
    assert json.loads(json.dumps(law_differences(case), allow_nan=False)) == law_differences(case)


def test_the_largest_gap_is_found_where_it_is(column):
    one = column().history
    bump = np.where(np.isclose(one.time, 7.0), 0.3, 0.0)
    other = replace(one, settlement=one.settlement + bump)
    found = history_difference(one, other, "settlement")
    assert (found["time_of_largest"], found["end_percent"]) == (7.0, 0.0)
    assert found["largest_percent"] == pytest.approx(100 * 0.3 / one.settlement[-1])


def test_only_times_that_both_have_are_compared(column):
    """A solution with halved steps has more times; what it has there is not held against the other."""
    one = column().history
    extra = {name: np.insert(value, 5, 1e3) for name, value in vars(one).items()}
    extra["time"] = np.insert(one.time, 5, (one.time[4] + one.time[5]) / 2)
    other = type(one)(**extra)
    for reference, compared in ((one, other), (other, one)):
        found = history_difference(reference, compared, "settlement")
        assert (found["largest_percent"], found["end_percent"]) == (0.0, 0.0)


def test_a_reference_that_does_not_move_has_no_gap(column):
    still = column(final=0.0).history
    assert history_difference(still, still, "settlement") is None


def test_every_law_is_in_the_figures_of_merit_and_in_the_figure(case):
    metrics = case_metrics(case)
    assert [other["law"] for other in metrics["others"]] == ["direct-potential", "mean-gradient"]
    figure = history_figure(case.nonlinear, case.linear, *case.others)
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    for solution in (case.nonlinear, *case.others):
        np.testing.assert_array_equal(lines[solution.law].get_ydata(), solution.history.settlement)
    colours = {
        line.get_color() for name, line in lines.items() if name in ("potential", "linear", "mean-gradient")
    }
    assert len(colours) == 3


def test_another_load_is_refused(column):
    with pytest.raises(ValueError, match=r"of one load, got -0.2 and -0.01"):
        LoadCase(column(), column(law="linear"), (column(load=-0.01),))


def test_the_speed_up_is_the_ratio_of_the_wall_times():
    cost = DirectCost("direct-potential", -0.1, 100, 40, 1, 9.0, 12.0, 0.5)
    assert cost.speed_up == 24
    assert replace(cost, surrogate_seconds=None).speed_up is None
