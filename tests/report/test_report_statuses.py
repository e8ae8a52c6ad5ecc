"""Which share of the solved states, and of the body, is in contact or unstable."""

import json
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.report.context import SamplingSummary
from porocore.report.words.results import (
    SHARES,
    solved_sentence,
    solved_shares,
    visited_sentence,
    visited_shares,
)
from porocore.states import Status

INPUTS = InputSpace(("H22", "p"), (-0.4, 0.0), (0.0, 0.2))


def sampling(*ends):
    """States one above the other at p = 0.1, evenly from H22 = −0.4 to 0, that ended so."""
    x = np.column_stack([np.linspace(-0.4, 0.0, len(ends)), np.full(len(ends), 0.1)])
    status = np.array(ends, dtype=np.int64)
    return SamplingSummary(INPUTS, x, status, np.isin(status, [Status.converged, Status.contact]))


def test_of_the_solved_states():
    ends = [Status.overlap, Status.not_converged, Status.unstable, Status.contact, Status.contact]
    found = solved_shares(sampling(*ends, *5 * [Status.converged]))
    assert found == {"contact": 0.2, "unstable": 0.1, "without_values": 0.2}
    assert solved_sentence(found) == (
        "Of the solved states, 20 % are in contact: the pore wall is pressed against itself. 10 % of the states are "
        "unstable, and 20 % have no valid data."
    )


def test_every_status_is_plain_or_counted_once():
    counted = [status for kinds in SHARES.values() for status in kinds]
    assert sorted([*counted, Status.converged]) == sorted(Status)


def test_of_the_body_by_volume(column):
    """H22 of each element is made up, so the shares of the height are known; p is no matter at equal distance."""
    base = column(elements=(1, 4, 1), times=(1.0,), end=2.0)
    profiles = []
    for profile, H22 in zip(
        base.profiles, ([-0.39, -0.29, -0.16, 0.0], [-0.01, -0.02, 0.0, 0.0]), strict=True
    ):
        grad_u = np.zeros((4, 3, 3))
        grad_u[:, 1, 1] = H22
        profiles.append(replace(profile, grad_u=grad_u))
    # Unequal heights: the lowest element takes seven tenths of the column.
    points = base.points.copy()
    levels = np.unique(points[:, 1].round(9))
    new = np.interp(levels, levels[::2], 7.5 * np.array([0.0, 0.7, 0.8, 0.9, 1.0]))
    points[:, 1] = np.interp(points[:, 1], levels, new)
    solution = replace(base, points=points, profiles=tuple(profiles))
    # Solved at −0.4, −0.3, −0.2, −0.1, 0.
    ends = (Status.overlap, Status.unstable, Status.contact, Status.converged, Status.converged)
    order = np.argsort(points[base.cells, 1].mean(axis=1))
    assert order.tolist() == [0, 1, 2, 3]
    first, second = visited_shares(solution, sampling(*ends))
    assert first["time"] == 1.0
    assert first["without_values"] == pytest.approx(0.7)
    assert first["unstable"] == pytest.approx(0.1)
    assert first["contact"] == pytest.approx(0.1)
    assert {second[name] for name in SHARES} == {0.0}
    assert "70 %" in visited_sentence([first, second])
    assert (
        "each element of the body, the nearest solved state of the cell is stable and has no contact"
        in visited_sentence([second])
    )
    assert json.loads(json.dumps([first, second], allow_nan=False)) == [first, second]


def test_the_share_of_the_wall_in_contact_stands_beside_that_of_the_body(column):
    """Of the body 100 % "touches itself" where 0.05 % of the wall did, which reads as closed pores."""
    solution = column(elements=(1, 2, 1), times=(), end=1.0)
    touched = replace(sampling(*3 * [Status.contact]), contact_share=np.full(3, 5e-4))
    found = visited_shares(solution, touched)
    assert found[-1]["wall_in_contact"] == 5e-4
    said = "in the cells of 100 % of the body. In each cell, at most 0.050 % of the wall is in contact."
    assert said in visited_sentence(found)
    assert "itself. In each state, at most 0.050 % of the wall is in contact." in solved_sentence(
        solved_shares(touched)
    )
    free = replace(sampling(*3 * [Status.converged]), contact_share=np.full(3, np.nan))
    assert solved_shares(free)["wall_in_contact"] == 0.0
    assert "of the wall" not in solved_sentence(solved_shares(free))


def test_inputs_are_compared_by_their_ranges(column):
    """Δp = 0.1 is half of its range and farther than ΔH22 = 0.15 of 0.4."""
    base = column(elements=(1, 1, 1), times=(), end=1.0)
    profile = base.profiles[-1]
    grad_u = np.zeros((1, 3, 3))
    grad_u[0, 1, 1] = -0.25
    solution = replace(
        base, profiles=(replace(profile, grad_u=grad_u, element_p=np.zeros(1), cell_p=np.zeros(1)),)
    )
    x, status = np.array([[-0.25, 0.1], [-0.10, 0.0]]), np.array([Status.unstable, Status.contact])
    summary = SamplingSummary(INPUTS, x, status, np.ones(2, dtype=bool))
    (found,) = visited_shares(solution, summary)
    assert (found["contact"], found["unstable"]) == (1.0, 0.0)


def test_nothing_is_said_without_profiles_or_samples(column):
    base = column(times=(), elements=(1, 2, 1))
    assert visited_shares(replace(base, profiles=()), sampling(Status.converged)) == []
    assert visited_sentence([]) == ""
    nothing = SamplingSummary(INPUTS, np.zeros((0, 2)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool))
    assert visited_shares(base, nothing) == []
