"""A solved column whose law remembers: the states of its cells, and its checkpoint."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from porocore.errors import DataError
from tests.helpers.remembered_column import cells, remembered_column

ALL = ("evolution", "relaxation", "charges")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The checkpoint of the whole run, and its solution."""
    path = tmp_path_factory.mktemp("column") / "checkpoint.h5"
    return path, remembered_column(*ALL, elements=3, checkpoint=path)


def test_the_law_of_equilibrium_at_the_states_of_the_cells_has_what_the_profiles_have(written):
    """Fluid volume and conductivity, to what means over elements differ; each by far not at the state of the body."""
    solution, law = written[1], cells()
    last, states = solution.profiles[2], solution.cell_states(2)

    def errors(at):
        found = law.respond(at, np.zeros((len(at), 3)), law.initial_at(at))
        return (
            np.abs(found.memory.fluid_volume / last.fluid_volume - 1).max(),
            np.abs(found.transformed_conductivity / last.conductivity - 1)[:, 1, 1].max(),
        )

    exact = errors(states)
    assert max(exact) < 0.01
    at_first = replace(states, parameters=solution.cell_states(0).parameters)
    at_body = replace(states, p=last.element_p)
    assert errors(at_first)[1] > 10 * exact[1]
    assert errors(at_body)[0] > 5 * exact[0]


def test_a_finished_run_is_read_again_as_it_was(written):
    path, solution = written
    again = remembered_column(*ALL, elements=3, checkpoint=path)
    assert again.quantities == solution.quantities
    for one, other in zip(again.profiles, solution.profiles, strict=True):
        for name, values in other.internal.items():
            np.testing.assert_array_equal(one.internal[name], values, err_msg=name)
        np.testing.assert_array_equal(one.fluid_volume, other.fluid_volume)


def lost(file):
    del file["profiles/1/internal/charge"]


def scalar(file):
    name = "profiles/1/internal/overstress_1"
    values = file[name][:, 0, 0]
    del file[name]
    file[name] = values


def narrow(file):
    values = file["memory/internal"][:, :-1]
    del file["memory/internal"]
    file["memory/internal"] = values


@pytest.mark.parametrize("damage", [lost, scalar, narrow], ids=lambda each: each.__name__)
def test_a_checkpoint_with_other_internal_variables_is_refused(written, tmp_path, damage):
    path = tmp_path / "checkpoint.h5"
    path.write_bytes(written[0].read_bytes())
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(DataError, match=r"checkpoint\.h5: .*start anew") as found:
        remembered_column(*ALL, elements=3, checkpoint=path)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("kinds", [ALL[:2], ALL[1:]])
def test_a_checkpoint_of_a_law_that_remembers_something_else_is_refused(written, kinds):
    with pytest.raises(DataError, match="belongs to another macro problem or law; move it elsewhere"):
        remembered_column(*kinds, elements=3, checkpoint=written[0])
