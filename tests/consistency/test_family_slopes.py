"""Slopes in the responses of members of families against differences of members, for each backend."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.states import MacroState
from porocore.testing.expect import STEPS, central_difference

PRESSED = np.diag([0.02, -0.15, 0.01])
SHEARED = np.array([[0.02, 0.06, -0.02], [0.03, -0.15, 0.04], [0.0, 0.05, 0.02]])
TOUCHING = np.diag([0.01, -0.26, -0.005])
MESH = {"size": 0.35, "fluid_size": 0.25}
NAMES = ("potential", "stress", "fluid_volume", "mean_grad", "conductivity")
CHANNELS = {"kind": "orthogonal-channels"}
OGDEN = {
    "kind": "ogden",
    "bulk_modulus": {"range": [1.0, 2.0]},
    "terms": [{"mu": 0.4, "alpha": {"range": [1.5, 2.5]}}],
}
FIBRES = {
    "kind": "holzapfel-gasser-ogden",
    "shear_modulus": 0.3,
    "bulk_modulus": 1.0,
    "k1": 0.2,
    "k2": 1.0,
    "directions": [{"plane": "xy", "angle": {"range": [-30, 30]}}],
}
#: Settings of a family, and a state; with shear it is solved on the whole cell.
FAMILIES = {
    "radius and Poisson's ratio": (
        {
            "geometry": {**CHANNELS, "radius": {"range": [0.2, 0.3]}},
            "material": {"poisson_ratio": {"range": [0.3, 0.4]}},
        },
        PRESSED,
    ),
    "radius of one axis": ({"geometry": {**CHANNELS, "radii": [{"range": [0.2, 0.26]}, 0.2, 0.24]}}, PRESSED),
    "void fraction of a gyroid": (
        {"geometry": {"kind": "tpms", "surface": "gyroid", "void_fraction": {"range": [0.5, 0.6]}}},
        SHEARED,
    ),
    "modulus and exponent": ({"material": OGDEN}, PRESSED),
    "angle of fibres, mirrored at this one alone": ({"material": FIBRES}, PRESSED),
    "swelling": ({"material": {"swelling": {"range": [1.0, 1.1]}}}, PRESSED),
    "linear elements, viscosity": (
        {
            "mesh": {**MESH, "element": "linear"},
            "geometry": {**CHANNELS, "radius": {"range": [0.2, 0.3]}},
            "viscosity": {"range": [1e-3, 2e-3]},
        },
        SHEARED,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("deformed", [False, True], ids=["K", "K_ref"])
@pytest.mark.parametrize("name", FAMILIES)
def test_slopes_are_those_of_the_members(load, cell_solver, name, deformed):
    """To 1e-8 of the largest entry, and the conductivity of the deformed pore as well."""
    settings, H = FAMILIES[name]
    # Fibres come to bear within a small range of strain, so their differences need small steps.
    step = 2e-4 if "fibres" in name else 5e-3
    held_against_members(load("cell solver", cell_solver), settings, H, deformed=deformed, step=step)


@pytest.mark.slow
def test_slopes_in_contact_are_those_of_the_members(load, cell_solver):
    """Second derivatives of the contact's energy jump, and so the differences are less exact."""
    settings, _ = FAMILIES["radius and Poisson's ratio"]
    response = held_against_members(
        load("cell solver", cell_solver),
        settings,
        TOUCHING,
        within=1e-5,
        step=1e-4,
        contact={"kind": "frictionless"},
    )
    assert response.extrema.contact_share[0] > 0


def held_against_members(solver, settings, H, deformed=False, within=1e-8, step=5e-3, **others):
    family = Cell(**{"mesh": MESH, "contact": {"kind": "none"}, **settings, **others})
    state = MacroState.single(H, 0.05)

    def solved(values):
        prepared = solver.prepare(family.at(values), deformed=deformed)
        response = solver.solve(prepared, state).response
        K = response.conductivity[0] if deformed else solver.conductivity(prepared)
        return response, {name: getattr(response, name)[0] for name in NAMES[:-1]} | {"conductivity": K}

    # Off the base where the mesh moves.
    middle = np.array([p.lower + (0.6 if p.shape else 0.5) * (p.upper - p.lower) for p in family.parameters])
    response, _ = solved(middle)
    for k, parameter in enumerate(family.parameters):
        h = step * (parameter.upper - parameter.lower)
        ends = [solved(middle + s * h * np.eye(len(middle))[k])[1] for s in STEPS]
        for name in NAMES:
            expected = central_difference((end[name] for end in ends), h)
            found = getattr(response.slopes, name)[0, ..., k]
            round_off = 1e-14 * max(np.abs(end[name]).max() for end in ends) / h
            allowed = max(within * np.abs(expected).max(), round_off)
            np.testing.assert_allclose(found, expected, rtol=0, atol=allowed, err_msg=name)
    return response
