"""The undeformed cell over its parameters, as the report has it: members, curves of the surrogate, bands."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.parameters import parameter_quantities
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.states import MacroState, Status
from porocore.study.findings.parameters import family_summary
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic import porous_family

CELL = Cell(
    geometry={"kind": "orthogonal-channels", "radius": {"range": [0.15, 0.3]}},
    material={"poisson_ratio": {"range": [0.2, 0.45]}},
)


@pytest.fixture(scope="module")
def summary():
    surrogate = PolynomialSurrogate().fit(porous_family.porous_training_set(64, 2), seed=0)
    rests = porous_family.rest_data(12)
    status = rests.responses.status.copy()
    status[3] = Status.not_converged
    responses = SimpleNamespace(stable=status == Status.converged)
    members = SimpleNamespace(
        states=lambda: rests.states,
        responses=lambda: _Rows(rests.responses, responses.stable),
    )
    law = ClosedLaw(surrogate, make_closure("potential", 0.7, NeoHookean(), np.eye(3)))
    return family_summary(CELL, members, law, surrogate), rests


class _Rows:
    """Responses of which one is without a solution."""

    def __init__(self, responses, stable):
        self._responses, self.stable = responses, stable

    def __getitem__(self, rows):
        return self._responses[rows]


def at_rest(radius, poisson_ratio):
    return porous_family.respond(MacroState.zeros(1).with_parameters([radius, poisson_ratio]))


def test_members_are_those_that_have_a_solution(summary):
    found, rests = summary
    assert (len(found.members), found.failed) == (11, 1)
    theta = np.delete(rests.states.parameters, 3, axis=0)
    np.testing.assert_array_equal(found.members, theta)
    fields = {field.plain: field for field in found.fields}
    # Equal along the axes, so once.
    assert set(fields) == {"porosity", "C_eff,1111", "C_eff,1212", "K11", "biot_22", "storage"}
    assert [each.name for each in found.parameters] == ["radius", "poisson_ratio"]
    one = at_rest(*theta[5])
    assert fields["porosity"].members[5] == pytest.approx(one.fluid_volume[0])
    assert fields["C_eff,1111"].members[5] == pytest.approx(one.tangent.stress_grad_u[0, 0, 0, 0, 0])
    assert fields["K11"].members[5] == pytest.approx(one.conductivity[0, 0, 0])
    assert fields["biot_22"].members[5] == pytest.approx(one.tangent.fluid_volume_grad_u[0, 1, 1])
    assert fields["storage"].members[5] == pytest.approx(one.tangent.fluid_volume_p[0])


def test_curves_are_the_cell_with_the_others_in_the_middle(summary):
    found, _ = summary
    fields = {field.plain: field for field in found.fields}
    for k, middle in ((0, 0.325), (1, 0.225)):
        for i in (0, 12, 24):
            value = found.points[k, i]
            one = at_rest(value, middle) if k == 0 else at_rest(middle, value)
            for name, exact in (
                ("porosity", one.fluid_volume[0]),
                ("C_eff,1111", one.tangent.stress_grad_u[0, 1, 1, 1, 1]),
                ("C_eff,1212", one.tangent.stress_grad_u[0, 0, 1, 0, 1]),
                ("K11", one.conductivity[0, 1, 1]),
                ("biot_22", one.tangent.fluid_volume_grad_u[0, 0, 0]),
                ("storage", one.tangent.fluid_volume_p[0]),
            ):
                assert fields[name].curves[k, i] == pytest.approx(exact, rel=2e-3), name
    for field in found.fields:
        assert (field.low <= field.curves).all()
        assert (field.curves <= field.high).all()
    # The porosity does not depend on Poisson's ratio, but for the fit through the members.
    np.testing.assert_allclose(fields["porosity"].high[0], fields["porosity"].low[0], rtol=1e-5)


def test_quantities_are_those_of_the_numbers_that_vary():
    cell = Cell(
        geometry={"radius": {"range": [0.2, 0.3]}},
        material={
            "kind": "mooney-rivlin",
            "c10": {"range": [0.1, 0.2]},
            "c01": 0.0,
            "bulk_modulus": {"range": [0.5, 1]},
        },
        viscosity={"range": [1e-3, 2e-3]},
    )
    assert parameter_quantities(cell) == {
        "radius": "", "c10": "stress", "bulk_modulus": "stress", "viscosity": "viscosity"
    }  # fmt: skip
    own = Cell(
        material={
            "kind": "expression",
            "energy": "a*(I1 - 3) - 2*a*log(J) + (log(J))**2",
            "parameters": {"a": {"range": [0.4, 0.6]}},
        }
    )
    assert parameter_quantities(own) == {"a": "stress"}
