"""What the figures draw, asked of the figures themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.report.context import TrainingCurve
from porocore.report.figures import (
    PROFILE_FIELDS,
    body_figure,
    history_figure,
    parity_figure,
    png_bytes,
    profile_figure,
    relaxation_figure,
    samples_figure,
    series_figure,
    svg_bytes,
    training_figure,
)
from porocore.report.figures.curves import ColumnAxis, early_peak, end_of_rise, panels
from porocore.report.figures.style import new_figure
from porocore.report.words.held_out import OutputCheck
from porocore.states import Status


@pytest.fixture(scope="module")
def pair(column):
    return column(), column(law="linear", final=2.5, rate=0.06, beyond=None)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def assert_no_overlap(figure):
    """The legend covers no panel, and everything lies on the page."""
    figure.canvas.draw()
    page = figure.bbox
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    for box in boxes:
        assert page.x0 - 1 <= box.x0 <= box.x1 <= page.x1 + 1
        assert page.y0 - 1 <= box.y0 <= box.y1 <= page.y1 + 1
    for i, box in enumerate(boxes):
        others = boxes[:i] + [shown.get_window_extent() for shown in figure.legends]
        assert not any(box.overlaps(other) for other in others)


@pytest.mark.parametrize("log_time", [False, True])
def test_history(pair, log_time):
    figure = history_figure(*pair, log_time=log_time)
    settlement, _, drained = figure.axes
    line = settlement.get_lines()[0]
    first = 1 if log_time else 0
    np.testing.assert_array_equal(line.get_ydata(), pair[0].history.settlement[first:])
    assert drained.get_xscale() == ("log" if log_time else "linear")
    assert legend(figure)[:2] == ["nonlinear", "linear"]
    assert_no_overlap(figure)


@pytest.mark.parametrize(
    "quantity", ["p", *(pytest.param(q, marks=pytest.mark.slow) for q in PROFILE_FIELDS if q != "p")]
)
def test_profiles_are_labelled_and_do_not_overlap(pair, quantity):
    figure = profile_figure(*pair, quantity)
    (axes,) = figure.axes
    assert axes.get_xlabel()
    assert axes.get_ylabel().endswith("[–]")
    assert [text for text in legend(figure) if text.startswith("$t$")] == [
        "$t$ = 1",
        "$t$ = 10",
        "$t$ = 40",
    ]
    assert_no_overlap(figure)


def test_profile_flags_what_lies_beyond_the_sampled_range(pair):
    nonlinear, linear = pair
    figure = profile_figure(nonlinear, linear, "H22", times=(10.0,))
    profile = nonlinear.profiles[1]
    flagged = profile.flagged > 0
    assert 0 < flagged.sum() < len(flagged)
    full = next(line for line in figure.axes[0].get_lines() if line.get_label() == "$t$ = 10")
    np.testing.assert_array_equal(np.isnan(full.get_ydata()), flagged)
    assert "flagged" in legend(figure)
    inside = replace(nonlinear, profiles=(replace(profile, flagged=np.zeros(len(flagged))),))
    assert "flagged" not in legend(profile_figure(inside, linear, "H22", times=(10.0,)))


def test_line_through_a_box_of_several_elements_across(column):
    solution = column(elements=(2, 5, 3))
    line = ColumnAxis.from_solution(solution)
    np.testing.assert_allclose(line.node_y, np.linspace(0, 7.5, 11), rtol=0, atol=1e-12)
    np.testing.assert_allclose(line.element_y, 7.5 * (np.arange(5) + 0.5) / 5, rtol=0, atol=1e-12)
    profile = replace(solution.profiles[0], flagged=np.zeros(30))
    profile.flagged[line.elements[1]] = 0.1  # y from 1.5 to 3: nodes 2, 3, 4
    _, _, nodes = line.series(profile, PROFILE_FIELDS["p"])
    _, _, elements = line.series(profile, PROFILE_FIELDS["H22"])
    np.testing.assert_array_equal(np.flatnonzero(nodes), [2, 3, 4])
    np.testing.assert_array_equal(np.flatnonzero(elements), [1])


def test_profile_of_an_unknown_quantity_or_time(pair):
    with pytest.raises(ValueError, match="unknown quantity 'K12'; choose from p, settlement"):
        profile_figure(*pair, "K12")
    with pytest.raises(ValueError, match="no profile at t = 3; it has 1, 10, 40, 100"):
        profile_figure(*pair, "p", times=(3.0,))


def test_samples_by_status():
    inputs = InputSpace(("p", "H12", "H22"), (0, -1, -0.4), (1, 1, 0.04))
    rng = np.random.default_rng(0)
    x = rng.uniform(inputs.lower, inputs.upper, (10 * len(Status), 3))
    status = np.repeat([int(s) for s in Status], 10)
    training = np.isin(status, [Status.converged, Status.contact])
    figure = samples_figure(
        inputs, x, status, training=training, visited=[x[:5], x[5:9]], crease=(-0.15, -0.33)
    )
    (axes,) = figure.axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    for state in Status:
        name = state.name.replace("_", " ")
        np.testing.assert_array_equal(
            lines[f"{name} (10)"].get_xydata(), x[status == state][:, [2, 0]]
        )  # H22 across, p upwards
    hull = lines["sampled range"].get_xydata()
    low, high = x[training][:, [2, 0]].min(axis=0), x[training][:, [2, 0]].max(axis=0)
    np.testing.assert_allclose([hull.min(axis=0), hull.max(axis=0)], [low, high])
    markers = {lines[f"{s.name.replace('_', ' ')} (10)"].get_marker() for s in Status}
    assert len(markers) == len(Status)  # told apart without colour
    assert "states in the column" in legend(figure)
    assert_no_overlap(figure)
    low, high = x[:, 1].min(), x[:, 1].max()
    assert (
        f"on no axis, but projected:\n$\\partial u_1 / \\partial X_2$ from −{-low:.2f} to {high:.2f}"
        in axes.get_xlabel()
    )
    place = np.tile(x[:1], (5, 1))
    (axes,) = samples_figure(inputs, x, status, visited=[place], column=False).axes
    (states,) = [line for line in axes.get_lines() if line.get_label() == "states in the body"]
    assert states.get_marker() == "*", "a path of one place is seen"
    assert states.get_linewidth() == 0, "neighbours in the list are no neighbours in the body"


def test_samples_of_one_input_and_of_an_unknown_one():
    inputs = InputSpace(("H22",), (-0.4,), (0.04,))
    x, status = np.linspace(-0.4, 0.04, 9)[:, None], np.zeros(9, int)
    figure = samples_figure(inputs, x, status, training=status == 0)
    assert legend(figure) == ["converged (9)"]
    with pytest.raises(ValueError, match="'p' was not sampled; the inputs are H22"):
        samples_figure(inputs, x, status, pair=("H22", "p"))


def test_parity_says_the_error():
    solved = np.linspace(0, 1, 21)
    check = OutputCheck("$y$", "y", solved, solved + 0.01, 2.0, solved > 0.9)
    figure = parity_figure([check, check])
    assert len(figure.axes) == 4
    text = figure.axes[0].texts[0].get_text()
    assert "RMS 0.5 % of range" in text
    assert "19 states" in text
    assert "(2 beyond the range" in text
    assert_no_overlap(figure)


def test_parity_without_held_out_states_says_so():
    none = np.zeros(0)
    figure = parity_figure([OutputCheck("$y$", "y", none, none, 1.0, none.astype(bool))])
    assert figure.axes[0].texts[0].get_text() == "no held-out states"


def test_parity_of_states_that_all_lie_beyond_counts_them():
    solved = np.linspace(0, 1, 21)
    check = OutputCheck("$y$", "y", solved, solved + 0.01, 2.0, np.ones(21, bool))
    figure = parity_figure([check])
    text = figure.axes[0].texts[0].get_text()
    assert "RMS 0.5 % of range" in text
    assert "21 states, all beyond the range (hollow)" in text
    assert_no_overlap(figure)


def test_training_marks_the_best_epoch():
    epoch = np.arange(0.0, 100, 10)
    figure = training_figure(TrainingCurve(epoch, np.exp(-epoch), 1 + (epoch - 60) ** 2))
    assert "best, epoch 60" in legend(figure)
    assert figure.axes[0].get_yscale() == "log"
    assert_no_overlap(figure)


def test_training_without_validation_has_one_curve_over_iterations():
    iteration = np.arange(25.0, 200, 25)
    figure = training_figure(TrainingCurve(iteration, 1 / iteration, np.full(7, np.nan)))
    assert len(figure.axes[0].lines) == 1
    assert figure.axes[0].get_xlabel() == "iteration"
    assert not any(word in str(legend(figure)) for word in ("validation", "best"))


def test_the_same_figure_gives_the_same_bytes(pair):
    first, second = (svg_bytes(profile_figure(*pair, "p")) for _ in range(2))
    assert first == second


def test_a_peak_early_in_a_long_run_has_a_stretched_axis_of_time(pair):
    """A force that is there after 1 % of the time is shown as wide as what follows, in order of time."""
    solution, _ = pair
    time = solution.history.time
    ramp = time[2]
    force = np.where(time <= ramp, time / ramp, 0.6 + 0.4 * np.exp(-(time - ramp) / (3 * ramp)))
    long = replace(solution, compression={"y+": force}, reactions={}, probes={}, inflow={})
    assert ramp < 0.05 * time[-1]
    figure = series_figure(long, long, "forces of held or moved surfaces")
    (axes,) = figure.axes
    assert axes.get_xscale() == "symlog"
    assert axes.get_xlabel().endswith(f"logarithmic after {ramp:g}")
    assert f"{ramp:g}" in [text.get_text() for text in axes.get_xticklabels()]
    shown = axes.transData.transform(np.stack([[0, ramp, time[-1]], np.zeros(3)], axis=1))[:, 0]
    assert 0.15 < (shown[1] - shown[0]) / (shown[2] - shown[0]) < 0.6
    assert_no_overlap(figure)


def test_only_an_early_peak_stretches_the_axis():
    time = np.linspace(0, 100, 1001)
    peak = np.where(time <= 1, time, 0.5 + 0.5 * np.exp(1 - time))
    assert early_peak(time, [peak]) == 1
    assert early_peak(time, [np.minimum(time, 1)]) is None  # it rises and stays
    assert (
        early_peak(time / 10, [np.where(time <= 10, time / 10, 0.5)]) is None
    )  # a tenth of the time is wide enough
    again = peak + np.sin(time) * (time > 20)
    assert early_peak(time, [again]) is None  # most comes later


def test_ticks_are_plain_and_a_factor_beside_the_axis_is_a_formula():
    """A formula at every tick made most of the time of a report."""
    figure = new_figure(3, 2)
    axes = figure.add_subplot()
    axes.plot([-2e-6, 1e-6], [-1, 2])
    drawn = png_bytes(figure)
    labels = [text.get_text() for axis in (axes.xaxis, axes.yaxis) for text in axis.get_ticklabels()]
    assert "\N{MINUS SIGN}1" in labels
    assert not any("$" in label for label in labels)
    assert "10^{" in axes.xaxis.get_offset_text().get_text()
    assert png_bytes(figure) == drawn


def test_a_figure_is_laid_out_once_and_looks_the_same_in_each_form(pair, monkeypatch):
    figure = profile_figure(*pair, "p")
    laid_out = []
    execute = type(figure.get_layout_engine()).execute
    monkeypatch.setattr(
        type(figure.get_layout_engine()),
        "execute",
        lambda self, figure: laid_out.append(figure) or execute(self, figure),
    )
    svg_bytes(figure)
    place = figure.axes[0].get_position().bounds
    png_bytes(figure)
    assert laid_out == [figure]
    assert figure.axes[0].get_position().bounds == place


@pytest.mark.parametrize("falls", [True, False])
def test_a_force_that_relaxes_is_drawn_from_its_peak_on(pair, falls):
    """After a ramp of a tenth of the run the relaxation took a tenth of the axis."""
    solution, _ = pair
    time = solution.history.time
    force = np.minimum(1, time / 10) * (0.6 + 0.4 * np.exp(-np.maximum(time - 10, 0)) if falls else 1)
    found = replace(solution, compression={"y+": force}, reactions={}, probes={}, inflow={})
    (panel,) = panels(found)
    assert end_of_rise(found, panel) == (10 if falls else None)
    if falls:
        figure = relaxation_figure(found, found, panel.plain)
        (axes,) = figure.axes
        assert axes.get_xscale() == "log"
        line = axes.lines[0]
        np.testing.assert_allclose(line.get_xdata(), time[time > 10] - 10)
        np.testing.assert_allclose(line.get_ydata(), force[time > 10])
        assert_no_overlap(figure)


def test_a_prescribed_settlement_is_not_drawn(pair):
    """Its panel had markers of 95 % of the final value, which was prescribed."""
    figure = history_figure(*pair, settles=False)
    assert [axes.get_ylabel().split(" [")[0].split("$")[0] for axes in figure.axes] == [
        "largest pore pressure ",
        "drained volume",
    ]
    assert not any("%" in text for text in legend(figure))
    assert {"nonlinear", "linear"} <= set(legend(figure))


@pytest.mark.parametrize("log_time", [False, True])
def test_a_body_that_swells_has_its_heave_and_suction_drawn(pair, log_time):
    """The panel of the settlement was empty, and that of the largest pressure showed 1e-16."""

    def swelling(solution, size):
        history = replace(
            solution.history,
            settlement=0 * solution.history.settlement,
            pressure_max=1e-16 * solution.history.pressure_max,
            heave=size * solution.history.settlement,
            pressure_min=-size * solution.history.pressure_max,
        )
        return replace(solution, history=history)

    units = ResultUnits(Scales(modulus=4e4, length=1e-3, pore=8e-6), OutputUnits(length="mm", stress="kPa"))
    both = swelling(pair[0], 2.0), swelling(pair[1], 1.0)
    with using_units(units):
        figure = history_figure(*both, log_time=log_time)
    heave, suction, _ = figure.axes
    assert heave.get_ylabel() == "heave max$(u_2)$ [mm]"
    assert suction.get_ylabel() == "least pore pressure $p$ [kPa]"
    history = pair[0].history
    kept = history.time > 0 if log_time else history.time >= 0
    np.testing.assert_allclose(heave.get_lines()[0].get_xdata(), history.time[kept] * units.factor("time"))
    raised = 2 * history.settlement[kept]  # 1 mm is 1
    np.testing.assert_allclose(heave.get_lines()[0].get_ydata(), raised)
    least = -2 * 40 * history.pressure_max[kept]  # 40 kPa is 1
    np.testing.assert_allclose(suction.get_lines()[0].get_ydata(), least)
    assert {"nonlinear", "linear"} <= set(legend(figure))
    assert not any("%" in text for text in legend(figure))
    assert_no_overlap(figure)
    # A law that settles keeps the settlement and the largest pressure.
    for other in (pair[1],):
        axes = history_figure(both[0], other, log_time=log_time).axes
        assert axes[0].get_ylabel().startswith("settlement")
        assert axes[1].get_ylabel().startswith("largest")


@pytest.mark.parametrize("height", [0.3, 2.0, 3.0, 30.0])
def test_labels_of_a_body_lie_in_its_picture(pair, height):
    """The label of the axis upwards of a plug of 4 mm by 3 mm was cut off."""
    solution, _ = pair
    points = solution.points / np.ptp(solution.points, axis=0) * [4.0, height, 4.0]
    wide = replace(solution, points=points)
    units = ResultUnits(Scales(modulus=4e4, length=1e-3, pore=8e-6), OutputUnits(length="mm", stress="kPa"))
    flat = replace(wide.profiles[-1], u=np.zeros_like(points))
    with using_units(units):
        figure = body_figure(wide, flat)
    png_bytes(figure)  # Saving must not lay it out again.
    body, bar = figure.axes
    box = body.get_tightbbox()
    assert box.x0 >= 0
    assert box.y0 >= 0
    assert box.x1 <= bar.get_tightbbox().x0
    assert box.y1 <= figure.bbox.y1
