"""Macro solvers that break one law of rigid plates each."""

from __future__ import annotations

from dataclasses import replace

from tests.testing.wrong.skfem_macro import Elements, Law, Loaded, TakesAnything


class TestFine(Law):
    caught_by = ""


class TestLoosePlate(Law):
    caught_by = "test_a_plate_moves_as_one_and_bears_its_force"
    slow = True

    class elements(Elements):
        def solve(self, system, right, jump, **how):
            change = super().solve(system, right, jump, **how)
            for places in self.plates:
                change[self.free[places[1:]]] *= 0.99
            return change


class TestPlateWithoutItsForce(Law):
    """The force of a plate is lost where it is summed over the plate's unknowns."""

    caught_by = "test_a_plate_moves_as_one_and_bears_its_force"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            external = loads.external.copy()
            for places in self.plates:
                external[self.free[places]] *= 0.9
            return replace(loads, external=external)


class TestPushesDeeperThanItMoves(Law):
    caught_by = "test_a_pushed_plate_is_a_face_moved_by_as_much"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            return replace(loads, values=0.99 * loads.values)


class TestPlateBearsTwice(Law):
    caught_by = "test_on_a_column_a_plate_is_a_traction"
    slow = True

    class elements(Loaded):
        def alter(self, loads):
            external = loads.external.copy()
            for places in self.plates:
                external[self.free[places]] *= 2
            return replace(loads, external=external)


class TestTearsThePlate(Law):
    """What is held wins over the plate."""

    caught_by = "test_a_plate_whose_edge_is_held_is_refused"

    class solver(TakesAnything):
        def without(self, problem):
            faces = {name: face.model_copy(update={"plate": None}) for name, face in problem.boundary.items()}
            return problem.model_copy(update={"boundary": faces})
