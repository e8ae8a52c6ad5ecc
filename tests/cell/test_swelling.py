"""Cells whose solid swells: scaling of the whole solid, regions of their own, rest states, slopes by the stretch."""

from dataclasses import replace

import numpy as np
import pytest

from porocore import MacroState, Status
from porocore.cell.cell import Cell
from porocore.commands.fields.points import PointFields
from porocore.core.files.store import ResultStore
from porocore.errors import ConfigurationError
from porocore.macro.laws.closure import MeanGradientClosure, make_closure
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.reference import CellReference
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run.reference import solve_cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

COARSE = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
F0, P = np.diag([1.05, 0.96, 1.02]), 0.04


class Layered(Cell):
    """A cell whose solid has two regions, by the distance from the middle of the cell."""

    def make_mesh(self, phase, domain):
        mesh = super().make_mesh(phase, domain)
        far = np.linalg.norm(mesh.points[mesh.cells[:, :4]].mean(axis=1), axis=1) > 0.5
        return replace(mesh, regions=far.astype(np.int64), region_names=("near", "far"))


def solved(cell, F, p=P):
    solver = SkfemCellSolver()
    solution = solver.solve(solver.prepare(cell), MacroState.single(F - np.eye(3), p), fields=True)
    assert solution.response.status[0] == Status.converged
    return solution.response, PointFields.from_cell_field(cell, solution.fields[0])


@pytest.mark.parametrize("stretch", [1.12, 0.9])
def test_a_uniform_swelling_scales_the_response(stretch):
    """W(F₀, p; λ) = λ³ W(F₀/λ, p; 1), and its derivatives."""
    dry, _ = solved(Cell(mesh=COARSE), F0)
    wet, _ = solved(Cell(mesh=COARSE, material={"swelling": stretch}), stretch * F0)
    assert wet.potential[0] == pytest.approx(stretch**3 * dry.potential[0], rel=1e-9)
    assert np.allclose(wet.stress, stretch**2 * dry.stress, rtol=1e-8, atol=1e-11)
    assert np.allclose(wet.fluid_volume, stretch**3 * dry.fluid_volume, rtol=1e-9)
    assert np.allclose(wet.tangent.stress_grad_u, stretch * dry.tangent.stress_grad_u, rtol=1e-7, atol=1e-9)
    assert np.allclose(wet.mean_grad, stretch * dry.mean_grad, rtol=1e-7, atol=1e-10)


