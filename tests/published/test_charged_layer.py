"""Fixed charges: Donnan's pressure, equilibria of a cell by scalar equations, a layer near them."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.analytic import ChargedCell, ChargedLayer
from porocore.states import MacroState
from porocore.testing.synthetic import potential_cell

FREE, CONFINED = np.eye(3), np.diag([0.0, 1.0, 0.0])
POROSITY = 1 - potential_cell.SOLID_FRACTION


def response(H, p):
    found = potential_cell.respond(MacroState.single(H, p))
    return found.stress[0], float(found.fluid_volume[0])


def cell(bath=0.15, density=0.2, osmotic=0.25):
    return ChargedCell(response, density * POROSITY, bath, osmotic)


@pytest.mark.parametrize(("charge", "bath"), [(0.08, 0.15), (0.2, 0.001), (0.01, 2.0)])
def test_osmotic_pressure_is_that_of_the_ions(charge, bath):
    fluid, c = 0.6, charge / 0.6
    found = ChargedCell(response, charge, bath, 2.5).osmotic_pressure(fluid)
    assert found == pytest.approx(2.5 * (np.sqrt(c**2 + 4 * bath**2) - 2 * bath), rel=1e-10)
    anions = np.roots([1, c, -(bath**2)]).max()
    assert found == pytest.approx(2.5 * (2 * anions + c - 2 * bath), rel=1e-10)


def test_osmotic_pressure_in_cartilage():
    """0.2 mol/l at 298 K in 0.15 mol/l: 0.150 MPa; without salt, R T c_F."""
    RT = 8.314462618e-3 * 298.15  # MPa l/mol
    assert ChargedCell(response, 0.2, 0.15, RT).osmotic_pressure(1.0) == pytest.approx(0.1501, rel=1e-3)
    assert ChargedCell(response, 0.2, 1e-9, RT).osmotic_pressure(1.0) == pytest.approx(RT * 0.2, rel=1e-7)


@pytest.mark.parametrize("effective", [0.0, -0.02, 0.05])
def test_pressure_is_osmotic_and_effective(effective):
    H, charged = np.diag([0.01, -0.05, 0.02]), cell()
    p = charged.pressure(H, effective)
    assert p - charged.osmotic_pressure(response(H, p)[1]) == pytest.approx(effective, abs=1e-14)


@pytest.mark.parametrize("bath", [0.015, 0.15, 2.0])
@pytest.mark.parametrize("direction", [FREE, CONFINED])
def test_a_cell_swells_until_it_bears_no_stress(direction, bath):
    charged = cell(bath)
    strain, p = charged.equilibrium(direction)
    stress, fluid = response(strain * direction, p)
    assert strain > 0
    assert stress[1, 1] == pytest.approx(0, abs=1e-13)
    assert p == pytest.approx(charged.osmotic_pressure(fluid), rel=1e-13)


def test_a_cell_swells_less_in_more_salt_and_under_load():
    swollen = [cell(bath).equilibrium(FREE)[0] for bath in (0.015, 0.15, 1.0)]
    pressed = [cell().equilibrium(CONFINED, load)[0] for load in (0.0, 0.02, 0.08)]
    assert np.all(np.diff(swollen) < 0)
    assert np.all(np.diff(pressed) < 0)
    assert pressed[-1] < 0
    assert cell(density=0.0).equilibrium(FREE) == (0.0, 0.0)


def test_no_equilibrium_is_told():
    with pytest.raises(ValueError, match="expected an equilibrium between 0 and"):
        ChargedCell(lambda H, p: (0 * H, 0.4), 0.08, 0.15, 0.25).equilibrium(CONFINED, 1.0)


def layer(charged, load=0.0):
    """The confined layer near its equilibrium, with the derivatives of the uncharged cell there."""
    strain, p = charged.equilibrium(CONFINED, load)
    found = potential_cell.respond(MacroState.single(strain * CONFINED, p))
    tangent, fluid = found.tangent, float(found.fluid_volume[0])
    concentration, bath = charged.charge / fluid, charged.bath
    root = np.sqrt(concentration**2 + 4 * bath**2)
    return ChargedLayer(
        2.0,
        float(tangent.stress_grad_u[0, 1, 1, 1, 1]),
        float(tangent.fluid_volume_grad_u[0, 1, 1]),
        float(tangent.fluid_volume_p[0]),
        0.7,
        -charged.osmotic * concentration**2 / (fluid * root),
        charged.osmotic * (4 * bath / root - 2),
    )


@pytest.mark.parametrize("bath", [0.02, 0.15])
def test_apparent_constants_are_slopes_of_the_equilibria(bath):
    near, h = layer(cell(bath), 0.01), 1e-5
    a = near.apparent

    def slope(f):
        return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h)

    by_load = slope(lambda more: cell(bath).equilibrium(CONFINED, 0.01 + more)[0])
    by_bath = slope(lambda more: cell(bath + more).equilibrium(CONFINED, 0.01)[0])
    assert -1 / by_load == pytest.approx(a.stiffness, rel=1e-8)
    assert by_bath == pytest.approx(a.biot * near.by_bath / a.stiffness, rel=1e-7)
    assert float(near.rise(1.0, 1e6)) / near.height == pytest.approx(by_bath, rel=1e-7)
    H = cell(bath).equilibrium(CONFINED, 0.01)[0] * CONFINED

    def fluid(effective):
        return response(H, cell(bath).pressure(H, effective))[1]

    assert slope(fluid) == pytest.approx(a.storage, rel=1e-8)


def test_a_changed_bath_moves_no_fluid_at_first_and_reaches_the_bottom_at_last():
    near = layer(cell())
    a, y = near.apparent, np.linspace(0.0, 1.9, 8)
    time = near.height**2 / near.loaded(1.0).consolidation_coefficient
    first, last = near.effective_pressure(-0.01, y, 1e-9 * time), near.effective_pressure(-0.01, y, 20 * time)
    np.testing.assert_allclose(first, near.by_bath * 0.01, rtol=1e-12)
    np.testing.assert_allclose(last, 0, atol=1e-15)
    assert float(near.rise(-0.01, 0.0)) == 0
    assert float(near.rise(-0.01, 20 * time)) > 0
    # What is taken up has come through the top: s_app ∂m/∂t = K ∂²m/∂y².
    t, dt, dy = 0.2 * time, 1e-4 * time, 1e-3
    rate = (near.effective_pressure(-0.01, y, t + dt) - near.effective_pressure(-0.01, y, t - dt)) / (2 * dt)
    above, here, below = (near.effective_pressure(-0.01, y + s, t) for s in (dy, 0.0, -dy))
    curvature = (above - 2 * here + below) / dy**2
    np.testing.assert_allclose(a.capacity * rate, a.conductivity * curvature, rtol=1e-4)


def test_without_charges_it_is_terzaghis_layer():
    plain = ChargedLayer(2.0, 0.44, 0.79, 0.34, 1.94, 0.0, 0.0)
    assert plain.apparent.stiffness == 0.44
    assert plain.apparent.biot == 0.79
    assert plain.apparent.storage == 0.34
    assert float(plain.rise(0.1, 5.0)) == 0
