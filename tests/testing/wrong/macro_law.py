"""Macroscopic laws that break one check of the kit each."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from porocore.interfaces.law import Interval, LawWrapper, MemoryChanges
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.testing import MacroLawSuite
from porocore.testing.synthetic.response import AlteredLaw, GradientLaw, linear_law, mean_gradient_law


class Law(MacroLawSuite):
    """Of a law whose responses are altered."""

    kit_version = "5"
    caught_by: ClassVar[str]
    linear: ClassVar[bool] = False
    constant: ClassVar[bool] = False

    by_gradient: ClassVar[bool] = False

    @classmethod
    def make_law(cls):
        law: Any = linear_law() if cls.linear else mean_gradient_law()
        law = AlteredLaw(GradientLaw(law) if cls.by_gradient else law, cls.alter)
        law.constant_tangent = cls.constant
        return law

    @staticmethod
    def alter(response, states, memory):
        return response


class TestFine(Law):
    caught_by = ""


class TestFineAndConstant(Law):
    caught_by = ""
    linear, constant = True, True


class TestFineByTheGradientOfThePressure(Law):
    caught_by = ""
    linear, constant, by_gradient = True, True, True


class TestForgetsTheGradientOfThePressure(Law):
    """The storage depends on it, and the tangent says nothing of that."""

    caught_by = "test_the_tangent_is_the_derivative_of_the_response"
    by_gradient = True

    @staticmethod
    def alter(response, states, memory):
        if response.tangent is None:
            return response
        return replace(response, tangent=replace(response.tangent, storage_grad_p=None))


class TestStiffTangent(Law):
    caught_by = "test_the_tangent_is_the_derivative_of_the_response"

    @staticmethod
    def alter(response, states, memory):
        if response.tangent is None:
            return response
        tangent = replace(response.tangent, storage_p=1.01 * response.tangent.storage_p)
        return replace(response, tangent=tangent)


class TestPromisesAConstantTangent(Law):
    """A nonlinear law says that its tangent is constant."""

    caught_by = "test_a_tangent_that_is_said_to_be_constant_is_so"
    constant = True


class TestConstantAtEachPoint(Law):
    """The tangent does not change, but is not the same at all points."""

    caught_by = "test_a_tangent_that_is_said_to_be_constant_is_so"
    linear, constant = True, True

    @staticmethod
    def alter(response, states, memory):
        if response.tangent is None:
            return response
        flux = response.tangent.flux_grad_p.copy()
        flux[-1] *= 2
        return replace(response, tangent=replace(response.tangent, flux_grad_p=flux))


class TestForgetsItsFluid(Law):
    """The fluid volume of the memory is that of the state before."""

    caught_by = "test_what_is_taken_up_is_the_change_of_the_stored_fluid"

    @staticmethod
    def alter(response, states, memory):
        return replace(response, memory=replace(response.memory, fluid_volume=memory.fluid_volume))


class TestPointsKnowEachOther(Law):
    caught_by = "test_points_do_not_depend_on_one_another"

    @staticmethod
    def alter(response, states, memory):
        return replace(response, stress=response.stress * (1 + 1e-6 * len(states)))


class TestRoughWithoutTheTangent(Law):
    """In single precision where no tangent is wanted."""

    caught_by = "test_without_the_tangent_the_response_is_the_same"

    @staticmethod
    def alter(response, states, memory):
        if response.tangent is not None:
            return response
        return replace(response, stress=response.stress.astype("float32").astype(float))


class RelaxingAtPoints(LawWrapper):
    """A nonlinear law that relaxes, with derivatives; a subclass spoils what it answers."""

    def __init__(self):
        super().__init__(RelaxingLaw(mean_gradient_law(), 2))

    def respond_to_each(self, states, gradients, memory, *, step=None, tangent=True):
        found = super().respond_to_each(states, gradients, memory, step=step, tangent=tangent)
        return [self.alter(response, states, memory, step) for response in found]

    def respond_to_changes(self, states, grad_p, memory, changes, before, *, step=None):
        changes, before = self.unknowns(changes, before)
        response, found = super().respond_to_changes(states, grad_p, memory, changes, before, step=step)
        return self.alter(response, states, memory, step), self.alter_changes(found)

    def alter(self, response, states, memory, step):
        return response

    def unknowns(self, changes, before):
        return changes, before

    def alter_changes(self, found):
        return found


class Remembering(MacroLawSuite):
    """Of a law with internal variables."""

    kit_version = "5"
    caught_by: ClassVar[str]
    values: ClassVar[dict[str, tuple[float, float]]] = {
        "relaxation.1.strength": (0.5, 1.5),
        "relaxation.1.time": (0.5, 2.0),
        "relaxation.2.strength": (0.1, 0.4),
        "relaxation.2.time": (5.0, 9.0),
    }
    step = Interval(1.0, 1.4)
    derivatives = True
    law_class: ClassVar[Any] = RelaxingAtPoints

    @classmethod
    def make_law(cls):
        return cls.law_class()


class TestFineAndRelaxing(Remembering):
    caught_by = ""


class TestFineRelaxingAndConstant(Remembering):
    caught_by = ""

    @classmethod
    def make_law(cls):
        return RelaxingLaw(linear_law(), 2, small_strain=True)


class TestRemembersTheStateBefore(Law):
    """H and p of the memory are those at the beginning of the step."""

    caught_by = "test_the_memory_is_that_of_the_end"

    @staticmethod
    def alter(response, states, memory):
        return replace(response, memory=replace(response.memory, states=memory.states))


class TestForgetsToCommit(Remembering):
    """The internal variables handed back are those at the beginning of the step."""

    caught_by = "test_the_memory_is_that_of_the_end"
    derivatives = False

    class law_class(RelaxingAtPoints):
        def alter(self, response, states, memory, step):
            return replace(response, memory=replace(response.memory, internal=memory.internal))


class TestForgetsToCommitOne(Remembering):
    """The stress from which the next step relaxes stays that at rest; all else is handed back."""

    caught_by = "test_the_memory_is_that_of_the_end"
    derivatives = False

    class law_class(RelaxingAtPoints):
        def alter(self, response, states, memory, step):
            internal = response.memory.internal.copy()
            internal[:, -10:-1] = memory.internal[:, -10:-1]
            return replace(response, memory=replace(response.memory, internal=internal))


class TestHandsBackMoreThanItDeclares(Remembering):
    caught_by = "test_the_memory_is_that_of_the_end"

    class law_class(RelaxingAtPoints):
        def __init__(self):
            super().__init__()
            self.internal = self.internal[:-1]


class TestCommitsInPlace(Remembering):
    """Each answer overwrites the memory with which the step began, whether the step is accepted or not."""

    caught_by = "test_an_answer_depends_on_what_is_given_alone"

    class law_class(RelaxingAtPoints):
        def alter(self, response, states, memory, step):
            memory.internal[:] = response.memory.internal
            return response


class TestCommitsWhenAsked(Remembering):
    """It goes on from the internal variables of its last answer, which no one has accepted."""

    caught_by = "test_an_answer_depends_on_what_is_given_alone"

    class law_class(RelaxingAtPoints):
        last = None

        def memory_in(self, memory, states):
            if self.last is None or self.last.shape != memory.internal.shape:
                return memory
            return replace(memory, internal=self.last)

        def alter(self, response, states, memory, step):
            self.last = response.memory.internal
            return response


class TestTangentWithoutTheMemory(Remembering):
    """The tangent is that of a step that begins at rest."""

    caught_by = "test_the_tangent_is_the_derivative_of_the_response"
    derivatives = False

    class law_class(RelaxingAtPoints):
        def alter(self, response, states, memory, step):
            if response.tangent is None:
                return response
            still = np.zeros((len(states), 3))
            return replace(
                response, tangent=self.law.respond(states, still, self.initial_at(states), step=step).tangent
            )


class TestTangentOfEquilibrium(Remembering):
    """The tangent is that of a solid that has relaxed."""

    caught_by = "test_the_tangent_is_the_derivative_of_the_response"
    derivatives = False

    class law_class(RelaxingAtPoints):
        def alter(self, response, states, memory, step):
            if response.tangent is None:
                return response
            still = np.zeros((len(states), 3))
            return replace(response, tangent=self.law.respond(states, still, memory).tangent)


class TestDerivativesWithoutTheMemory(Remembering):
    """As if the memory did not depend on the unknowns."""

    caught_by = "test_derivatives_by_parameters_and_memory_are_slopes"

    class law_class(RelaxingAtPoints):
        def unknowns(self, changes, before):
            return changes, MemoryChanges.zeros(*before.internal.shape)


class TestDerivativesWithoutTheTimes(Remembering):
    """Those by the time of a branch are missing."""

    caught_by = "test_derivatives_by_parameters_and_memory_are_slopes"

    class law_class(RelaxingAtPoints):
        def unknowns(self, changes, before):
            theta = changes.parameters.copy()
            theta[:, 1] = 0.0
            return replace(changes, parameters=theta), before


class TestInternalVariablesWithoutDerivatives(Remembering):
    """Those by the unknowns, at a fixed state."""

    caught_by = "test_derivatives_by_parameters_and_memory_are_slopes"

    class law_class(RelaxingAtPoints):
        def alter_changes(self, found):
            return replace(found, internal=0.0 * found.internal)


class TestInternalVariablesThatIgnoreTheDeformation(Remembering):
    """Their derivatives by H are missing."""

    caught_by = "test_derivatives_by_parameters_and_memory_are_slopes"

    class law_class(RelaxingAtPoints):
        def alter_changes(self, found):
            return replace(found, internal_grad_u=0.0 * found.internal_grad_u)


class TestInternalVariablesThatIgnoreThePressure(Remembering):
    """Their derivatives by p are missing."""

    caught_by = "test_derivatives_by_parameters_and_memory_are_slopes"

    class law_class(RelaxingAtPoints):
        def alter_changes(self, found):
            return replace(found, internal_p=0.0 * found.internal_p)
