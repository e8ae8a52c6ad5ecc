"""Figures of merit against a history that is known in closed form, and numbers as text."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.report.format import difference, duration, number, percent, plain
from porocore.report.metrics import (
    LoadCase,
    case_metrics,
    solution_metrics,
    steady_drift,
    time_to_fraction,
    without_settlement,
)
from porocore.report.words.held_out import (
    OutputCheck,
    few_in_body,
    rms_percent,
    rms_percent_in_body,
    worst_percent,
    worst_percent_in_body,
)
from porocore.report.words.results import case_warnings, flagged_shares


def exact_time(share: float, rate: float, end: float = 100.0) -> float:
    """When 1 − exp(−rate t) reaches a share of its value at ``end``."""
    return -math.log(1 - share * (1 - math.exp(-rate * end))) / rate


@pytest.mark.parametrize("rate", [0.06, 0.1])
def test_times_of_an_exponential_settlement(column, rate):
    metrics = solution_metrics(column(rate=rate))
    assert metrics["final_settlement"] == pytest.approx(2.0 * (1 - math.exp(-rate * 100)), rel=1e-14)
    for percent_, key in ((0.95, "time_to_95_percent"), (0.99, "time_to_99_percent")):
        late = metrics[key] - exact_time(percent_, rate)
        # The chord lies below a concave curve: late by h²/8 |f''|/f' = h² rate/8 at most (h = 0.5).
        assert 0 <= late < 0.5**2 * rate / 8 * (1 + 0.5 * rate)


def test_interpolation_converges_with_the_step():
    def error(n: int) -> float:
        time = np.linspace(0, 100, n)
        return abs(time_to_fraction(time, 1 - np.exp(-0.1 * time), 0.95) - exact_time(0.95, 0.1))

    # The nodes lie differently in each grid, so orders are taken from the worst of many.
    coarse, fine = max(error(n) for n in range(101, 141)), max(error(2 * n - 1) for n in range(101, 141))
    assert math.log2(coarse / fine) == pytest.approx(2, abs=0.3)


def test_ratios_and_losses_of_a_case(column):
    metrics = case_metrics(LoadCase(column(), column(law="linear", final=2.5, rate=0.06, beyond=None)))
    expected = 2.0 * (1 - math.exp(-10)) / (2.5 * (1 - math.exp(-6)))
    assert metrics["settlement_ratio"] == pytest.approx(expected, rel=1e-13)
    assert metrics["drained_ratio"] == pytest.approx(expected, rel=1e-13)
    assert metrics["time_to_99_percent_ratio"] == pytest.approx(
        exact_time(0.99, 0.1) / exact_time(0.99, 0.06), rel=1e-3
    )
    assert metrics["nonlinear"]["stress_spread"] == pytest.approx(1e-9, rel=1e-12)
    assert metrics["nonlinear"]["drained"] * 1.12 == pytest.approx(metrics["nonlinear"]["drained_paper"])


def test_flagged_shares(column):
    solution = column()
    time = solution.history.time
    outside = np.where(time > 75, 0.2, np.where(time > 50, 0.6, 0.0))
    metrics = solution_metrics(replace(solution, history=replace(solution.history, flagged=outside)))
    assert metrics["flagged_end"] == 0.2
    assert metrics["flagged_largest"] == 0.6
    assert metrics["flagged_time_mean"] == pytest.approx((25 * 0.6 + 25 * 0.2) / 100, rel=1e-12)


def test_a_body_that_does_not_move_has_no_times(column):
    case = LoadCase(column(final=0.0), column(final=0.0, law="linear"))
    metrics = case_metrics(case)
    assert metrics["nonlinear"]["time_to_95_percent"] is None
    assert metrics["settlement_ratio"] is None
    assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics


def test_warns_of_a_run_that_ends_too_early(column):
    early = column(rate=0.01, beyond=None)
    # s(t) = 1 − e^{−t/100}: from t = 90 to 100 it grows by (e^{−0.9} − e^{−1})/(1 − e^{−1}) of its end value
    assert steady_drift(early.history) == pytest.approx((math.exp(-0.9) - math.exp(-1)) / (1 - math.exp(-1)))
    (warning,) = case_warnings(case_metrics(LoadCase(early, column(law="linear", beyond=None))))
    assert "nonlinear" in warning
    assert "6.1 %" in warning


def test_warns_of_flagged_states_only(column):
    calm, linear = column(beyond=None), column(law="linear", beyond=None)
    assert case_warnings(case_metrics(LoadCase(calm, linear))) == []
    (warning,) = case_warnings(case_metrics(LoadCase(column(beyond=-0.2), linear)))
    assert "Load −0.2: parts of the body are flagged." in warning
    assert "at the end of the run it is 100.0 %" in warning


def test_a_share_that_is_zero_in_words_is_no_warning(column):
    solution, linear = column(beyond=None), column(law="linear", beyond=None)
    for share, warns in ((4e-4, 0), (6e-4, 1)):
        outside = np.where(solution.history.time > 50, share, 0.0)
        found = replace(solution, history=replace(solution.history, flagged=outside))
        said = case_warnings(case_metrics(LoadCase(found, linear)))
        assert len(said) == warns
    assert said[0].endswith("No stored profile shows the place. Add the time 50.5 to macro.time.profiles.")
    with using_units(ResultUnits(Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(time="min"))):
        said = case_warnings(case_metrics(LoadCase(found, linear)))
    assert said[0].endswith(
        "No stored profile shows the place. Add the time 1680 min to macro.time.profiles."
    )


def test_two_solutions_of_different_loads_are_no_case(column):
    with pytest.raises(ValueError, match=r"one load, got -0\.2 and -0\.01"):
        LoadCase(column(), column(load=-0.01))


def test_errors_count_the_states_inside_only():
    solved = np.array([0.0, 1.0, 2.0, 3.0])
    check = OutputCheck("x", "x", solved, solved + np.array([0.03, -0.04, 0.0, 9.0]), 2.0, np.arange(4) == 3)
    assert rms_percent(check) == pytest.approx(100 * math.sqrt(25e-4 / 3) / 2)
    assert worst_percent(check) == pytest.approx(2.0)


def test_errors_count_all_states_where_none_lies_inside():
    solved = np.array([0.0, 1.0])
    check = OutputCheck("x", "x", solved, solved + np.array([0.03, -0.04]), 2.0, np.ones(2, bool))
    assert check.all_outside
    assert rms_percent(check) == pytest.approx(100 * math.sqrt(25e-4 / 2) / 2)
    assert worst_percent(check) == pytest.approx(2.0)
    none = np.zeros(0)
    empty = OutputCheck("x", "x", none, none, 2.0, none.astype(bool))
    assert not empty.all_outside
    assert rms_percent(empty) is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (number(1.9999), "2.000"),
        (number(-0.07540), "−0.07540"),
        (number(9.9999e-5, 3), "0.000100"),
        (number(5e-9, 2), "5.0 · 10⁻⁹"),
        (number(0.0), "0"),
        (number(None), "–"),
        (number(float("nan")), "–"),
        (plain(-0.01), "−0.01"),
        (percent(0.8732), "87.3 %"),
        (difference(0.8), "20.0 % smaller"),
        (difference(1.05, "sooner", "later"), "5.0 % later"),
        (difference(1.0001), "the same to 0.05 %"),
        (duration(0.0123), "12.3 ms"),
        (duration(59.6), "59.6 s"),
        (duration(119.7), "2 min 00 s"),
        (duration(7260), "2 h 01 min"),
    ],
)
def test_numbers_as_text(text, expected):
    assert text == expected


def test_says_when_the_body_leaves_the_sampled_range(column):
    solution = column()
    time = solution.history.time
    outside = np.where(time > 75, 1.0, np.where(time > 50, 0.6, 0.0))
    metrics = solution_metrics(replace(solution, history=replace(solution.history, flagged=outside)))
    assert metrics["flagged_first_time"] == time[time > 50][0]
    assert metrics["flagged_all_time"] == time[time > 75][0]
    first, all_of_it = (f"{time[time > t][0]:.3g}" for t in (50, 75))
    assert flagged_shares(metrics) == (
        "Over time the flagged share is at most 100.0 % of the body and on average 40.0 %; at the end of the run it is "
        f"100.0 %. The first points are flagged at t = {first}, and the whole body is flagged at t = {all_of_it}."
    )
    known = {"flagged": outside, "flagged_error": outside, "flagged_closed": outside / 4}
    metrics = solution_metrics(replace(solution, history=replace(solution.history, **known)))
    assert metrics["flagged_reasons"] == {"error": 1.0, "closed": 0.25}
    assert flagged_shares(metrics).endswith(
        "The reasons are: estimated error beyond the tolerance (100.0 % of the body), next to states whose pore walls "
        "touch (25.0 % of the body)."
    )
    within = replace(solution, history=replace(solution.history, flagged=np.zeros_like(time)))
    assert solution_metrics(within)["flagged_first_time"] is None


def test_a_prescribed_settlement_has_no_figures(column):
    metrics = case_metrics(LoadCase(column(), column(law="linear", beyond=None), (column(law="direct"),)))
    left = without_settlement(metrics)
    assert not [name for name in json.dumps(left).split('"') if "settlement" in name or "to_9" in name]
    assert left["nonlinear"].keys() == left["linear"].keys() == left["others"][0].keys()
    gone = {"final_settlement", "time_to_95_percent", "time_to_99_percent"}
    gone |= {
        f"{begin}{name}" for begin in ("", "time_of_") for name in ("largest_settlement", "largest_heave")
    }
    assert metrics["nonlinear"].keys() - left["nonlinear"].keys() == gone
    assert left["nonlinear"]["max_pressure"] == metrics["nonlinear"]["max_pressure"]
    assert left["drained_ratio"] == metrics["drained_ratio"]


def test_errors_as_a_share_of_the_range_that_the_body_uses():
    """A force that was 0.5 % off was read as 0.09 % off, which was of a range three times that of the body."""
    solved = np.array([-0.1, -0.6, -0.7, -0.9])
    check = OutputCheck("x", "x", solved, solved + 0.002, 1.0, np.zeros(4, bool), in_body=(-0.4, 0.0))
    assert rms_percent(check) == pytest.approx(0.2)
    assert rms_percent_in_body(check) == worst_percent_in_body(check) == pytest.approx(0.5)
    assert check.counted_in_body == 1
    assert few_in_body([check]).startswith(
        "For x, most held-out states lie outside the range of values in the body."
    )
    wide = replace(check, in_body=(-0.8, 0.0))
    assert few_in_body([wide]) == ""
    for unknown in (None, (0.2, 0.2)):
        unused = replace(check, in_body=unknown)
        assert (rms_percent_in_body(unused), few_in_body([unused])) == (None, "")
