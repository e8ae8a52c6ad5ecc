"""Cell solvers that break one law of cells with parameters each, made of the one for layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.interfaces.cell import CellSolution
from porocore.states import CellSlopes, MacroState
from porocore.testing.expect import RESPONSES, STEPS, central_difference
from tests.testing.wrong.cells import LayeredCellSolver, _Law


class Sloped(LayeredCellSolver):
    """Answers with slopes by the parameters, from differences of members; ``spoil`` makes of them what is wrong."""

    slopes = True

    def spoil(self, slopes):
        return slopes

    def hessian_slopes_at_rest(self, prepared):
        rest = MacroState.zeros(1)
        by_parameter = [
            self._differences(prepared.cell, rest, k, tangent=True)
            for k in range(len(prepared.cell.parameters))
        ]
        return np.stack([one["hessian"][0] for one in by_parameter], axis=-1)

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        response, cell = super().solve(prepared, states, tangent=tangent).response, prepared.cell
        if not tangent or not cell.parameters:
            return CellSolution(response)
        by_parameter = [self._differences(cell, states, k) for k in range(len(cell.parameters))]
        found = {name: np.stack([one[name] for one in by_parameter], axis=-1) for name in by_parameter[0]}
        return CellSolution(replace(response, slopes=self.spoil(CellSlopes(**found))))

    def _differences(self, cell, states, k, tangent=False):
        parameter = cell.parameters[k]
        h = 1e-2 * (parameter.upper - parameter.lower)
        members = [cell.at(cell.parameter_values + s * h * np.eye(len(cell.parameters))[k]) for s in STEPS]
        ends = [super(Sloped, self).solve(self.prepare(m), states, tangent=tangent).response for m in members]
        K = [np.tile(self.conductivity(self.prepare(m)), (len(states), 1, 1)) for m in members]
        values = {name: [getattr(end, name) for end in ends] for name in RESPONSES} | {"conductivity": K}
        if tangent:
            values["hessian"] = [end.tangent.hessian for end in ends]
        found = {name: central_difference(some, h) for name, some in values.items()}
        failed = np.isnan(found["potential"])
        found["conductivity"][failed] = np.nan
        return found | {"porosity": np.where(failed, np.nan, 0.0)}


class TestRightSlopes(_Law):
    caught_by = ""
    solver_class = Sloped


class TestSlopesInAnotherOrder(_Law):
    caught_by = "test_slopes_match_differences"

    class solver_class(Sloped):
        def spoil(self, slopes):
            return CellSlopes(
                **{name: values[..., ::-1] for name, values in vars(slopes).items() if values is not None}
            )


class TestForgetsTheMixedDerivatives(_Law):
    """Slopes of stress at fixed u¹, as it were."""

    caught_by = "test_slopes_match_differences"

    class solver_class(Sloped):
        def spoil(self, slopes):
            return replace(slopes, stress=0.99 * slopes.stress)


class TestForgetsThePressureInTheHessian(_Law):
    caught_by = "test_slopes_of_the_hessian_at_rest"
    slow = True

    class solver_class(Sloped):
        def hessian_slopes_at_rest(self, prepared):
            found = super().hessian_slopes_at_rest(prepared)
            found[9, 9] = 0.0
            return found


class TestPromisesSlopes(_Law):
    """It declares slopes and returns none."""

    caught_by = "test_slopes_are_there_or_not_offered"

    class solver_class(LayeredCellSolver):
        slopes = True


class TestSlopesWithoutValues(_Law):
    """Slopes are 0 where the state has none."""

    caught_by = "test_slopes_of_a_state_without_values"

    class solver_class(Sloped):
        def spoil(self, slopes):
            return CellSlopes(
                **{name: np.nan_to_num(values) for name, values in vars(slopes).items() if values is not None}
            )


class TestSolvesTheBase(_Law):
    """It answers for the middle of the ranges, whichever member is asked."""

    caught_by = "test_a_member_is_the_cell_with_its_numbers"

    class solver_class(LayeredCellSolver):
        def prepare(self, cell):
            return super().prepare(cell.at([p.base for p in cell.parameters]) if cell.parameters else cell)
