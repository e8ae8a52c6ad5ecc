"""A block of whole cells: the mesh, fields on it, the same answer as one cell, and another one behind the onset."""

from importlib.util import find_spec

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings, make_contact_model
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.meshing.mesh import MeshSettings, block, tiled
from porocore.cell.stability.modes import lowest_mode
from porocore.interfaces.cell import CellField
from porocore.states import MacroState, Status

LINEAR = MeshSettings(size=0.2, fluid_size=0.2, element="linear")
QUADRATIC = MeshSettings(size=0.2, fluid_size=0.2)
GENERAL = MacroState.single(np.array([[0.02, 0.03, 0.0], [-0.01, -0.08, 0.02], [0.01, 0.0, 0.01]]), 0.05)
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")
TANGENTS = tuple(f"{name}_{by}" for name in ("mean_grad", "stress", "fluid_volume") for by in ("grad_u", "p"))


def skfem():
    return pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver()


def dolfinx():
    if find_spec("dolfinx") is None:
        pytest.skip("dolfinx is not installed")
    return pytest.importorskip("porocore_fem_dolfinx.cell_solver").DolfinxCellSolver()


def volume(mesh):
    corners = mesh.points[mesh.cells[:, :4]]
    return np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6


@pytest.mark.parametrize("settings", [LINEAR, QUADRATIC], ids=["linear", "quadratic"])
@pytest.mark.parametrize("periods", [(2, 1, 1), (1, 2, 3)], ids=str)
def test_a_block_is_its_cells_side_by_side(settings, periods):
    whole = Cell(mesh=settings).make_mesh("solid", "whole")
    cell = Cell(mesh=settings, supercell=periods)
    mesh = cell.make_mesh("solid", "whole")
    n = np.prod(periods)
    assert (mesh.domain, mesh.periods, mesh.order) == ("whole", periods, whole.order)
    np.testing.assert_array_equal(mesh.points.min(axis=0), [-0.5] * 3)
    np.testing.assert_array_equal(mesh.points.max(axis=0), np.array(periods) - 0.5)
    assert volume(mesh) == pytest.approx(n * volume(whole), rel=1e-12)
    assert mesh.periodic_class.max() + 1 == n * (whole.periodic_class.max() + 1)
    assert len(mesh.wall) == n * len(whole.wall)
    assert mesh.quadratic.periods == periods
    # Nodes of one class are periods of the block apart.
    first = np.unique(mesh.periodic_class, return_index=True)[1]
    apart = (mesh.points - mesh.points[first][mesh.periodic_class]) / periods
    np.testing.assert_array_equal(apart, np.round(apart))
    # The flow repeats itself, and a supercell has no mirrors left.
    assert cell.make_mesh("fluid", "whole").periods == (1, 1, 1)
    assert not cell.mirrored


def test_periodic_fields_are_tiled():
    whole = Cell(mesh=LINEAR).make_mesh("solid", "whole")
    periods = (2, 1, 2)
    mesh = block(whole, periods)
    even = np.cos(2 * np.pi * whole.points)
    np.testing.assert_allclose(tiled(whole, even, periods), np.cos(2 * np.pi * mesh.points), atol=1e-12)
    with pytest.raises(ValueError, match="do not meet"):
        tiled(whole, np.sin(np.pi * whole.points), periods)
    with pytest.raises(ValueError, match="one whole cell"):
        tiled(mesh, even, periods)
    with pytest.raises(ValueError, match="one whole cell"):
        block(mesh, periods)


@pytest.mark.parametrize("make_solver", [skfem, dolfinx])
def test_a_stable_supercell_answers_like_one_cell(make_solver):
    """Every mean and every derivative, under a load without any symmetry."""
    solver = make_solver()
    one = Cell(mesh=LINEAR, symmetry="none")
    many = Cell(mesh=LINEAR, supercell=(2, 1, 1))
    a, b = (solver.solve(solver.prepare(cell), GENERAL).response for cell in (one, many))
    assert a.status[0] == b.status[0] == Status.converged
    for name in RESPONSES:
        np.testing.assert_allclose(getattr(b, name), getattr(a, name), rtol=0, atol=1e-9, err_msg=name)
    for name in TANGENTS:
        x, y = getattr(a.tangent, name), getattr(b.tangent, name)
        assert np.isfinite(x).all()
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-9, err_msg=name)
    assert b.extrema.energy_mean[0] == pytest.approx(a.extrema.energy_mean[0], rel=1e-9)


