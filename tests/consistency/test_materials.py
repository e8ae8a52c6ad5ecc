"""Cell solvers against each other with solids of every kind of material, and of several materials."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from pydantic import TypeAdapter

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import AnyMaterial
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.crosscheck.bodies import compare_responses
from porocore.errors import ConfigurationError
from porocore.states import MacroState, Status

make = TypeAdapter(AnyMaterial).validate_python
#: Wide channels, so that elements may be large.
WIDE = OrthogonalChannels(radius=0.38)
GENERAL = MacroState.single(np.array([[0.03, 0.06, -0.02], [0.01, -0.05, 0.04], [0.0, 0.05, 0.02]]), 0.05)
DIAGONAL = MacroState.single(np.diag([0.03, -0.08, 0.02]), 0.05)
NU = 0.35
NEO_HOOKEAN = {
    "kind": "expression",
    "energy": "mu/2*(I1 - 3) - mu*log(J) + lam/2*log(J)**2",
    "parameters": {"mu": 1 / (2 * (1 + NU)), "lam": NU / ((1 + NU) * (1 - 2 * NU))},
}
FIBRES = {
    "kind": "expression",
    "energy": "c*(I1*J**(-2/3) - 3) + k*(J - 1)**2/2 + f*(I4 - 1)**2 + f*(I5 - 1)**2*I2",
    "parameters": {"c": 0.2, "k": 1.0, "f": 0.05},
    "directions": [[1, 0, 0]],
}
OGDEN = {
    "kind": "ogden",
    "bulk_modulus": 1.0,
    "terms": [{"mu": 0.3, "alpha": 2.3}, {"mu": -0.05, "alpha": -1.7}],
}
HGO = {
    "kind": "holzapfel-gasser-ogden",
    "shear_modulus": 0.3,
    "bulk_modulus": 1.0,
    "k1": 0.5,
    "k2": 2.0,
    "dispersion": 0.1,
    "directions": [[1, 1, 0], [1, -1, 0]],
}
CASES = {
    "expression": (FIBRES, GENERAL, "linear"),
    "ogden": (OGDEN, DIAGONAL, "quadratic-curved"),
    "holzapfel-gasser-ogden": (HGO, DIAGONAL, "quadratic-straight"),
}


def solved(load, backend, cell, state):
    solver = load("cell solver", backend)
    return solver.solve(solver.prepare(cell), state).response


def agree(load, pair, cell, state):
    """Both backends converge and agree in all that they return."""
    a, b = (solved(load, backend, cell, state) for backend in pair)
    assert a.status[0] == Status.converged
    lines = compare_responses("state", pair[0], a, pair[1], b)
    assert len(lines) > 8
    assert not [line.describe() for line in lines if not line.passed]
    return a


@pytest.mark.parametrize("case", CASES)
def test_every_kind_of_material(cell_solver_pair, load, case):
    material, state, element = CASES[case]
    mesh = MeshSettings(size=0.35, fluid_size=0.3, element=element)
    agree(load, cell_solver_pair, Cell(geometry=WIDE, material=make(material), mesh=mesh), state)


@pytest.mark.parametrize(
    "state",
    [pytest.param(DIAGONAL, id="diagonal"), pytest.param(GENERAL, id="general", marks=pytest.mark.slow)],
)
def test_the_neo_hookean_solid_by_its_own_way_and_by_the_general_one(cell_solver, load, state):
    mesh = MeshSettings(size=0.35, fluid_size=0.3, element="linear")
    own, general = (
        solved(load, cell_solver, Cell(geometry=WIDE, material=make(m), mesh=mesh), state)
        for m in ({}, NEO_HOOKEAN)
    )
    for line in compare_responses("state", "own", own, "general", general):
        assert line.passed
    np.testing.assert_allclose(general.stress, own.stress, rtol=0, atol=1e-10 * np.abs(own.stress).max())
    stiffness = own.tangent.stress_grad_u
    np.testing.assert_allclose(
        general.tangent.stress_grad_u, stiffness, rtol=0, atol=1e-10 * np.abs(stiffness).max()
    )


@pytest.fixture(scope="module")
def tagged(tmp_path_factory):
    """A mesh file of wide channels, its solid tagged 2 in one octant and 1 elsewhere; the fluid is 3."""
    cell = Cell(geometry=WIDE, mesh=MeshSettings(size=0.35, fluid_size=0.3, element="linear"))
    solid, fluid = (cell.make_mesh(phase, "whole") for phase in ("solid", "fluid"))
    corner = (solid.points[solid.cells].mean(axis=1) > 0).all(axis=1)
    path = tmp_path_factory.mktemp("mesh") / "tagged.vtu"
    points = np.concatenate([solid.points, fluid.points])
    cells = np.concatenate([solid.cells, fluid.cells + len(solid.points)])
    _, first, number = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    tags = np.concatenate([1 + corner, np.full(len(fluid.cells), 3)])
    meshio.Mesh(points[first], [("tetra", number.reshape(-1)[cells])], cell_data={"phase": [tags]}).write(
        path
    )
    return {"kind": "mesh-file", "path": str(path), "solid": [1, 2], "fluid": [3]}


def test_several_materials(cell_solver_pair, load, tagged):
    settings = {"geometry": tagged, "mesh": {"element": "linear"}, "materials": {1: OGDEN, 2: FIBRES}}
    response = agree(load, cell_solver_pair, Cell.model_validate(settings), GENERAL)
    swapped = Cell.model_validate(settings | {"materials": {1: FIBRES, 2: OGDEN}})
    other = solved(load, cell_solver_pair[1], swapped, GENERAL)
    assert np.abs(other.stress - response.stress).max() > 1e-3 * np.abs(response.stress).max()


def test_a_region_without_material(cell_solver, load, tagged):
    solver = load("cell solver", cell_solver)
    prepared = solver.prepare(Cell.model_validate({"geometry": tagged, "materials": {1: OGDEN}}))
    with pytest.raises(ConfigurationError, match="got none for 2; add '2:' below it"):
        solver.solve(prepared, GENERAL)
