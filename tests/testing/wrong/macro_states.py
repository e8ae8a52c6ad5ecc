"""Macro solvers that break one law of exact states each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.testing.wrong.skfem_macro import Altered, Elements, Law, Loaded


class TestFine(Law):
    caught_by = ""


class TestWrongSign(Law):
    caught_by = "test_tangent_is_the_derivative_of_the_residual"

    class elements(Elements):
        def system(self, tangent, dt, follower=None):
            return super().system(replace(tangent, stress_p=-tangent.stress_p), dt, follower)


class TestForgetsTheFluxBySqueezing(Law):
    """Of the conductivity that changes with H."""

    caught_by = "test_tangent_is_the_derivative_of_the_residual"

    class elements(Elements):
        def system(self, tangent, dt, follower=None):
            return super().system(replace(tangent, flux_grad_u=0 * tangent.flux_grad_u), dt, follower)


class TestForgetsTheStressByTheGradient(Law):
    """Of the pressure."""

    caught_by = "test_tangent_knows_what_depends_on_the_gradient_of_the_pressure"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            return super().system(replace(tangent, stress_grad_p=None), dt, surface)


class TestForgetsTheStorageByTheGradient(Law):
    """Of the pressure."""

    caught_by = "test_tangent_knows_what_depends_on_the_gradient_of_the_pressure"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            return super().system(replace(tangent, storage_grad_p=None), dt, surface)


class TestDoesNotTranspose(Law):
    caught_by = "test_tangent_knows_what_depends_on_the_gradient_of_the_pressure"

    class elements(Elements):
        def transposed(self, system):
            return system


class TestOneGradientAnElement(Law):
    caught_by = "test_gradients_of_a_quadratic_displacement_and_a_linear_pressure_are_exact"

    class elements(Elements):
        def states_of(self, x):
            states, grad_p = super().states_of(x)
            means = self.means(states.grad_u)
            return replace(states, grad_u=np.repeat(means, self.n_points // len(means), axis=0)), grad_p


class TestForgetsTheQuadraticPart(Law):
    """Gradients by the corners alone."""

    caught_by = "test_gradients_of_a_quadratic_displacement_and_a_linear_pressure_are_exact"

    class elements(Elements):
        def states_of(self, x):
            x, cells = x.copy(), self.mesh.cells
            u = x[: self.mesh.n_u].reshape(-1, 3)
            corners = self.mesh.element.corner_values(self.mesh.element.nodes)
            u[cells] = np.einsum("ac,eci->eai", corners, u[cells[:, : corners.shape[1]]])
            return super().states_of(x)


class TestOtherOrderOfNodes(Law):
    """Lexicographic, as many codes have it."""

    caught_by = "test_cells_are_triquadratic_hexahedra_in_vtk_order"

    class solver(Altered):
        def solution(self, solution):
            nodes = solution.points[solution.cells[0]]
            return replace(solution, cells=solution.cells[:, np.lexsort(nodes.T)])


class TestPrescribesTwice(Law):
    caught_by = "test_uniform_drained_strain_is_reproduced"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            return replace(loads, values=2 * loads.values)


class TestLeaks(Law):
    """A little of the pressure is stored nowhere."""

    caught_by = "test_undrained_column_keeps_its_fluid"

    class elements(Elements):
        def contributions(self, response):
            lost = 1e-3 * response.memory.states.p
            return super().contributions(replace(response, storage=response.storage + lost))


class TestFluxAgainstTheNormal(Law):
    caught_by = "test_prescribed_inflow_ends_in_a_linear_pressure"

    class elements(Loaded):
        def alter(self, loads):
            return replace(loads, external=np.where(self.is_force, 1, -1) * loads.external)


class TestPressuresWithoutTheLoad(Law):
    caught_by = "test_prescribed_pressure_scales_with_the_load"

    class elements(Loaded):
        def alter(self, loads):
            share = np.where(self.is_force[self.prescribed], 1, self.problem.load)
            return replace(loads, values=loads.values / share)


class TestWeightThatNobodyAskedFor(Law):
    caught_by = "test_without_load_nothing_happens"

    class elements(Loaded):
        def alter(self, loads):
            down = (np.arange(len(loads.external)) % 3 == 1) & self.is_force
            return replace(loads, external=loads.external + 1e-9 * down)


class TestHeaveIsTheSettlement(Law):
    caught_by = "test_prescribed_inflow_ends_in_a_linear_pressure"

    class solver(Altered):
        def solution(self, solution):
            return replace(solution, history=replace(solution.history, heave=solution.history.settlement))


class TestLeastPressureIsTheLargest(Law):
    caught_by = "test_prescribed_pressure_scales_with_the_load"

    class solver(Altered):
        def solution(self, solution):
            largest = solution.history.pressure_max
            return replace(solution, history=replace(solution.history, pressure_min=largest))
