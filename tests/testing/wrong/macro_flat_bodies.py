"""Macro solvers that break one law of bodies in two dimensions each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.testing.wrong.skfem_macro import Altered, Elements, Law


class TestFine(Law):
    caught_by = ""


class TestForgetsTheHoop(Law):
    """A plane section, not a meridian: H_33 = 0."""

    caught_by = "test_the_hoop_of_a_tube_is_stretched_with_its_radius"

    class elements(Elements):
        def states_of(self, x):
            states, grad_p = super().states_of(x)
            return replace(states, grad_u=states.grad_u * np.diag([1, 1, 0]).clip(1 - np.eye(3))), grad_p


class TestTangentWithoutTheHoop(Law):
    caught_by = "test_the_tangent_is_the_derivative_of_the_residual_in_two_dimensions"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            if self.mesh.revolved:
                stiffness = tangent.stress_grad_u.copy()
                stiffness[:, 2, 2] = 0
                tangent = replace(tangent, stress_grad_u=stiffness)
            return super().system(tangent, dt, surface)


class TestFollowerOnTheFirstCircle(Law):
    """The pressure acts on the circumference at rest."""

    caught_by = "test_a_pressure_all_around_follows_a_surface_of_revolution"

    class elements(Elements):
        def surface_forces(self, x, loads, dt):
            return super().surface_forces(0 * x, loads, dt)

        def surface_tangent(self, x, loads, dt):
            return None


class TestForcesOfARadian(Law):
    caught_by = "test_forces_and_volumes_are_those_of_the_whole_revolution_or_depth"

    class solver(Altered):
        def solution(self, solution):
            shares = {name: force / (2 * np.pi) for name, force in solution.reactions.items()}
            return replace(solution, reactions=shares)


class TestThinPlate(Law):
    """It narrows along z as it is stretched, as in plane stress."""

    caught_by = "test_plane_strain_is_a_layer_of_bricks"
    slow = True

    class elements(Elements):
        def states_of(self, x):
            states, grad_p = super().states_of(x)
            H = states.grad_u.copy()
            if self.mesh.flat:
                H[:, 2, 2] = -0.3 * (H[:, 0, 0] + H[:, 1, 1])
            return replace(states, grad_u=H), grad_p
