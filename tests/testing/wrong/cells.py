"""Cell solvers that break one law each, made of the one for layers; the class attribute says which."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from porocore.core.tensors import polar_rotation
from porocore.interfaces.cell import CellField, CellSolution
from porocore.states import CellResponse, MacroState, Status
from porocore.testing import CellSolverSuite

sys.path.insert(0, str(Path(__file__).parents[3] / "examples/plugins/porocore-cell-layered"))
import porocore_cell_layered.conformance as layered
from porocore_cell_layered.cell_solver import LayeredCellSolver

#: Of the layers.
SOLID_FRACTION = 0.625


class Altered(LayeredCellSolver):
    """Answers what ``alter`` makes of the right response."""

    def alter(self, response, states):
        return response

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        solution = super().solve(prepared, states, tangent=tangent)
        return CellSolution(self.alter(solution.response, states))


def with_slopes(response, **changed):
    """With some derivatives replaced, where there are any."""
    if response.tangent is None:
        return response
    slopes = {name: change(getattr(response.tangent, name)) for name, change in changed.items()}
    return replace(response, tangent=replace(response.tangent, **slopes))


class _Law(CellSolverSuite):
    kit_version = "5"
    caught_by: ClassVar[str]
    solver_class: ClassVar[type[LayeredCellSolver]] = Altered

    @classmethod
    def make_solver(cls):
        return cls.solver_class()

    @classmethod
    def make_cell(cls, **others):
        return layered.TestLayeredCellSolver.make_cell(**others)


class TestFine(_Law):
    caught_by = ""


class TestStressAtRest(_Law):
    caught_by = "test_rest"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-6)


class TestFlatResponses(_Law):
    caught_by = "test_shapes"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress.reshape(-1, 9))


class TestWrongSign(_Law):
    caught_by = "test_derivatives_match_differences"

    class solver_class(Altered):
        def alter(self, response, states):
            return with_slopes(response, mean_grad_p=lambda values: -values)


class TestNoShear(_Law):
    caught_by = "test_shear_derivatives_of_a_diagonal_state"

    class solver_class(Altered):
        def alter(self, response, states):
            def without(values):
                values = values.copy()
                values[:, 0, 1, 0, 1] = 0.0
                return values

            return with_slopes(response, stress_grad_u=without)


class TestNoPotential(_Law):
    caught_by = "test_reciprocity"

    class solver_class(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_p=lambda values: 1.001 * values)


class TestPressureOnHalfTheWall(_Law):
    caught_by = "test_uniform_pressure_identity"

    class solver_class(Altered):
        def alter(self, response, states):
            return with_slopes(response, mean_grad_p=lambda values: values / 2)


class TestMeansOfTheSolid(_Law):
    """Per volume of the solid, which every other law bears, since all of <∇u¹> is larger by as much."""

    caught_by = "test_averages_belong_together"

    class solver_class(Altered):
        def alter(self, response, states):
            def larger(values):
                return values / SOLID_FRACTION

            altered = with_slopes(response, mean_grad_grad_u=larger, mean_grad_p=larger)
            return replace(altered, mean_grad=larger(response.mean_grad))


class TestNotObjective(_Law):
    caught_by = "test_objectivity"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-3 * states.grad_u)


class TestMeanGradientDoesNotTurn(_Law):
    """Rᵀ<∇u¹> in the place of <∇u¹>."""

    caught_by = "test_a_rotation_of_the_body_rotates_the_flux"

    class solver_class(Altered):
        def alter(self, response, states):
            R = polar_rotation(np.eye(3) + states.grad_u)
            return replace(response, mean_grad=R.swapaxes(1, 2) @ response.mean_grad)


class TestRowsKnowEachOther(_Law):
    caught_by = "test_rows_do_not_depend_on_the_batch_or_its_order"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, potential=response.potential + 1e-4 * (len(states) - 1))


class TestRemembers(_Law):
    caught_by = "test_a_new_solver_gives_the_same"

    class solver_class(Altered):
        made = 0

        def __init__(self):
            super().__init__()
            type(self).made += 1
            self.bias = 1e-4 * type(self).made

        def alter(self, response, states):
            return replace(response, potential=response.potential + self.bias)


class TestAlwaysDerivatives(_Law):
    caught_by = "test_derivatives_only_where_they_are_wanted"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            return super().solve(prepared, states, tangent=True)


class TestChangesItsInputs(_Law):
    caught_by = "test_inputs_are_not_changed"

    class solver_class(Altered):
        def alter(self, response, states):
            states.p[:] *= 1.01
            return response


class TestHidesAFailedState(_Law):
    caught_by = "test_a_state_without_solution_is_a_row_with_a_status"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, status=np.full(len(states), int(Status.converged)))


class TestInventsNumbers(_Law):
    caught_by = "test_a_state_without_solution_is_a_row_with_a_status"

    class solver_class(Altered):
        def alter(self, response, states):
            return replace(response, potential=np.nan_to_num(response.potential))


class TestOneFailureFailsAll(_Law):
    caught_by = "test_a_state_without_solution_is_a_row_with_a_status"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            if (np.linalg.det(np.eye(3) + states.grad_u) <= 0).any():
                bad = MacroState(np.tile(np.diag([0.0, -1.2, 0.0]), (len(states), 1, 1)), states.p)
                return super().solve(prepared, bad, tangent=tangent)
            return super().solve(prepared, states, tangent=tangent)


class TestAnswersFromTheStart(_Law):
    """It returns what was asked for at the start."""

    caught_by = "test_a_start_changes_the_way_and_not_the_answer"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            if start and start[0] is not None:
                states = MacroState(np.stack([f.grad_u for f in start]), np.array([f.p for f in start]))
            response = super().solve(prepared, states, tangent=tangent).response
            rows = zip(states.grad_u, states.p, strict=True)
            kept = [CellField(H, float(p), "whole", np.zeros((1, 3))) for H, p in rows]
            return CellSolution(response, kept if fields else None)


class TestConductivityWithoutViscosity(_Law):
    caught_by = "test_conductivity"

    class solver_class(LayeredCellSolver):
        def conductivity(self, prepared):
            return super().conductivity(prepared) * prepared.cell.viscosity


class TestNegativeConductivity(_Law):
    caught_by = "test_conductivity"

    class solver_class(LayeredCellSolver):
        def conductivity(self, prepared):
            return super().conductivity(prepared) - 0.1 * np.eye(3)


class TestSwallowsOptions(_Law):
    caught_by = "test_unknown_options_are_refused"

    class solver_class(LayeredCellSolver):
        def __init__(self, **ignored):
            super().__init__()


class TestForgetsThePressure(_Law):
    """It keeps what it solved by H alone."""

    caught_by = "test_each_variable_alone_changes_the_answer"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            kept = self.__dict__.setdefault("kept", {})
            rows = []
            for H, p in zip(states.grad_u, states.p, strict=True):
                key = H.tobytes(), tangent
                if key not in kept:
                    kept[key] = super().solve(prepared, MacroState.single(H, p), tangent=tangent).response
                rows.append(kept[key])
            return CellSolution(CellResponse.concatenate(rows))


class TestClipsThePressure(_Law):
    """At 0.2."""

    caught_by = "test_under_a_pressure_on_all_sides_the_solid_deforms_alike"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            clipped = MacroState(states.grad_u, np.clip(states.p, -0.2, 0.2))
            return super().solve(prepared, clipped, tangent=tangent)


class TestNoise(_Law):
    """Of 1e-9."""

    caught_by = "test_two_calls_give_the_same_to_the_last_bit"
    slow = True

    class solver_class(Altered):
        random = np.random.default_rng(0)

        def alter(self, response, states):
            noise = 1e-9 * self.random.normal(size=response.stress.shape)
            return replace(response, stress=response.stress + noise)


class TestConductivityOfAnotherCell(_Law):
    """Larger by 1.7."""

    caught_by = "test_conductivity_has_the_known_value"

    class solver_class(LayeredCellSolver):
        def conductivity(self, prepared):
            return 1.7 * super().conductivity(prepared)


class TestNeverFlagsAnOverlap(_Law):
    """It answers with the state before the wall meets itself."""

    caught_by = "test_an_overlap_has_no_values"

    class solver_class(LayeredCellSolver):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            found = super().solve(prepared, states, tangent=tangent).response
            through = found.status == Status.overlap
            if not through.any():
                return CellSolution(found)
            rest = super().solve(prepared, MacroState.zeros(len(states)), tangent=tangent).response
            volume = np.where(through, -0.1, found.fluid_volume)
            return CellSolution(replace(rest, fluid_volume=volume))


class TestPromisesFields(_Law):
    """It declares fields and returns none."""

    caught_by = "test_fields_are_returned_where_they_are_declared"

    class solver_class(LayeredCellSolver):
        returns_fields = True


class TestPromisesADeformedPore(_Law):
    """It declares the conductivity of the deformed pore, and does not prepare for it."""

    caught_by = "test_conductivity_of_the_deformed_pore"
    raises = "TypeError"

    class solver_class(LayeredCellSolver):
        conductivities = ("piola", "deformed")
