"""The solution of a macro problem: its file, and shares that its maker does not give."""

import json
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

import porocore
from porocore.errors import DataError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import History, all_series
from porocore.states import MacroState


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


@pytest.fixture
def remembering(solution):
    """Four elements in two regions, of which the upper has no radius; it evolves in the lower, and both relax."""
    e = len(solution.cells)
    region = np.array([1, 1, 0, 0])
    values = np.tile([0.2, 1.5], (len(solution.profiles), e, 1))
    values[:, :, 0] = [np.where(region, 0.2 - 0.001 * each.time, np.nan) for each in solution.profiles]
    axes = np.broadcast_to(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), (1, e, 3, 3))
    cells = ElementCells(region, ("low",), ("radius", "c10"), values, axes)
    profiles = tuple(
        replace(
            each,
            cell_p=each.element_p - 0.01 * each.time,
            internal={"radius": (0.2 - 0.001 * each.time) * region, "a/stress": each.time * each.stress},
        )
        for each in solution.profiles
    )
    quantities = {"radius": "", "a/stress": "stress"}
    return replace(solution, element_cells=cells, profiles=profiles, quantities=quantities)


def test_states_are_those_at_which_the_law_asks_the_cells(remembering):
    """At its pressure and with evolved parameters."""
    for i, profile in enumerate(remembering.profiles):
        states, evolved = remembering.cell_states(i), 0.2 - 0.001 * profile.time
        np.testing.assert_array_equal(states.p, profile.cell_p)
        np.testing.assert_array_equal(states.parameters, [[evolved, 1.5]] * 2 + [[np.nan, 1.5]] * 2)
        np.testing.assert_array_equal(states.grad_u[:, 0, 0], profile.grad_u[:, 1, 1])
        some = np.array([1, 0, 3])
        points = MacroState(profile.grad_u[some], profile.element_p[some] + [0.1, 0.2, 0.3])
        seen = remembering.seen_by_cells(points, i, some)
        np.testing.assert_allclose(seen.p, profile.cell_p[some] + [0.1, 0.2, 0.3], atol=1e-15)
        np.testing.assert_array_equal(seen.parameters, states.parameters[some])
        np.testing.assert_array_equal(seen.grad_u, states.grad_u[some])
    (low,) = {*remembering.of_regions([1], ("radius",)).cell_states(2).parameters.ravel()}
    assert low == 0.2 - 0.001 * remembering.profiles[2].time


def test_internal_variables_come_back_from_the_file(remembering, tmp_path):
    remembering.save(tmp_path / "s.h5")
    found = type(remembering).load_file(tmp_path / "s.h5")
    assert found.quantities == remembering.quantities
    for one, other in zip(found.profiles, remembering.profiles, strict=True):
        assert one.internal.keys() == other.internal.keys()
        for name, values in other.internal.items():
            np.testing.assert_array_equal(one.internal[name], values)
        np.testing.assert_array_equal(one.fluid_volume, other.fluid_volume)
    assert (found.evolving, found.pressure) == (("radius",), "pore pressure")


def missing(file):
    del file["profiles/1/internal/radius"]


def unnamed(file):
    file["profiles/1/internal/other"] = file["profiles/1/internal/radius"][()]


def shortened(file):
    values = file["profiles/1/internal/radius"][:-1]
    del file["profiles/1/internal/radius"]
    file["profiles/1/internal/radius"] = values


def vectors(file):
    values = file["profiles/1/internal/radius"][()]
    del file["profiles/1/internal/radius"]
    file["profiles/1/internal/radius"] = np.repeat(values[:, None], 2, axis=1)


def no_numbers(file):
    file["profiles/1/internal/radius"][0] = np.nan


def no_json(file):
    file.attrs["internal"] = "{radius"


def of_no_quantity(file):
    file.attrs["internal"] = json.dumps({"radius": "", "a/stress": "weight"})


def a_list(file):
    file.attrs["internal"] = json.dumps(["radius", "a/stress"])


def nested(file):
    file.attrs["internal"] = json.dumps({"radius": "", "a/stress": {}})


def without_fluid(file):
    del file["profiles/1/fluid_volume"]


DAMAGE = [
    missing,
    unnamed,
    shortened,
    vectors,
    no_numbers,
    no_json,
    of_no_quantity,
    a_list,
    nested,
    without_fluid,
]


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda each: each.__name__)
def test_a_file_with_other_internal_variables_is_refused(remembering, tmp_path, damage):
    """In one message, with the file and what to do."""
    path = tmp_path / "s.h5"
    remembering.save(path)
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(DataError, match=r"s\.h5: .*solve again") as found:
        type(remembering).load_file(path)
    assert "\n" not in str(found.value)
