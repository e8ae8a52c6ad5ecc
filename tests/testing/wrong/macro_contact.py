"""Macro solvers that break one law of contact each."""

from __future__ import annotations

from dataclasses import replace

from tests.testing.wrong.skfem_macro import Altered, Elements, Law


class TestFine(Law):
    caught_by = ""


class TestForgetsTheContactInTheTangent(Law):
    caught_by = "test_the_tangent_knows_contact_and_its_drainage"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            return super().system(tangent, dt)


class TestIndenterGoesHalfWay(Law):
    caught_by = "test_a_plane_on_a_whole_face_moves_it"
    slow = True

    class elements(Elements):
        def loads(self, acting):
            found = super().loads(acting)
            return replace(found, indenters=tuple(each / 2 for each in found.indenters))


class TestForceOfAPart(Law):
    caught_by = "test_contact_forces_balance_those_of_the_support"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            return replace(solution, contact={name: 4 * each for name, each in solution.contact.items()})


class TestIndentersComeFromAbove(Law):
    caught_by = "test_a_turned_indentation_is_the_same"
    slow = True
    raises = "ConfigurationError"

    class solver(Altered):
        def problem(self, problem):
            above = {
                name: each.model_copy(update={"direction": (0.0, -1.0, 0.0)})
                for name, each in problem.contact.items()
            }
            return problem.model_copy(update={"contact": above})


class TestPushesTwiceAsHard(Law):
    caught_by = "test_a_force_and_the_displacement_that_it_makes_are_one_state"
    slow = True

    class solver(Altered):
        def problem(self, problem):
            doubled = {
                name: each.model_copy(update={"force": _doubled(each.force)})
                for name, each in problem.contact.items()
            }
            return problem.model_copy(update={"contact": doubled})


def _doubled(force):
    """Return a force from a table, twice as large."""
    if force is None:
        return None
    return force.model_copy(update={"table": tuple((time, 2 * value) for time, value in force.table)})
