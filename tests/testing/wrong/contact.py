"""Cell solvers that break one law of contact each, made of the one on scikit-fem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.cell.contact.wall_contact import ContactSettings
from porocore.states import MacroState, Status
from tests.testing.wrong.skfem_cells import Altered, Contact, with_slopes


class TestFine(Contact):
    caught_by = ""


class TestKeepsItToItself(Contact):
    caught_by = "test_says_so"

    class solver_class(Altered):
        def alter(self, response, cell):
            touching = response.status == Status.contact
            return replace(response, status=np.where(touching, Status.converged, response.status))


class TestWithoutTheEnergyOfContact(Contact):
    caught_by = "test_stress_and_fluid_volume_derive_from_the_potential"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            return replace(response, potential=0.999 * response.potential)


class TestWithoutTheStiffnessOfContact(Contact):
    caught_by = "test_derivatives_match_differences"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            return with_slopes(response, stress_grad_u=lambda values: 0.999 * values)


class TestFluidVolumeFeelsNoContact(Contact):
    caught_by = "test_derivatives_match_differences"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            return with_slopes(response, fluid_volume_p=lambda values: 1.001 * values)


class TestNotReciprocal(Contact):
    caught_by = "test_reciprocity"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            return with_slopes(response, stress_p=lambda values: 1.001 * values)


class TestAsStiffAsThePenalty(Contact):
    caught_by = "test_the_stiffness_hardly_matters"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            share = cell.contact.stiffness / ContactSettings().stiffness
            return replace(response, stress=(1 + 0.1 * (share - 1)) * response.stress)


class TestTakesTheOverlap(Contact):
    caught_by = "test_a_wall_that_gives_way_overlaps"
    slow = True

    class solver_class(Altered):
        def alter(self, response, cell):
            through = response.status == Status.overlap
            return replace(response, status=np.where(through, Status.converged, response.status))


class TestStaysWhereItStarts(Contact):
    caught_by = "test_a_start_in_contact_changes_the_way_and_not_the_answer"
    slow = True

    class solver_class(Altered):
        def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
            if start and start[0] is not None:
                states = MacroState(np.stack([f.grad_u for f in start]), np.array([f.p for f in start]))
            return super().solve(prepared, states, start=start, tangent=tangent, fields=fields)


class TestPromisesContact(Contact):
    """It declares contact and solves without."""

    caught_by = "test_says_so"
    slow = True

    class solver_class(Altered):
        def prepare(self, cell, **how):
            return super().prepare(cell.model_copy(update={"contact": ContactSettings(kind="none")}), **how)
