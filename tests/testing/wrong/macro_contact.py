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

    class elements(Elements):
        def loads(self, acting):
            found = super().loads(acting)
            return replace(found, indenters=tuple(each / 2 for each in found.indenters))


class TestForceOfAPart(Law):
    caught_by = "test_contact_forces_balance_those_of_the_support"

    class solver(Altered):
        def solution(self, solution):
            return replace(solution, contact={name: 4 * each for name, each in solution.contact.items()})


class TestIndentersComeFromAbove(Law):
    caught_by = "test_a_turned_indentation_is_the_same"
    raises = "ConfigurationError"

    class solver(Altered):
        def problem(self, problem):
            above = {
                name: each.model_copy(update={"direction": (0.0, -1.0, 0.0)})
                for name, each in problem.contact.items()
            }
            return problem.model_copy(update={"contact": above})
