"""Macro runs on the way: which states they visit, and what they say of the study."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.errors import SolveError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sampler import StudySampler
from porocore.macro.composition.regions import LayerRegion
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import MacroProblem
from porocore.macro.reference import CellReference
from porocore.sampling.samplers.designs import SobolDesign
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.states import MacroState
from porocore.study.config.config import MacroSettings, RunConfig
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run.composition import explorer, study_facts
from porocore.study.run.exploration import BodyAround, MacroExplorer, coarse_problem
from porocore.testing.synthetic import cell as synthetic_cell
from porocore.testing.synthetic.cell import INPUTS, synthetic_training_set

pytest.importorskip("porocore_fem_skfem")

#: Quadrature points of an element.
POINTS = 27


@pytest.fixture(scope="module")
def config() -> RunConfig:
    whole = load_config(benchmark_path())
    macro = whole.macro.model_copy(update={"loads": (-0.05, -0.02)})
    return whole.model_copy(update={"macro": macro, "closure": "potential"})


@pytest.fixture(scope="module")
def reference() -> CellReference:
    return CellReference("made up", synthetic_cell.respond(MacroState.zeros(1)), np.eye(3), {})


def test_a_coarse_problem_is_the_same_problem(config: RunConfig) -> None:
    problem = config.macro.problem(-0.05)
    coarse = coarse_problem(problem, 8, 20)
    assert coarse.body.elements == (1, 8, 1)
    assert coarse.time.step == pytest.approx((150 - 0.75) / 20)
    assert (coarse.load, coarse.body.size, coarse.boundary) == (
        problem.load,
        problem.body.size,
        problem.boundary,
    )
    # What is coarse already stays.
    assert coarse_problem(problem, 200, 10**6).body.elements == problem.body.elements
    assert coarse_problem(problem, 200, 10**6).time.step == problem.time.step


def test_an_exploration_visits_what_the_column_goes_through(
    config: RunConfig, reference: CellReference
) -> None:
    explore = explorer(config, reference)
    data = synthetic_training_set(40)
    found = explore(data, elements=4, steps=8)
    assert found.states.grad_u.shape[1:] == (3, 3)
    H22, p = found.states.grad_u[:, 1, 1], found.states.p
    # The column is drained in the end, so that its settlement is that of its most compressed points.
    assert found.results[0] == pytest.approx(-7.5 * H22.min(), rel=0.01)
    assert found.results[1] == pytest.approx(p.max(), rel=0.2)
    assert 0 < found.results[2] < found.results[0]
    assert np.abs(found.states.grad_u).sum(axis=(1, 2)) == pytest.approx(np.abs(H22), abs=1e-9)
    again = explore(data, elements=4, steps=8)
    assert again.results == found.results
    assert (again.states.grad_u == found.states.grad_u).all()


def test_an_exploration_of_one_of_several_cells_visits_where_it_is(
    config: RunConfig, reference: CellReference
) -> None:
    """The deepest tenth of the column has the cell; the rest is linear, twice as stiff as the cell at rest."""
    macro = config.macro.model_copy(update={"regions": {"deep": LayerRegion(below=0.75, cell="clay")}})
    linear = LinearCoefficients.from_reference(
        reference.response, reference.solid_fraction, config.cell.solid, reference.conductivity
    )
    stiff = replace(linear, stiffness=2 * linear.stiffness)
    whole = explorer(config, reference)
    study = config.model_copy(update={"macro": macro, "cells": {"clay": config.cell}})
    part = explorer(config, reference, BodyAround(study, "clay", {None: LinearPoroelasticity(stiff)}))
    data = synthetic_training_set(40)
    (alone, both) = (explore(data, elements=4, steps=8) for explore in (whole, part))
    # There are eight elements, since the region would have none of four.
    assert part_of(macro).body.elements == (1, 8, 1)
    steps = (len(both.states) - 2) / POINTS
    assert steps == int(steps) > 8
    # The cell bears the same stress, and the rest of the column is linear.
    H22 = both.states.grad_u[:, 1, 1].min()
    assert pytest.approx(alone.states.grad_u[:, 1, 1].min(), rel=0.02) == H22
    assert both.results[0] == pytest.approx(6.75 * 0.05 / stiff.stiffness[1, 1, 1, 1] - 0.75 * H22, rel=0.01)


def part_of(macro: MacroSettings) -> MacroProblem:
    return coarse_problem(macro.problem(macro.loads[0]), 4, 8)


def test_the_flux_goes_by_the_configured_conductivity(config: RunConfig, reference: CellReference) -> None:
    """A pore that closes to a tenth holds the pressure up, where K carried along lets it go."""
    data = synthetic_training_set(40)
    size = np.exp(40 * data.states.grad_u[:, 1, 1])
    data = replace(
        data,
        responses=replace(data.responses, conductivity=size[:, None, None] * np.eye(3)),
        reference=reference.resting("deformed"),
    )
    time = config.macro.time.model_copy(update={"end": 6.0, "profiles": ()})
    macro = config.macro.model_copy(update={"loads": (-0.05,), "time": time})
    settled = {}
    for law in ("piola", "deformed"):
        study = config.model_copy(update={"conductivity": law, "macro": macro})
        settled[law] = explorer(study, reference)(data, elements=4, steps=8).results[0]
    assert settled["deformed"] < 0.9 * settled["piola"]
    sampler = MacroDriven(INPUTS, count=20)
    sampler.inform(study_facts(study, reference, explorer(study, reference)))
    assert (sampler.study.reference.conductivity == reference.conductivity).all()


def test_the_force_on_a_surface_that_is_moved_is_a_result(
    config: RunConfig, reference: CellReference
) -> None:
    """The settlement of such a column is given, and its pressure is largest on the way."""
    data = config.macro.model_dump()
    data["boundary"]["y+"] = {"displacement": (None, 7.5, None), "pressure": 0}
    moved = config.model_copy(update={"macro": MacroSettings.model_validate(data)})
    settlement, _, largest, last, *others = explorer(moved, reference)(
        synthetic_training_set(40), elements=4, steps=8
    ).results
    assert settlement == pytest.approx(0.05 * 7.5)
    rest = MacroState.zeros(1)
    rest.grad_u[0, 1, 1] = -0.05
    drained = synthetic_cell.respond(rest).stress
    assert drained is not None
    assert last == pytest.approx(-0.01 * drained[0, 1, 1], rel=0.02)  # on 0.1 × 0.1
    assert largest > 1.02 * last
    assert len(others) == 4


def test_a_macro_run_that_fails_gives_what_it_visited(config: RunConfig, reference: CellReference) -> None:
    class Failing(MacroSolver):
        def prepare(self, problem: object) -> None:
            return None

        def solve(self, prepared: object, law: MacroLaw, **_: object) -> object:  # type: ignore[override]
            memory = law.initial(2)
            H = np.zeros((2, 3, 3))
            H[:, 1, 1] = -0.01
            response = law.respond(MacroState(H, np.zeros(2)), np.zeros((2, 3)), memory)
            assert law.before_accept(response, memory) is None
            raise SolveError("no step is small enough")

    explore = explorer(config, reference)
    explore._solver = Failing()
    found = explore(synthetic_training_set(12), elements=4, steps=8)
    assert np.isnan(found.results).all()
    assert len(found.results) == 4
    assert sorted(set(found.states.grad_u[:, 1, 1])) == [-0.01, 0.0]


def test_only_who_wants_to_know_is_informed(config: RunConfig, reference: CellReference) -> None:
    assert not isinstance(SobolDesign(INPUTS), StudySampler)
    sampler = MacroDriven(INPUTS)
    assert isinstance(sampler, StudySampler)
    sampler.inform(study_facts(config, reference, explorer(config, reference)))
    assert sampler.study.responses == ("mean_grad", "stress", "fluid_volume")
    assert sampler.study.identity == config.stages.cell
    assert sampler.study.reference is reference.response
    assert isinstance(sampler.study.explore, MacroExplorer)
