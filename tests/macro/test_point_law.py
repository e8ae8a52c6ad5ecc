"""A law as a function of the state: it is that of the macro solver, and its derivatives are the slopes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_up_conductivity import conductivity

import porocore
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw, MacroLaw
from porocore.macro.laws import ClosedLaw, MeanGradientClosure, PotentialClosure
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.states import CellResponse, MacroState
from porocore.testing.synthetic.cell import SOLID_FRACTION, respond
from porocore.testing.synthetic.response import cubic_reference

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
            respond(states), conductivity=conductivity(states), outside_training_range=states.p > 0.1
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


def test_it_is_the_law_of_the_macro_solver(macro: MacroLaw) -> None:
    """The second of two steps, with the flux under any gradient of the pressure."""
    law = porocore.Law(macro, POROSITY)
    before = law.response(OLD_H, OLD_P, tangent=False)
    found = law.response(H, P, before=before)
    begun = macro.respond(MacroState(OLD_H, OLD_P), np.zeros((N, 3)), macro.initial(N))
    there = macro.respond(MacroState(H, P), GRADIENT, begun.memory)
    np.testing.assert_array_equal(found.stress, there.stress)
    np.testing.assert_array_equal(found.deformation, there.deformation)
    np.testing.assert_array_equal(found.outside_training_range, there.outside_training_range)
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
    assert found.outside_training_range.tolist() == [False, True, False, True, False]
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