def test_conductivity_is_that_of_one_cell():
    solver = skfem()
    K = [solver.conductivity(solver.prepare(Cell(mesh=LINEAR, supercell=n))) for n in ((1, 1, 1), (2, 2, 1))]
    np.testing.assert_array_equal(*K)


def test_contact_of_a_block_is_that_of_its_cells():
    """The same field in every cell pushes roof and floor of the pore through each other in its middle."""
    settings = ContactSettings()
    whole = Cell(geometry=OrthogonalChannels(axes="xz"), mesh=LINEAR).make_mesh("solid", "whole")
    mesh = block(whole, (2, 1, 2))
    H = np.array([[0.0, 0.02, 0.0], [0.0, -0.02, 0.0], [0.0, 0.03, 0.0]])

    def pushed(X):
        x, y, z = np.pi * X.T
        return np.outer(-0.27 * np.sin(2 * y) * np.cos(x) ** 8 * np.cos(z) ** 8, [0.0, 1.0, 0.0])

    states = [make_contact_model(m, settings).at(H, pushed(m.points)) for m in (whole, mesh)]
    one, many = (state.forces for state in states)
    assert one.energy > 0
    assert many.energy == pytest.approx(4 * one.energy, rel=1e-9)
    assert many.share == pytest.approx(one.share, rel=1e-9)
    assert states[1].depth == pytest.approx(states[0].depth, rel=1e-9)
    np.testing.assert_allclose(many.by_load, 4 * one.by_load, atol=1e-9 * np.abs(one.by_load).max())


def test_a_perturbation_is_scaled_to_its_amplitude():
    field = CellField(np.zeros((3, 3)), 0.1, "whole", np.ones((2, 3)))
    mode = np.array([[0.0, -4.0, 0.0], [2.0, 0.0, 0.0]])
    start = field.perturbed(mode, 0.02)
    np.testing.assert_allclose(start.u, [[1.0, 0.98, 1.0], [1.01, 1.0, 1.0]])
    assert (start.p, start.domain) == (0.1, "whole")
    np.testing.assert_array_equal(field.u, np.ones((2, 3)))


def test_behind_the_onset_a_supercell_follows_the_mode_of_period_two():
    """H₂₂ = −0.26, p = 0, a block of 2 × 2 × 1: less energy than one cell can have, and a smaller stress."""
    solver = skfem()
    state = MacroState.single(np.diag([0.0, -0.26, 0.0]))
    one = solver.prepare(Cell(mesh=LINEAR))
    symmetric = solver.solve(one, state, tangent=False, fields=True)
    assert symmetric.response.status[0] == Status.converged
    eighth = symmetric.fields[0]
    one.eighth.reset()
    mode = lowest_mode(one.eighth, one.eighth.iterate_at(eighth.grad_u, eighth.p, eighth.u), "110")
    assert mode.value < 0
    assert mode.periods == (2, 2, 1)

    whole = solver.solve(
        solver.prepare(Cell(mesh=LINEAR, symmetry="none")), state, tangent=False, fields=True
    )
    many = solver.prepare(Cell(mesh=LINEAR, supercell=(2, 2, 1)))
    mesh = many.whole.mesh
    cell_mesh = Cell(mesh=LINEAR).make_mesh("solid", "whole")
    field = whole.fields[0]
    start = CellField(field.grad_u, field.p, "whole", tiled(cell_mesh, field.u, mesh.periods))
    start = start.perturbed(mode.at(mesh.points), 0.01)
    buckled = solver.solve(many, state, start=[start], tangent=False, fields=True)
    assert Status(buckled.response.status[0]).stable
    assert buckled.response.potential[0] < symmetric.response.potential[0] - 1e-4
    P = [abs(r.stress[0, 1, 1]) for r in (buckled.response, symmetric.response)]
    assert P[0] < 0.95 * P[1]

    # It repeats itself after two cells along x or y and not after one, but after one along both.
    u, u_of = buckled.fields[0].u, {tuple(X): i for i, X in enumerate(mesh.points.round(9))}
    inner = np.flatnonzero((mesh.points < 0.49).all(axis=1))
    along = [
        np.array([u_of[tuple(X)] for X in (mesh.points[inner] + shift).round(9)])
        for shift in ([1, 0, 0], [0, 1, 0], [1, 1, 0])
    ]
    differences = [np.abs(u[there] - u[inner] - (u[there[0]] - u[inner[0]])).max() for there in along]
    assert min(differences[:2]) > 0.01
    assert differences[2] < 1e-6
