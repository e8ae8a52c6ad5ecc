"""Macroscopic laws that break one check of the kit each."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from porocore.testing import MacroLawSuite
from porocore.testing.synthetic.response import AlteredLaw, GradientLaw, linear_law, mean_gradient_law


class Law(MacroLawSuite):
    """Of a law whose responses are altered."""

    kit_version = "4"
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