def test_a_swollen_cell_that_is_held_has_a_stress_and_one_that_is_free_has_none():
    cell = Cell(mesh=COARSE, material={"swelling": 1.1})
    held, _ = solved(cell, np.eye(3), 0.0)
    free, _ = solved(cell, 1.1 * np.eye(3), 0.0)
    assert held.stress[0].diagonal().max() < -0.02
    assert np.abs(held.mean_grad).max() > 1e-3
    assert np.abs(free.stress).max() < 1e-13
    assert free.potential[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("name", ["near.swelling", "far.poisson_ratio"])
def test_slopes_by_a_region_are_those_of_the_potential(name):
    """∂W/∂θ = ⟨∂Ψ/∂θ⟩_s at the equilibrium, against differences of W over solves of their own."""
    family = Layered(
        mesh=COARSE,
        materials={
            "near": {"swelling": {"range": [1.0, 1.2]}},
            "far": {"poisson_ratio": {"range": [0.2, 0.4]}},
        },
    )
    names = [parameter.name for parameter in family.parameters]
    k, h = names.index(name), 1e-3

    def at(steps):
        values = np.array([1.1, 0.3])
        values[k] += steps * h
        return solved(family.at(values), F0)

    _, points = at(0)
    by_energy, _ = points.material.parameter_slopes(family.parameters[k].solid_key, points.F)
    W = [at(steps)[0].potential[0] for steps in (-2, -1, 1, 2)]
    assert points.mean(by_energy) == pytest.approx((W[0] - 8 * W[1] + 8 * W[2] - W[3]) / (12 * h), rel=1e-8)


def reference(cell, **how):
    solver = SkfemCellSolver()
    return CellReference.compute(solver, solver.prepare(cell, **how), cell, "cell")


def test_the_reference_of_a_swollen_cell_is_held_and_has_the_porosity_of_the_dry_one(tmp_path):
    dry, wet = (
        reference(Cell(mesh=COARSE)),
        reference(Cell(mesh=COARSE, material={"swelling": 1.1}), deformed=True),
    )
    assert wet.porosity == pytest.approx(dry.porosity, rel=1e-12)
    assert wet.response.fluid_volume[0] < wet.porosity - 0.1
    assert np.allclose(wet.conductivity, dry.conductivity, rtol=1e-12)
    pores = wet.resting("deformed")
    assert pores.conductivity[0, 0, 0] < 0.5 * dry.conductivity[0, 0]  # the solid has swollen into them
    assert np.array_equal(wet.conductivity_at_rest("deformed"), pores.conductivity[0])
    assert np.array_equal(dry.conductivity_at_rest("piola"), dry.conductivity)
    wet.save(tmp_path / "cell.json")
    again = CellReference.load(tmp_path / "cell.json", "cell")
    assert again.porosity == wet.porosity
    assert np.array_equal(again.resting("deformed").conductivity, pores.conductivity)
    assert np.array_equal(again.response.stress, wet.response.stress)


def test_linear_poroelasticity_of_a_swollen_cell_is_its_tangent_with_its_stress():
    """Against differences of solved states."""
    cell = Cell(mesh=COARSE, material={"swelling": 1.05})
    at_rest = reference(cell)
    c = LinearCoefficients.from_reference(
        at_rest.response, at_rest.solid_fraction, cell.solid, at_rest.conductivity
    )
    law, h = LinearPoroelasticity(c), 1e-4
    still = np.zeros((1, 3))
    rest = law.respond(MacroState.zeros(1), still, law.initial(1))
    held, _ = solved(cell, np.eye(3), 0.0)
    assert np.allclose(rest.stress, held.stress, atol=1e-12)
    assert np.allclose(rest.mean_grad, held.mean_grad, atol=1e-12)
    along = np.diag([0.3, 1.0, -0.2])
    (up, _), (down, _) = (solved(cell, np.eye(3) + s * h * along, s * h * 0.5) for s in (1, -1))
    found = [
        law.respond(MacroState.single(s * h * along, s * h * 0.5), still, law.initial(1)) for s in (1, -1)
    ]
    assert np.allclose(found[0].stress - found[1].stress, up.stress - down.stress, atol=1e-6 * h)
    assert np.allclose(
        found[0].storage - found[1].storage, up.fluid_volume - down.fluid_volume, atol=1e-6 * h
    )


def test_the_linear_flux_of_a_swollen_cell_is_that_of_its_closure_at_rest():
    at_rest = reference(Cell(mesh=COARSE, material={"swelling": 1.1}))
    closure = at_rest.closure("potential", Cell().solid, "piola")
    pore = closure.pull_back(MacroState.zeros(1), at_rest.response, np.array([[0.0, 1.0, 0.0]]))
    assert np.allclose(-at_rest.conductivity_at_rest("piola")[:, 1], pore.flux[0], rtol=1e-14)
    assert abs(at_rest.conductivity_at_rest("piola")[1, 1] / at_rest.conductivity[1, 1] - 1) > 0.05


def test_a_state_of_a_swollen_cell_tells_the_porosity_of_the_dry_one(tmp_path):
    """Also where the store holds the state of either cell already."""
    store = ResultStore(tmp_path)
    study = load_config(benchmark_path())
    cells = [Cell(mesh=COARSE, material={"swelling": s}) for s in (1.0, 1.1)]
    configs = [study.model_copy(update={"cell": cell}) for cell in cells]
    for _ in range(2):
        dry, wet = (solve_cell(config, np.zeros((3, 3)), 0.0, store=store) for config in configs)
        assert wet["porosity"] == pytest.approx(dry["porosity"], rel=1e-12)
        assert wet["fluid_volume"] < dry["fluid_volume"] - 0.1


def test_a_cell_that_cannot_be_held_is_refused():
    cell, solver = Cell(mesh=COARSE, material={"swelling": 4.0}), SkfemCellSolver()
    with pytest.raises(ConfigurationError, match=r"held at H = 0 .* let it swell less"):
        CellReference.compute(solver, solver.prepare(cell), cell, "")


def test_the_mean_gradient_closure_refuses_a_stress_at_rest():
    for settings in ({"swelling": 1.1}, {"swelling": {"range": [1.0, 1.1]}}):
        assert "choose closure: potential" in MeanGradientClosure.unfit(Cell(material=settings))
    with pytest.raises(
        ConfigurationError, match="gives the cell a stress at rest; choose closure: potential"
    ):
        make_closure("mean-gradient", 0.6, Cell(material={"swelling": 1.1}).solid, np.eye(3))
