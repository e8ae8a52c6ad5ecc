"""A law as a function of the state: it is that of the macro solver, and its derivatives are the slopes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import porocore
from porocore.cell.family.family import CellParameter
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw, MacroLaw
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.linear import LinearCoefficients, LinearisedLaw, LinearPoroelasticity
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import CellResponse, MacroState
from porocore.testing.synthetic.cell import SOLID_FRACTION, BoundCell, parametric_law, porosity, respond
from porocore.testing.synthetic.response import cubic_reference
from tests.helpers.made_up_conductivity import conductivity

MATERIAL = NeoHookean()
K = np.array([[1.9, 0.2, -0.1], [0.2, 1.5, 0.05], [-0.1, 0.05, 2.2]])
POROSITY = 1 - SOLID_FRACTION
STEP = 1e-5


class MadeUp(CellLaw):
    """The made-up cell with the conductivity of its deformed pore; it counts how often it is asked."""

    identity = "made-up"

    def __init__(self) -> None:
        self.asked = 0

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        self.asked += 1
        found = replace(
            respond(states), conductivity=conductivity(states), doubt=(states.p > 0.1).astype(np.int64)
        )
        assert found.tangent is not None
        by_H = np.zeros((len(states), 3, 3, 3, 3))
        for k in range(9):
            moved = 1e-6 * np.eye(9)[k].reshape(3, 3)
            ends = [conductivity(MacroState(states.grad_u + s * moved, states.p)) for s in (1, -1)]
            by_H[..., k // 3, k % 3] = (ends[0] - ends[1]) / 2e-6
        ends = [conductivity(MacroState(states.grad_u, states.p + s * 1e-6)) for s in (1, -1)]
        slopes = replace(found.tangent, conductivity_grad_u=by_H, conductivity_p=(ends[0] - ends[1]) / 2e-6)
        return replace(found, tangent=slopes if tangent else None)

    def reasons(self, states: MacroState) -> list[str]:
        return ["p" if flagged else "" for flagged in states.p > 0.1]


def linear() -> LinearPoroelasticity:
    return LinearPoroelasticity(
        LinearCoefficients.from_reference(cubic_reference(), SOLID_FRACTION, MATERIAL, K)
    )


LAWS: dict[str, Callable[[], MacroLaw]] = {
    "linear": linear,
    "mean-gradient": lambda: ClosedLaw(MadeUp(), MeanGradientClosure(SOLID_FRACTION, MATERIAL, K)),
    "potential": lambda: ClosedLaw(MadeUp(), PotentialClosure(SOLID_FRACTION, MATERIAL, K)),
    "deformed": lambda: ClosedLaw(MadeUp(), PotentialClosure(SOLID_FRACTION, MATERIAL, K, law="deformed")),
}
MOVING = np.random.default_rng(8)
N = 5
H, P = 0.06 * MOVING.standard_normal((N, 3, 3)), 0.1 * MOVING.standard_normal(N)
OLD_H, OLD_P = 0.06 * MOVING.standard_normal((N, 3, 3)), 0.1 * MOVING.standard_normal(N)
GRADIENT = MOVING.standard_normal((N, 3))


@pytest.fixture(params=LAWS)
def macro(request: pytest.FixtureRequest) -> MacroLaw:
    return LAWS[request.param]()


def test_the_point_law_is_that_of_the_macro_solver(macro: MacroLaw) -> None:
    """The second of two steps, with the flux under any gradient of the pressure."""
    law = porocore.Law(macro, POROSITY)
    before = law.response(OLD_H, OLD_P, tangent=False)
    found = law.response(H, P, before=before)
    begun = macro.respond(MacroState(OLD_H, OLD_P), np.zeros((N, 3)), macro.initial(N))
    there = macro.respond(MacroState(H, P), GRADIENT, begun.memory)
    np.testing.assert_array_equal(found.stress, there.stress)
    np.testing.assert_array_equal(found.deformation, there.deformation)
    np.testing.assert_array_equal(found.flagged, there.flagged)
    np.testing.assert_allclose(
        found.fluid_volume - before.fluid_volume, there.storage, rtol=1e-12, atol=1e-15
    )
    flux = -np.einsum("nij,nj->ni", found.conductivity, GRADIENT)
    np.testing.assert_allclose(flux, there.flux, rtol=1e-12, atol=1e-13)
    d, expected = found.tangent, there.tangent
    assert d is not None
    assert expected is not None
    for mine, its in (
        (d.stress_grad_u, expected.stress_grad_u),
        (d.stress_p, expected.stress_p),
        (d.fluid_volume_grad_u, expected.storage_grad_u),
        (d.fluid_volume_p, expected.storage_p),
        (-np.einsum("nijkl,nj->nikl", d.conductivity_grad_u, GRADIENT), expected.flux_grad_u),
        (-np.einsum("nij,nj->ni", d.conductivity_p, GRADIENT), expected.flux_p),
    ):
        np.testing.assert_allclose(mine, its, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("response", ["stress", "fluid_volume", "conductivity"])
def test_derivatives_are_the_slopes(macro: MacroLaw, response: str) -> None:
    law = porocore.Law(macro, POROSITY)
    before = law.response(OLD_H, OLD_P, tangent=False)

    def at(moved_H: np.ndarray, moved_p: float) -> np.ndarray:
        found = law.response(H + moved_H, P + moved_p, before=before, tangent=False)
        assert found.tangent is None
        return getattr(found, response)

    d = law.response(H, P, before=before).tangent
    by_H, by_p = getattr(d, f"{response}_grad_u"), getattr(d, f"{response}_p")
    for k in range(9):
        moved = STEP * np.eye(9)[k].reshape(3, 3)
        slope = (at(moved, 0) - at(-moved, 0)) / (2 * STEP)
        np.testing.assert_allclose(by_H[..., k // 3, k % 3], slope, rtol=1e-6, atol=1e-7)
    slope = (at(np.zeros((3, 3)), STEP) - at(np.zeros((3, 3)), -STEP)) / (2 * STEP)
    np.testing.assert_allclose(by_p, slope, rtol=1e-6, atol=1e-7)


def test_at_rest_it_has_the_porosity_and_the_conductivity_of_the_cell(macro: MacroLaw) -> None:
    found = porocore.Law(macro, POROSITY).response(np.zeros((3, 3)))
    expected = (
        conductivity(MacroState.zeros(1))[0]
        if getattr(macro, "closure", None) and macro.closure.law == "deformed"
        else K
    )  # type: ignore[attr-defined]
    assert found.fluid_volume == pytest.approx(POROSITY, abs=1e-12)
    np.testing.assert_allclose(found.conductivity[0], expected, rtol=1e-12)
    np.testing.assert_allclose(found.stress, 0, atol=1e-12)


def test_the_surrogate_is_asked_once_for_n_states() -> None:
    cell = MadeUp()
    law = porocore.Law(ClosedLaw(cell, PotentialClosure(SOLID_FRACTION, MATERIAL, K)), POROSITY)
    asked = cell.asked
    found = law.response(H, [0.0, 0.2, 0.0, 0.2, 0.0])
    assert cell.asked == asked + 1
    assert found.flagged.tolist() == [False, True, False, True, False]
    assert law.reasons(H[:2], [0.0, 0.2]) == ["", "p"]
    assert len(found[1:3]) == 2
    assert found[1:3].tangent.conductivity_grad_u.shape == (2, 3, 3, 3, 3)  # type: ignore[union-attr]


def test_rows_do_not_depend_on_the_others(macro: MacroLaw) -> None:
    law = porocore.Law(macro, POROSITY)
    together, alone = law.response(H, P), law.response(H[2], P[2])
    for name in ("stress", "fluid_volume", "conductivity"):
        np.testing.assert_allclose(
            getattr(together, name)[2], getattr(alone, name)[0], rtol=1e-13, atol=1e-15
        )


@pytest.mark.parametrize(
    ("grad_u", "p", "said"),
    [
        (np.zeros((2, 3)), 0, r"grad_u: expected shape \(3, 3\), or \(n, 3, 3\) for n states, got \(2, 3\)"),
        (np.zeros((3, 3)), [0, 1], "p: expected one number, or one for each of the n = 1 states of grad_u"),
        (np.full((3, 3), np.nan), 0, "grad_u: expected finite numbers, got nan"),
        (np.zeros((3, 3)), None, "p: expected finite numbers, got nan"),
        ("0 0 0", 0, "grad_u: expected numbers in rows of equal length, got '0 0 0'"),
    ],
)
def test_what_is_no_state_is_refused(grad_u: object, p: object, said: str) -> None:
    law = porocore.Law(linear(), POROSITY)
    with pytest.raises(ConfigurationError, match=said):
        law.response(grad_u, p)  # type: ignore[arg-type]
    before = law.response(np.zeros((4, 3, 3)))
    with pytest.raises(
        ConfigurationError, match="before: expected the response at the same 1 states, got one at 4"
    ):
        law.response(np.zeros((3, 3)), before=before)


THETA = np.stack([MOVING.uniform(0.15, 0.3, N), MOVING.uniform(0.5, 2.0, N)], axis=1)
RANGES = [
    CellParameter("radius", ("geometry", "radius"), 0.15, 0.3, 0.225),
    CellParameter("stiffness", ("material", "modulus"), 0.5, 2.0, 1.25),
]
FAMILIES: dict[str, Callable[[], MacroLaw]] = {
    "potential": parametric_law,
    "mean-gradient": lambda: parametric_law(closure="mean-gradient"),
    "linear": lambda: LinearisedLaw(parametric_law()),
}


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> porocore.Law:
    return porocore.Law(FAMILIES[request.param](), lambda values: porosity(values[:, 0]), ranges=RANGES)


def test_parameters_are_given_with_the_states_or_bound(family: porocore.Law) -> None:
    """By name, in their order, in two steps of binding: the same bits; and the law of a cell that has the constants."""
    assert family.parameters == ("radius", "stiffness")
    given = {"stiffness": THETA[:, 1], "radius": THETA[:, 0]}
    before = family.response(OLD_H, OLD_P, parameters=THETA)
    found = family.response(H, P, parameters=given, before=before)
    for k in range(N):
        one = family.at(radius=THETA[k, 0]).at({"stiffness": THETA[k, 1]})
        assert one.parameters == ()
        begun = one.response(OLD_H[k], OLD_P[k])
        bound = one.response(H[k], P[k], before=begun)
        half = family.at(stiffness=THETA[k, 1])
        partly = half.response(
            H[k],
            P[k],
            parameters=[THETA[k, 0]],
            before=half.response(OLD_H[k], OLD_P[k], parameters=[THETA[k, 0]]),
        )
        for name in ("stress", "fluid_volume", "conductivity"):
            np.testing.assert_array_equal(getattr(bound, name), getattr(partly, name))
            np.testing.assert_allclose(
                getattr(bound, name)[0], getattr(found, name)[k], rtol=1e-12, atol=1e-15
            )
        if family.name == "linear":
            continue
        alone = parametric_law(BoundCell(THETA[k]), float(THETA[k, 0]), family.name)
        plain = porocore.Law(alone, float(porosity(THETA[k, 0])))
        known = plain.response(H[k], P[k], before=plain.response(OLD_H[k], OLD_P[k]))
        for name in ("stress", "fluid_volume", "conductivity"):
            np.testing.assert_allclose(getattr(bound, name), getattr(known, name), rtol=1e-12, atol=1e-15)


def test_the_fluid_of_a_family_at_rest_is_its_porosity(family: porocore.Law) -> None:
    found = family.response(np.zeros((N, 3, 3)), parameters=THETA)
    np.testing.assert_allclose(found.fluid_volume, porosity(THETA[:, 0]), rtol=1e-12)
    assert family.at(radius=0.2).at(stiffness=1.0).porosity == pytest.approx(float(porosity(np.array(0.2))))
    with pytest.raises(ConfigurationError, match=r"the porosity depends on radius; at\(\) binds"):
        _ = family.at(stiffness=1.0).porosity


def test_derivatives_of_a_member_are_the_slopes() -> None:
    """Of the linear law too, whose fluid is counted from the last states."""
    for make in FAMILIES.values():
        law = porocore.Law(make(), lambda values: porosity(values[:, 0])).at(radius=0.2, stiffness=1.4)
        before = law.response(OLD_H, OLD_P)
        d = law.response(H, P, before=before).tangent
        assert d is not None
        ends = [law.response(H, P + s * STEP, before=before, tangent=False).fluid_volume for s in (1, -1)]
        np.testing.assert_allclose(d.fluid_volume_p, (ends[0] - ends[1]) / (2 * STEP), rtol=1e-6)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        (
            None,
            "parameters: missing; the law needs radius, stiffness: give them with the states, or bind them by at",
        ),
        (
            {"radius": 0.2},
            "stiffness: no value is given for this parameter of the cell; the parameters are radius and s",
        ),
        (
            {"radius": 0.2, "stifness": 1},
            "stifness: no parameter of the cell has this name; did you mean 'stiffness'",
        ),
        (
            {"radius": 0.31, "stiffness": 1},
            "radius: expected a number from 0.15 to 0.3, the range of cell.geometry.r",
        ),
        ({"radius": [0.2, 0.1, 0.2, 0.2, 0.2], "stiffness": 1}, "radius: expected a number from 0.15 to 0.3"),
        (
            {"radius": [0.2, 0.2], "stiffness": 1},
            "radius: expected a finite number, or one for each of the n = 5",
        ),
        (
            {"radius": "wide", "stiffness": 1},
            "radius: expected a finite number, or one for each .* got 'wide'",
        ),
        ({"radius": np.nan, "stiffness": 1}, "radius: expected a finite number"),
        (
            [0.2],
            r"parameters: expected values of radius, stiffness, shape \(2,\) or \(5, 2\), got shape \(1,\)",
        ),
        (0.2, r"parameters: expected values of radius, stiffness, .* got shape \(\)"),
    ],
)
def test_parameters_that_do_not_suit_are_refused(parameters: object, said: str) -> None:
    law = porocore.Law(parametric_law(), lambda values: porosity(values[:, 0]), ranges=RANGES)
    with pytest.raises(ConfigurationError, match=said):
        law.response(H, P, parameters=parameters)  # type: ignore[arg-type]


def test_what_cannot_be_bound_is_refused() -> None:
    law = porocore.Law(parametric_law(), lambda values: porosity(values[:, 0]), ranges=RANGES)
    for values, said in (
        ({"raduis": 0.2}, "raduis: no parameter of the cell has this name; did you mean 'radius'"),
        ({"radius": 0.4}, "radius: expected a number from 0.15 to 0.3"),
        ({"radius": "0.2"}, "radius: expected a number, got '0.2'"),
        (0.2, "expected values by name, such as radius=0.22, got 0.2"),
    ):
        with pytest.raises(ConfigurationError, match=said):
            law.at(values)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match=r"raduis: no parameter .* the parameters are stiffness"):
        law.at(radius=0.2).at(raduis=0.2)
    for bound in (law.at(radius=0.2), law.at(radius=0.2).at(stiffness=0.5)):
        with pytest.raises(
            ConfigurationError, match=r"radius: it is bound to 0\.2 already; bind another value"
        ):
            bound.at(radius=0.25)
        with pytest.raises(ConfigurationError, match=r"radius: it is bound to 0\.2 already"):
            bound.response(H, P, parameters={"radius": 0.25})
    with pytest.raises(ConfigurationError, match=r"radius: no parameter .* the cell has no parameters"):
        porocore.Law(linear(), POROSITY).response(H, P, parameters={"radius": 0.2})
