"""Cell solvers of any geometry that break one law each, made of the one on scikit-fem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.core.tensors import polar_rotation
from porocore.interfaces.records import failed_response
from porocore.states import Status
from tests.testing.wrong.skfem_cells import Altered, Meshed, with_slopes


class TestFine(Meshed):
    caught_by = ""


class TestPrefersAnAxis(Meshed):
    caught_by = "test_cubic_symmetry"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            along = np.ones((3, 3, 3, 3))
            along[2, 2, 2, 2] = 1.001
            return with_slopes(response, mean_grad_grad_u=lambda values: along * values)


class TestForgetsTheImages(Meshed):
    """An eighth of the energy, where an eighth of the cell is solved."""

    caught_by = "test_eighth_and_whole_cell_agree"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            share = 1 if cell.symmetry == "none" else 1 / 8
            return replace(response, potential=share * response.potential)


class TestClosedAlongAnAxis(Meshed):
    caught_by = "test_the_flow_percolates_along_every_axis"
    slow = True

    class solver_class(Altered):
        def conductivity(self, prepared):
            return super().conductivity(prepared) * np.diag([1, 1, 0])


class TestCountsTheImagesTwice(Meshed):
    caught_by = "test_the_flow_percolates_along_every_axis"
    slow = True

    class solver_class(Altered):
        def conductivity(self, prepared):
            return super().conductivity(prepared) * (2 if prepared.cell.symmetry == "none" else 1)


class TestSlipsAlongTheWall(Meshed):
    """Parabola and a uniform velocity."""

    caught_by = "test_conductivity_of_a_straight_channel"

    class solver_class(Altered):
        def conductivity(self, prepared):
            return 1.05 * super().conductivity(prepared)


class TestFlowsThroughTheSolid(Meshed):
    caught_by = "test_conductivity_of_a_straight_channel"

    class solver_class(Altered):
        def conductivity(self, prepared):
            K = super().conductivity(prepared)
            return K + 0.01 * K.max() * np.eye(3)


class TestDoesNotSeeTheOverlap(Meshed):
    caught_by = "test_a_failed_state_does_not_take_the_others_along"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            status = np.where(response.status == Status.overlap, Status.not_converged, response.status)
            return replace(response, status=status)


class TestTakesACurvedWallForAnOverlap(Meshed):
    """By its corners alone, as if the wall between them had bulged into the pore."""

    caught_by = "test_a_strain_of_one_percent_is_no_overlap"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            if cell.geometry.unfolding != "whole":
                return response
            return failed_response(Status.overlap, tangent=response.tangent is not None)


class TestOneFailureFailsAll(Meshed):
    caught_by = "test_a_failed_state_does_not_take_the_others_along"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            lost = np.where(response.valid.all(), 1.0, np.nan)
            return replace(response, stress=lost * response.stress)


class TestConductivityAtRest(Meshed):
    """Of the pore, however it is deformed."""

    caught_by = "test_conductivity_of_the_deformed_pore"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            if response.conductivity is None:
                return response
            K = np.where(np.isnan(response.conductivity), np.nan, response.conductivity[:1])
            return replace(response, conductivity=K)


class TestPushesItForward(Meshed):
    """A conductivity of the deformed cell, k = F K_ref Fᵀ/J, in the place of K_ref."""

    caught_by = "test_conductivity_of_the_deformed_pore"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            if response.conductivity is None:
                return response
            J = response.min_fluid_jacobian[:, None, None]
            return replace(response, conductivity=response.conductivity * J ** (2 / 3) / J)


class TestConductivityTurnsWithTheBody(Meshed):
    """R K_ref Rᵀ in the place of K_ref, which belongs to the undeformed cell and does not turn."""

    caught_by = "test_a_rotation_of_the_body_rotates_the_flux"
    slow = True

    class solver_class(Altered):
        def solve(self, prepared, states, **how):
            solution = super().solve(prepared, states, **how)
            K, R = solution.response.conductivity, polar_rotation(np.eye(3) + states.grad_u)
            if K is None:
                return solution
            return replace(
                solution, response=replace(solution.response, conductivity=R @ K @ R.swapaxes(1, 2))
            )


class TestInventsTheFlowOfAFailedState(Meshed):
    caught_by = "test_conductivity_of_the_deformed_pore"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            if response.conductivity is None:
                return response
            return replace(response, conductivity=np.nan_to_num(response.conductivity))
