"""Cell solvers that follow a relaxing solid wrongly, made of the one on scikit-fem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.cell.materials.prony import Branch, Relaxation
from porocore.interfaces.cell import CellSolution
from tests.testing.wrong.skfem_cells import Altered, Meshed


def with_branches(relaxation, **changes):
    """With strength or time of each branch changed."""
    kept = dict.fromkeys(("strength", "time"), lambda value: value) | changes
    branches = [Branch(**{key: kept[key](value) for key, value in branch}) for branch in relaxation.branches]
    return Relaxation(branches=branches)


class TestFine(Meshed):
    caught_by = ""


class TestRelaxesTheStressAlone(Meshed):
    """The fluid as in equilibrium at p."""

    caught_by = "test_a_sudden_load_meets_a_stiffer_solid"

    class solver_class(Altered):
        def relax(self, prepared, path, times, relaxation, *, fields=False):
            found = super().relax(prepared, path, times, relaxation, fields=fields)
            elastic = self.solve(prepared, path, tangent=False).response
            return CellSolution(replace(found.response, fluid_volume=elastic.fluid_volume), found.fields)


class TestIsStiffForEver(Meshed):
    caught_by = "test_a_sudden_load_meets_a_stiffer_solid"

    class solver_class(Altered):
        def relax(self, prepared, path, times, relaxation, *, fields=False):
            return super().relax(prepared, path, np.zeros_like(times), relaxation, fields=fields)


class TestAddsABranch(Meshed):
    caught_by = "test_without_strength_a_path_is_elastic"

    class solver_class(Altered):
        def relax(self, prepared, path, times, relaxation, *, fields=False):
            more = with_branches(relaxation, strength=lambda strength: strength + 1e-4)
            return super().relax(prepared, path, times, more, fields=fields)


class TestRelaxesByAnotherTime(Meshed):
    """The half-life in the place of the time in which an overstress falls to 1/e."""

    caught_by = "test_a_small_stress_relaxes_with_the_series"

    class solver_class(Altered):
        def relax(self, prepared, path, times, relaxation, *, fields=False):
            slower = with_branches(relaxation, time=lambda time: time / np.log(2))
            return super().relax(prepared, path, times, slower, fields=fields)


class TestForgetsThatItLostAState(Meshed):
    """The rows behind it begin anew."""

    caught_by = "test_nothing_comes_behind_a_lost_state"

    class solver_class(Altered):
        def relax(self, prepared, path, times, relaxation, *, fields=False):
            found = super().relax(prepared, path, times, relaxation, fields=fields)
            status = found.response.status.copy()
            status[-1] = 0
            return CellSolution(replace(found.response, status=status), found.fields)
