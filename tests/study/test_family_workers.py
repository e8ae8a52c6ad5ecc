"""A family of cells in a study: its parameters are inputs, workers and store solve its members."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from porocore.cell.cell import Cell
from porocore.core.files.store import ResultStore
from porocore.sampling.execution import CellPool
from porocore.states import MacroState, Status
from porocore.study.run.composition import factory_of, prepare_cell
from porocore.study.store import cell_key, solved_states

FAMILY = Cell.model_validate(
    {
        "geometry": {"radius": 0.25},
        "material": {"poisson_ratio": {"range": [0.2, 0.4]}},
        "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    }
)


def test_workers_solve_the_member_of_each_state_and_the_store_keeps_it(tmp_path: Path) -> None:
    known = solved_states(ResultStore(tmp_path), "skfem", {}, FAMILY)
    assert known is not None
    pressed = MacroState.single(np.diag([0.0, -0.05, 0.0]), 0.02)
    with CellPool(factory_of(FAMILY), ("skfem", {}, FAMILY), executor="serial", known=known) as pool:
        for name, nu in (("soft", 0.22), ("stiff", 0.38)):
            pool.submit(name, pressed.with_parameters([nu]))
        found = {outcome.key: outcome.response for outcome in (pool.wait(), pool.wait())}
    for name, nu in (("soft", 0.22), ("stiff", 0.38)):
        member = FAMILY.at({"poisson_ratio": nu})
        solver, prepared = prepare_cell("skfem", {}, member)
        alone = solver.solve(prepared, pressed).response
        assert alone.status[0] == Status.converged
        np.testing.assert_array_equal(found[name].stress, alone.stress)
        # A member that is solved by itself is found in the store.
        own = solved_states(ResultStore(tmp_path), "skfem", {}, member)
        assert own is not None
        assert own.identity == cell_key("skfem", {}, member, "piola")
        assert own.find("", pressed, None) is not None
    assert not np.allclose(found["soft"].stress, found["stiff"].stress)


def test_the_same_member_of_another_family_is_solved_again_for_its_slopes(tmp_path: Path) -> None:
    """Its numbers are the same, but there is one parameter more to take slopes by."""
    mesh = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    ratio = {"poisson_ratio": {"range": [0.2, 0.4]}}
    one = Cell.model_validate({"mesh": mesh, "material": ratio})
    other = Cell.model_validate({"mesh": mesh, "material": {**ratio, "swelling": {"range": [1.0, 1.2]}}})
    numbers = {"poisson_ratio": 0.3, "swelling": 1.0}
    shapes, found = [], []
    for family in (one, other, one):
        arguments = ("skfem", {}, family)
        known = solved_states(ResultStore(tmp_path), *arguments, fields=False)
        theta = [numbers[parameter.name] for parameter in family.parameters]
        with CellPool(factory_of(family), arguments, executor="serial", fields=False, known=known) as pool:
            pool.submit("rest", MacroState.zeros(1).with_parameters(np.array(theta)))
            slopes = pool.wait().response.slopes
        assert slopes is not None
        assert slopes.potential is not None
        assert known is not None
        shapes.append(slopes.potential.shape)
        found.append(known.found)
    assert shapes == [(1, 1), (1, 2), (1, 1)]
    assert found == [0, 0, 1]
