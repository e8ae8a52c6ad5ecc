"""Maps of stability without a cell: plans, files, onsets, and what is drawn where."""

import numpy as np
import pytest

from porocore.cell.stability.map import (
    EVENTS,
    LineSettings,
    MapPlan,
    StabilityLine,
    load,
    save,
    walk,
    write_tables,
)
from porocore.cell.stability.modes import WAVES
from porocore.errors import ConfigurationError, DataError
from porocore.report.figures.stability import stability_figure
from porocore.states import Status

PLAN = MapPlan({"H22": -0.4}, "p", (0.0, 0.1), LineSettings(steps=4))


def made_up(value, onsets, *, n=5, last=Status.contact, eigenvalues=np.nan):
    start, goal = PLAN.ends(value)
    found = np.full((len(EVENTS), 2), np.nan)
    for event, interval in onsets.items():
        found[EVENTS.index(event)] = interval
    share = np.linspace(0, 1, 5)[:n]
    status = np.array([Status.converged] * (n - 1) + [last])
    contact = np.where(share > 0.6, share - 0.6, 0.0)
    contact[-1] = contact[-1] if last.has_values else np.nan
    return StabilityLine(
        start=start,
        goal=goal,
        share=share,
        status=status,
        contact_share=contact,
        min_gap=1 - share,
        stress=np.zeros((n, 3, 3)),
        pivots=np.tile((share[:, None] > 0.5).astype(int), (1, 8)),
        eigenvalues=np.full((n, 8), eigenvalues) - share[:, None],
        acoustic=0.1 - share / 4,
        direction=np.tile([0.0, 1.0, 0.0], (n, 1)),
        onsets=found,
    )


@pytest.fixture
def lines():
    one = made_up(
        0.0, {"crease": (0.6, 0.62), "110": (0.5, 0.52), "011": (0.4, 0.42), "acoustic": (0.4, 0.41)}
    )
    other = made_up(
        0.1, {"crease": (0.7, 0.72), "110": (0.6, 0.61), "000": (0.0, 0.0)}, n=4, last=Status.inverted
    )
    return [one, other]


@pytest.mark.parametrize("edge", [0.05, 0.333, 0.5, 0.999])
@pytest.mark.parametrize("first", [None, (0.0, 0.0)])
def test_the_end_of_what_can_be_solved_is_found(edge, first):
    asked, values = [], [] if first else [0.0]

    def solve(value, last):
        asked.append((value, last))
        return value

    values += [-0.25, -0.5, -0.75, -1.0]
    found = dict(walk(values, solve, lambda state: abs(state) <= edge, 0.01, first))
    solved = [value for value in found if abs(value) <= edge]
    (beyond,) = [value for value in found if abs(value) > edge]
    assert solved == sorted(solved, reverse=True)
    assert beyond == list(found)[-1]
    assert 0 < abs(beyond) - max([0.0, *np.abs(solved)]) <= 0.01 + 1e-9
    # Each starts from the last one before it that could be solved.
    reached = None if first is None else 0.0
    for value, last in asked:
        assert last == reached
        reached = value if abs(value) <= edge else reached


def test_a_goal_is_reached_without_a_halving():
    values = [0.25, 0.5, 0.75, 1.0]
    assert list(walk(values, lambda value, last: value, lambda state: True, 0.01)) == [(x, x) for x in values]


def test_a_plan_says_where_lines_run():
    start, goal = MapPlan({"H11": -0.1, "p": 0.2}, "H22", (-0.05,)).ends(-0.05)
    np.testing.assert_array_equal(start, [0, 0, 0, 0, -0.05, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(goal, [-0.1, 0, 0, 0, -0.05, 0, 0, 0, 0, 0.2])
    assert MapPlan({"H11": -0.1, "p": 0.2}, "H22", (-0.05,)).leading == "p"
    for along, across in (({"H21": 0.1}, "p"), ({"H22": 0.1}, "q"), ({"p": 0.1}, "p"), ({"H22": 0.0}, "p")):
        with pytest.raises(ConfigurationError):
            MapPlan(along, across, (0.0,))


def test_the_first_of_several_events_counts(lines):
    assert lines[0].onset("110")[4] == pytest.approx(-0.4 * 0.51)
    assert lines[0].onset("110", "101", "011")[4] == pytest.approx(-0.4 * 0.41)
    assert np.isnan(lines[0].onset("111", "000")).all()
    assert lines[1].onset("000")[4] == 0.0
    assert lines[1].onset("110")[9] == 0.1


def test_a_file_holds_lines_of_one_plan(lines, tmp_path):
    path = tmp_path / "map.h5"
    save(path, "one", lines, {"config": "text"})
    for line, again in zip(lines, load(path, "one"), strict=True):
        for name in ("start", "share", "status", "pivots", "eigenvalues", "onsets"):
            np.testing.assert_array_equal(getattr(line, name), getattr(again, name))
    with pytest.raises(DataError, match="another cell, backend or plan"):
        load(path, "other")
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(DataError, match=r"map\.h5"):
        load(path, "one")


def test_tables_have_a_row_for_each_state_and_each_line(lines, tmp_path):
    states, onsets = write_tables(tmp_path, PLAN, lines)
    rows = states.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + 5 + 4
    assert rows[0].startswith("H22,p,status,contact_share,min_gap,acoustic,negative_pivots_000")
    assert rows[-1].split(",")[:4] == ["-0.3", "0.1", "inverted", "nan"]
    head, first, _ = (row.split(",") for row in onsets.read_text(encoding="utf-8").splitlines())
    assert head[0] == "p"
    assert first[head.index("H22_110_to")] == "-0.208"


def data(axes, label):
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return line.get_xydata()


def test_onsets_are_drawn_where_they_are(lines):
    figure = stability_figure(PLAN, lines)
    axes = figure.axes[0]
    np.testing.assert_allclose(data(axes, "period two along two axes (110)"), [[-0.164, 0], [-0.242, 0.1]])
    np.testing.assert_allclose(
        data(axes, "crease: the wall meets a mirror plane"), [[-0.244, 0], [-0.284, 0.1]]
    )
    np.testing.assert_allclose(data(axes, "no solution; the line ends"), [[-0.3, 0.1]])
    assert len(data(axes, "solved state")) == 8
    assert not [line for line in axes.get_lines() if "three axes" in line.get_label()]


@pytest.mark.parametrize("eigenvalues", [np.nan, 0.5])
def test_one_line_is_drawn_state_by_state(eigenvalues):
    line = made_up(0.0, {"crease": (0.6, 0.62)}, eigenvalues=eigenvalues)
    line.pivots[2, WAVES.index("111")] = -1  # not known: a gap
    figure = stability_figure(PLAN, [line])
    assert len(figure.axes) == (3 if np.isnan(eigenvalues) else 4)
    modes = data(figure.axes[0], "period two along two axes (110)")
    np.testing.assert_array_equal(modes[:, 1], [0, 0, 0, 3, 3])
    assert np.isnan(data(figure.axes[0], "period two along three axes (111)")[2, 1])
    np.testing.assert_allclose(figure.axes[-1].get_lines()[0].get_ydata(), 100 * line.contact_share)
