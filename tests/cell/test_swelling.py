"""Cells whose solid swells: scaling of the whole solid, regions of their own, rest states, slopes by the stretch."""

from dataclasses import replace

import numpy as np
import pytest

from porocore import MacroState, Status
from porocore.cell.cell import Cell
from porocore.errors import ConfigurationError
from porocore.macro.reference import CellReference
from porocore.verification.local_fields.points import PointFields
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


def test_bodies_of_a_solid_that_swells_are_refused():
    cell, solver = Cell(mesh=COARSE, material={"swelling": 1.1}), SkfemCellSolver()
    with pytest.raises(ConfigurationError, match="the solid swells"):
        CellReference.compute(solver, solver.prepare(cell), cell, "")
