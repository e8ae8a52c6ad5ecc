"""The solution of a macro problem: its file, and shares that its maker does not give."""

from dataclasses import fields

import h5py
import numpy as np
import pytest

import porocore
from porocore.errors import DataError
from porocore.interfaces.solution import History, all_series


@pytest.fixture
def solution(column):
    return column(elements=(1, 4, 1))


def test_the_shares_that_are_flagged_are_in_files(solution, tmp_path):
    solution.save(tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        assert "flagged" in file["profiles/0"]
        kept = {name for name in file["history"] if name.startswith("flagged")}
    assert kept == {"flagged", *(f"flagged_{each.name}" for each in porocore.Doubt)}
    read = type(solution).load_file(tmp_path / "s.h5")
    for name in kept:
        np.testing.assert_array_equal(getattr(read.history, name), getattr(solution.history, name))
    assert kept <= {each.name for each in all_series(solution)}


def test_shares_for_each_reason_are_zero_where_a_solver_gives_none(solution):
    names = [each.name for each in fields(History) if not each.name.startswith("flagged_")]
    history = History(**{name: getattr(solution.history, name) for name in names})
    for each in porocore.Doubt:
        np.testing.assert_array_equal(getattr(history, f"flagged_{each.name}"), 0 * history.time)


def test_a_file_of_an_older_version_is_solved_again(solution, tmp_path):
    solution.save(tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file.attrs["version"] = 4
    with pytest.raises(DataError, match=r"expected a porocore solution of version 7; .* solve again"):
        type(solution).load_file(tmp_path / "s.h5")
