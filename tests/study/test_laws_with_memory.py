"""Laws of a run with their memory: which law stands in which, and that a run gives each its numbers."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.laws.charges import ChargedLaw
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.evolution import EvolvingLaw, UnevolvedLaw
from porocore.macro.laws.linear import LinearisedLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import load_config
from porocore.study.run.composition import law_of_body, make_backend, with_memory
from porocore.testing.synthetic.porous_family import PorousFamilyLaw
from porocore.testing.synthetic.response import linear_law, mean_gradient_law
from tests.bad_input.bad_row import study

RELAXING = {"cell.material.relaxation": {"branches": [{"strength": 0.5, "time": 3.0}]}}
CHARGED = {"macro.charges": {"density": 0.1, "bath": 0.15, "temperature": "0.1 K"}}
EVOLVING = {
    "cell.geometry.radius": {"range": [0.15, 0.3]},
    "macro.fields": {"radius": 0.25},
    "macro.evolution": {"radius": {"rate": "-k*radius", "constants": {"k": 0.001}}},
    "closure": "potential",
}


@pytest.fixture
def load(tmp_path):
    def loaded(changes=None) -> RunConfig:
        path = tmp_path / "study.yaml"
        path.write_text(study(changes))
        return load_config(path)

    return loaded


def family_law() -> ClosedLaw:
    """Law of a cell with the parameter ``radius``."""
    return ClosedLaw(PorousFamilyLaw("radius"), make_closure("potential", 0.6, NeoHookean(), np.eye(3)))


def solved(config: RunConfig, law: MacroLaw) -> MacroSolution:
    solver, problem = make_backend("macro solver", config), config.problem(config.macro.loads[0])
    return solver.solve(solver.prepare(problem), law)


def same_history(one, other):
    for each in fields(one.history):
        np.testing.assert_array_equal(getattr(one.history, each.name), getattr(other.history, each.name))


def test_charges_stand_around_the_relaxation_around_the_evolution(load):
    config, closure = load({**EVOLVING, **RELAXING, **CHARGED}), family_law()
    law = with_memory(closure, config)
    kinds = []
    while law is not closure:
        kinds.append(type(law))
        law = law.law
    assert kinds == [ChargedLaw, RelaxingLaw, EvolvingLaw]
    assert with_memory(closure, config).parameters == (
        "radius",
        "evolution.radius.k",
        "relaxation.1.strength",
        "relaxation.1.time",
        "charges.density",
        "charges.bath",
    )
    assert {*with_memory(closure, config).parameters} == {*config.problem(1.0).fields}


def test_an_elastic_cell_without_charges_has_its_own_law(load):
    law = linear_law()
    assert with_memory(law, load()) is law


def test_a_linear_law_relaxes_at_small_strain_and_does_not_evolve(load):
    closure = family_law()
    relaxing = with_memory(linear_law(), load(RELAXING), linear=True)
    assert relaxing.constant_tangent
    assert not with_memory(linear_law(), load(RELAXING)).constant_tangent
    config = load(EVOLVING)
    law = with_memory(LinearisedLaw(closure), config, linear=True)
    assert isinstance(law, UnevolvedLaw)
    assert law.parameters == ("radius", "evolution.radius.k")
    same_history(
        solved(config, law), solved(load({**EVOLVING, "macro.evolution": {}}), LinearisedLaw(closure))
    )


@pytest.mark.parametrize(
    ("make", "linear"), [(linear_law, True), (mean_gradient_law, False)], ids=["linear", "mean-gradient"]
)
def test_branches_of_no_strength_and_bodies_without_charges_are_elastic(load, make, linear):
    plain = solved(load(), make())
    weak = load({"cell.material.relaxation": {"branches": [{"strength": 0, "time": 3.0}]}})
    same_history(plain, solved(weak, with_memory(make(), weak, linear=linear)))
    none = load({"macro.charges": {"density": 0, "bath": 0.15}})
    same_history(plain, solved(none, with_memory(make(), none, linear=linear)))


def test_a_run_gives_each_law_its_numbers(load):
    plain = solved(load(), mean_gradient_law()).history.displacement
    for changes in (RELAXING, CHARGED):
        config = load(changes)
        moved = solved(config, with_memory(mean_gradient_law(), config)).history.displacement
        assert abs(moved[1] - plain[1]) > 0.02 * plain[1]
    slow = load({"cell.material.relaxation": {"branches": [{"strength": 0.5, "time": 1e9}]}})
    stiff = solved(slow, with_memory(linear_law(), slow, linear=True)).history
    # A solid that does not relax in this time is one of 1.5 times the stiffness: under half as much again the same.
    more = load({"macro.loads": [-0.04 / 1.5], "cell.material.relaxation": None})
    assert stiff.displacement[1] == pytest.approx(solved(more, linear_law()).history.displacement[1], rel=0.1)


def test_a_body_evolves_by_the_constants_of_the_file(load):
    runs = {}
    for k in (0.0, 1e-5, 1e-4):
        rate = {"rate": "-k*radius", "constants": {"k": k}}
        config = load({**EVOLVING, "macro.evolution": {"radius": rate}})
        runs[k] = solved(config, with_memory(family_law(), config)).history.displacement[-1]
    plain = load({**EVOLVING, "macro.evolution": {}})
    assert runs[0.0] == solved(plain, family_law()).history.displacement[-1]
    first, more = runs[1e-5] - runs[0.0], runs[1e-4] - runs[0.0]
    assert more == pytest.approx(10 * first, rel=0.02)


def test_each_region_relaxes_as_its_cell_does(load):
    config = load(
        {
            **RELAXING,
            "cells": {"elastic": {}},
            "macro.body.elements": [1, 4, 1],
            "macro.regions": {"low": {"below": 3.0, "cell": "elastic"}},
        }
    )
    laws = {name: with_memory(linear_law(), config.of_cell(name), linear=True) for name in config.cell_names}
    found = solved(config, law_of_body(config, laws)).history.displacement
    ends = []
    for changes in (RELAXING, None):
        other = load({**(changes or {}), "macro.body.elements": [1, 4, 1]})
        ends.append(solved(other, with_memory(linear_law(), other, linear=True)).history.displacement)
    assert (np.minimum(*ends)[1:] < found[1:]).all()
    assert (found[1:] < np.maximum(*ends)[1:]).all()
